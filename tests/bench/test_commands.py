"""Commands of benches: each runs from its options to its targets, small or by short runs.

The others are run by the file that is named with them."""

import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from bench import alone, detection, hand, newcomer, surroundings, wrench
from bench.study.wrench import Job, run
from tests.bench.reports import reported
from tests.bench.test_alone_bench import GOOD

HERE = (alone, detection, hand, newcomer, surroundings, wrench)
ELSEWHERE = {
    "test_small_runs": "identification logs makes masses oracle reaction",
    "test_speeds": "estimator loop recordings",
    "test_false_contacts": "false_contacts",
    "test_follow": "follow",
    "test_rivals_bench": "rivals",
}


def test_no_bench_is_left_out() -> None:
    there = {f.stem for f in Path(alone.__file__).parent.glob("*.py") if "main()" in f.read_text()}
    here = {module.__name__.removeprefix("bench.") for module in HERE}
    assert there == here | set(" ".join(ELSEWHERE.values()).split())
    for file, names in ELSEWHERE.items():
        text = Path(__file__).with_name(f"{file}.py").read_text()
        run = set(re.findall(r"reported\((\w+)", text)) | set(re.findall(r"(\w+)\.main", text))
        assert set(names.split()) <= run


@pytest.mark.parametrize(
    ("module", "words", "targets"),
    [
        (detection, "--minutes 1 --step-minutes 1 --friction dahl --jobs 1", 5),
        (hand, "--part guide --arms 1 --jobs 1", 2),
        (newcomer, "--owners 0 --no-mistakes", 1),
        (surroundings, "--motions 1", 12),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_small(module: ModuleType, words: str, targets: int) -> None:
    assert len(reported(module, words)["targets"]) >= targets


def test_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alone, "run", lambda job: replace(GOOD, job=job))
    report = reported(alone, "--arms 3 --first 4 --jobs 1")
    assert [arm["job"]["seed"] for arm in report["data"]["arms"]] == [4, 5, 6]
    assert all(target["met"] for target in report["targets"])


def test_wrench(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short runs of two arms stand for each run; one of them has a direction that is hidden."""
    alike = {"worked_s": 20.0, "seconds": 45.0}
    at_rest = run(Job("romeo", "rest", "dahl", 2, **alike))
    in_a_line = run(Job("openarm", "stretched", "dahl", 4, **alike))
    both = at_rest | {name: at_rest[name] + in_a_line[name] for name in ("forces", "links")}
    monkeypatch.setattr(wrench, "run", lambda job: both | {"job": job})
    report = reported(wrench, "--arms 1 --friction dahl --seed 5 --jobs 1")
    assert len(report["data"]["arms"]) == 3
    assert set(report["data"]["scores"]) == set(wrench.PRESSED)
