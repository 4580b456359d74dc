"""Process of a worker: loads a file of this folder, and answers a line of JSON per line of JSON.

    python -P bench/workers/runner.py NAME

Which code the worker measures, PYTHONPATH decides: today's, or that of a commit before. So this
file and the workers are run by path, never imported from the code that they measure, and a worker
uses nothing but what both codes have. The first line on stdin is what its `begin` gets, the others
are requests.
"""

import importlib.util
import json
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, cast

from daemon.service.realtime import single_threaded

Answer = Callable[[dict[str, Any]], dict[str, Any]]
Begin = Callable[[dict[str, Any]], AbstractContextManager[Answer]]


def loaded(name: str) -> Begin:
    """`begin` of the worker NAME.py beside this file."""
    path = Path(__file__).with_name(f"{name}.py")
    spec = importlib.util.spec_from_file_location(f"worker_{name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return cast(Begin, module.begin)


def main() -> None:
    lines, answers = sys.stdin, sys.stdout
    sys.stdout = sys.stderr  # whatever else is printed is no answer

    def say(answer: dict[str, Any]) -> None:
        print(json.dumps(answer), file=answers, flush=True)

    single_threaded()  # before the worker loads numpy
    begin = loaded(sys.argv[1])
    with begin(json.loads(lines.readline())) as answer:
        say({})
        for line in lines:
            say(answer(json.loads(line)))


if __name__ == "__main__":
    main()
