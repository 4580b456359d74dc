"""Benches of speed: short runs of the commands themselves."""

import math
from pathlib import Path

import pytest

from bench import estimator, loop, recordings
from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.recorded_arm import made
from bench.study import recording_answers
from tests.bench.reports import reported


def test_recordings() -> None:
    report = reported(recordings, "--minutes 0.03 --rounds 1 --no-long")
    replay_us = report["data"]["replay_us"]
    assert replay_us.keys() == {"romeo_left_arm", "desk_arm"}
    assert all(0.0 < us < math.inf for us in replay_us.values())
    assert [target["name"] for target in report["targets"]] == [
        "replay, times real time",
        "200 levels from the cache",
        "plot as a page",
        "page",
    ]


def test_memory_is_measured_of_the_command(tmp_path: Path) -> None:
    path = made(tmp_path / "made.mcap", SINGLE_JOINT, 1.0, seed=1)
    snapshot, states = recording_answers.messages_of(path)
    again = tmp_path / "again.mcap"
    recording_answers.write(again, [(snapshot, states)] * 2)
    assert recording_answers.peak_mb(["replay", again], tmp_path) > 20.0


def test_loop() -> None:
    """Without its waiting, and so without a wake-up that a busy machine may spoil."""
    report = reported(loop, "--hz 100 --seconds 2 --in-a-row")
    run = report["data"]["100_Hz"]
    assert (run["joints"], run["mode"], run["missed"]) == (7, "tracking", 0)
    assert run["ticks"] == 200 - 5
    assert 0.0 < run["setpoint_us"]["p50"] < run["cpu_us"]["p50"] < math.inf


def test_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimator, "LATE", 200)
    report = reported(estimator, "--repetitions 2")
    assert [arm["arm"] for arm in report["data"]["arms"]] == ["1 joint", "7 joints", "14 joints"]
    limits = {target["name"]: target["limit"] for target in report["targets"]}
    for joints in (7, 14):
        assert limits[f"step over bare pinocchio calls, {joints} joints"] == 4
