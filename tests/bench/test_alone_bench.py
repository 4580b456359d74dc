"""Counts of `bench.alone`: contacts without a person, and which targets a result meets."""

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from bench.alone import Result, missed, targets
from bench.study.alone import Job, Watched, arm_of
from bench.study.changes import Change
from daemon.modes.table import Mode

JOINT, TORQUE = 1, 1.5


@pytest.mark.parametrize(("kind", "false"), [("spring", 1), ("lean", 0)])
def test_a_contact_is_false_where_no_person_makes_it(kind: Any, false: int) -> None:
    robot, law, _ = arm_of(3)
    watched = Watched(robot, law, 3, Change(kind, JOINT, TORQUE, 1.0, place=100.0))
    watched.run(4.0)
    assert watched.on.tick.controller.machine.armed
    watched.there = True
    for _ in range(100):
        watched.step()
        if watched.on.mode is Mode.ADMITTANCE:
            break
    assert watched.on.mode is Mode.ADMITTANCE
    assert len(watched.seen.false) == false
    assert watched.seen.faults == 0


GOOD = Result(
    job=Job(9, "rub"), change=Change("rub", 0, 0.1, 60.0), own=True, alone_s=0.2, alone_rad=0.01,
    false=(1, 1), missed=0, touched=9, level=1.1, faults=0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "unmet"),
    [
        ({}, set()),
        ({"alone_s": 0.31}, {"longest motion alone"}),
        ({"alone_rad": 0.03}, {"furthest motion alone, own gains"}),
        ({"alone_rad": 0.03, "own": False}, set()),
        ({"false": (0, 2)}, {"false contacts of one change"}),
        ({"missed": 1}, {"touches missed"}),
        ({"level": 1.3}, {"level afterwards, largest"}),
        ({"faults": 1}, {"faults"}),
    ],
)
def test_the_worst_arm_decides(change: dict[str, Any], unmet: set[str]) -> None:
    results = [GOOD, replace(GOOD, **change), GOOD]
    assert {target.name for target in targets(results) if not target.met} == unmet


@pytest.mark.parametrize(
    ("delays", "usual", "count"),
    [
        ([0.05, 0.2], [0.05, 0.1], 0),
        ([0.05, 0.26], [0.05, 0.1], 1),
        ([np.inf, 0.1], [0.05, 0.1], 1),
        ([np.inf, np.inf], [np.inf, 0.1], 1),
        ([np.float64(np.inf), np.float64(0.1)], [np.inf, np.float64(0.1)], 0),
        ([0.1], [], 0),
    ],
)
def test_a_touch_is_missed_that_the_arm_without_the_change_feels(
    delays: list[float], usual: list[float], count: int
) -> None:
    assert missed(delays, usual) == count
    json.dumps(asdict(replace(GOOD, missed=missed(delays, usual))))
