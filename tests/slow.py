"""Slow tests: which functions `make test` leaves to `make test-all`, and the writer of that list.

    python -m pytest -q -n auto --dist loadfile --durations=0 >build/durations  # an idle machine
    python tests/slow.py build/durations                                        # writes the list

A function is slow if all its cases together take SLOW_S. A test that is not listed is fast.
"""

import re
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Final

LIST: Final = Path(__file__).with_name("slow.txt")
SLOW_S: Final = 2.0
_DURATION: Final = re.compile(r"\s*([\d.]+)s (?:call|setup|teardown) +(\S+?)(?:\[.*)?$")


def listed() -> frozenset[str]:
    """Slow functions, `tests/FILE.py::FUNCTION`."""
    return frozenset(LIST.read_text().split())


def slow(lines: Iterable[str], least_s: float = SLOW_S) -> list[str]:
    """Functions that took `least_s` [s] and more, by pytest's report of durations, sorted."""
    took: defaultdict[str, float] = defaultdict(float)
    for line in lines:
        if found := _DURATION.match(line):
            took[found[2]] += float(found[1])
    return sorted(name for name, seconds in took.items() if seconds >= least_s)


if __name__ == "__main__":
    LIST.write_text("\n".join(slow(Path(sys.argv[1]).read_text().splitlines())) + "\n")
