"""Benches that measure in pairs with the code before: short runs of the commands themselves."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from bench import contact_free, estimator, loop, recordings
from bench.recordings import Shares
from bench.rigs.lockstep import SINGLE_JOINT
from bench.study import before as the_code_before
from bench.study import recording_answers
from bench.study.before import ROOT
from bench.workers.replay import made


@contextmanager
def no_code() -> Iterator[None]:
    yield None


@contextmanager
def todays_code() -> Iterator[Path]:
    yield ROOT


def reported(command: Any, *words: str) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*words, "--json"], catch_exceptions=False)
    found: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return found


def names(report: dict[str, Any]) -> list[str]:
    return [target["name"] for target in report["targets"]]


def test_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recordings, "code_before", todays_code)
    report = reported(recordings.main, "--minutes", "0.03", "--rounds", "1", "--no-many")
    for arm in ("romeo_left_arm", "desk_arm"):
        of = report["data"]["replay"][arm]
        assert of.keys() == {"today", "before", "faster"}
        assert of["faster"]["pairs"] == 1
        for side in ("today", "before"):
            assert 0.0 < of[side]["decode_us"] < of[side]["replay_us"]
            assert of[side]["states_per_s"] > 0
    assert names(report) == [
        *(f"replay speed over before's, {arm}" for arm in ("romeo_left_arm", "desk_arm")),
        "replay, times real time",
        "200 levels from the cache",
        "plot as a page",
        "page",
        "200 levels over replay before",
    ]


def test_memory_is_measured_of_the_command(tmp_path: Path) -> None:
    path = made(tmp_path / "made.mcap", SINGLE_JOINT, 1.0, seed=1)
    snapshot, states = recording_answers.messages_of(path)
    again = tmp_path / "again.mcap"
    recording_answers.write(again, [(snapshot, states)] * 2)
    assert recording_answers.peak_mb(["replay", again], tmp_path) > 20.0


def test_lockstep_beside_a_code_before() -> None:
    speed, faster = contact_free.lockstep_speed(1.0, 1, ROOT)
    assert speed > 0.0
    assert faster is not None
    assert faster.pairs == 1


def test_loop_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its waiting, and so without a wake-up that a busy machine may spoil."""
    monkeypatch.setattr(the_code_before, "code_before", no_code)
    report = reported(loop.main, "--hz", "100", "--seconds", "2", "--in-a-row")
    run = report["data"]["100_Hz"]
    assert report["data"]["before"] == "before: missing"
    assert (run["joints"], run["mode"], run["missed"]) == (7, "tracking", 0)
    assert run["ticks"] == 200 - 5
    assert 0.0 < run["setpoint_us"]["p50"] < run["cpu_us"]["p50"] < math.inf
    assert run["to_before"] == {}
    assert not [name for name in names(report) if "before" in name]


def test_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimator, "LATE", 200)
    report = reported(estimator.main, "--repetitions", "2")
    assert [arm["arm"] for arm in report["data"]["arms"]] == ["1 joint", "7 joints", "14 joints"]
    limits = {target["name"]: target["limit"] for target in report["targets"]}
    for joints in (7, 14):
        assert limits[f"step over bare pinocchio calls, {joints} joints"] == 4


def test_shares_of_a_replay_are_medians_and_the_rest_is_comparison() -> None:
    rounds = [{"replay": r, "decode": 10.0, "step": s} for r, s in ((30.0, 5.0), (50.0, 7.0))]
    found = Shares.of([*rounds, {"replay": 40.0, "decode": 20.0, "step": 6.0}])
    assert found == Shares(replay=40.0, decode=10.0, step=6.0, compare=15.0)
    assert found.states_per_s == 25_000.0
