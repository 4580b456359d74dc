"""Bench of what learning takes of a hand's torque."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from bench import absorption
from bench.absorption import Job, Result, afterwards, in_motion, targets
from bench.rigs.arm_without_bus import Recording
from bench.rigs.lockstep import ROMEO

JOB = Job(ROMEO, "smooth", 1, 60.0)
SHARES = len(absorption.SHARES)


def result(**changes: np.ndarray) -> Result:
    values = {
        "absorbed": np.zeros((SHARES, 2)),
        "raised": np.ones((SHARES, 2)),
        "missed": np.zeros((SHARES, 2), dtype=np.bool_),
        "ramp": np.array([1.0, np.nan]),
    }
    return Result(job=JOB, **values | changes)


def test_a_median_is_that_of_motion() -> None:
    ticks = 1000
    samples, values = np.zeros((ticks, 4, 2)), np.zeros((ticks, 2))
    samples[:400, 2, 0] = -0.3
    samples[:200, 2, 1] = 0.3  # too short to tell
    values[:, 0] = np.where(np.arange(ticks) < 400, 2.0, 7.0)
    truth = np.zeros((10 * ticks, 2))
    recording = Recording(
        time_s=0.01 * np.arange(ticks), samples=samples, phi=truth, gear_torque=truth,
        external=truth, half_gap=np.zeros(2), breakaway=np.zeros(2),
    )  # fmt: skip
    found = in_motion(recording, values, slice(0, ticks))
    assert found[0] == 2.0
    assert np.isnan(found[1])


def test_steps_come_one_after_the_other_when_the_hand_is_gone() -> None:
    level, signs = np.array([0.5, 0.2]), np.array([1.0, -1.0])
    first, second = afterwards(JOB, level, signs)
    np.testing.assert_allclose(first.torque, [1.0, 0.0])
    np.testing.assert_allclose(second.torque, [0.0, -0.4])
    gone_ms = 1000 * (absorption.WORK_S + JOB.hand_s)
    assert gone_ms < first.onset_ms
    assert first.onset_ms + first.duration_ms < second.onset_ms


@pytest.mark.parametrize(
    ("changes", "unmet"),
    [
        ({}, 0),
        ({"absorbed": np.array([[0.3, 0.0]] + [[0.0, 0.0]] * 3)}, 0),  # below half it may be
        ({"absorbed": np.array([[0.0, 0.0]] * 3 + [[0.06, np.nan]])}, 1),
        ({"missed": np.array([[False, True]] * 2 + [[False, False]] * 2)}, 2),
        ({"ramp": np.array([1.3, np.nan])}, 1),
    ],
)
def test_targets_that_are_missed(changes: dict[str, np.ndarray], unmet: int) -> None:
    found = targets([result(), result(**changes)])
    assert sum(not target.met for target in found) == unmet


def test_the_report_of_a_short_day(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in (("WORK_S", 20.0), ("JUDGED_S", 10.0), ("RAMP_S", 2.0)):
        monkeypatch.setattr(absorption, name, seconds)
    done = absorption.run(replace(JOB, hand_s=10.0))
    assert done.absorbed.shape == done.missed.shape == (SHARES, 7)
    moved = np.isfinite(done.absorbed)
    assert moved.any()
    assert (np.abs(done.absorbed[moved]) < 3.0).all()
    monkeypatch.setattr(absorption, "run", lambda job: done)
    words = ["--arms", "1", "--friction", "smooth", "--jobs", "1", "--json"]
    result = CliRunner().invoke(absorption.main, words, catch_exceptions=False)
    report = json.loads(result.stdout.splitlines()[-1])
    assert list(report["data"]["by_arm"]) == ["smooth 1"]
    done.absorbed[:, 1] = done.raised[:, 1] = np.nan
    result = CliRunner().invoke(absorption.main, words[:-1], catch_exceptions=False)
    assert "nan" not in result.stdout
