"""Bench of loads and hands: what counts as found, and what the targets say."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from bench import load as bench
from bench.load import armed_targets, load_targets
from bench.rigs.lockstep import ROMEO
from bench.study import armed_loads
from bench.study import loads as study
from bench.study.armed_loads import ArmedJob, ArmedResult, armed_load
from bench.study.loads import TOUCHES, LoadJob, LoadResult, hand_torque, load
from daemon.config.load import load_robot


def result(given: float = 0.2, **changes: object) -> LoadResult:
    values = {
        "enough": True, "found_s": 8.0, "seconds_s": 9.0, "mass": given, "confirmed": given,
        "told_before": 0, "ratio": 1.0, "given": given,
    }  # fmt: skip
    return LoadResult(job=LoadJob(ROMEO, "dahl", 1, (given,)), **values | changes)


def met(results: list[LoadResult]) -> list[str]:
    return [target.name for target in load_targets(results) if not target.met]


def test_targets_of_loads() -> None:
    good = [result(), result(0.5)]
    assert not met(good)
    late = [result(found_s=11.0), result(0.5)]
    assert met(late) == ["0.2 kg recognised within 10 s of motion, of 1 arms"]
    assert met([result(found_s=None, mass=np.nan), result(0.5)])
    assert not met([*good, result(enough=False, found_s=None, mass=np.nan)])
    assert met([result(mass=0.251), result(0.5)])
    off = met([result(confirmed=0.251), result(0.5)])
    assert off == ["0.2 kg: masses confirmed off by more than 15 % and 50 g, of 1"]
    assert not met([result(confirmed=np.nan), result(0.5)])
    assert not met([result(0.2), result(0.5, mass=0.57)])
    assert met([result(0.2), result(0.5, mass=0.58)])
    assert met([result(ratio=1.2), result(0.5)])
    assert met([result(told_before=1), result(0.5)])


def test_targets_of_armed_arms() -> None:
    def of(
        mass: float, hinted_s: float | None, found_s: float | None = None, early: bool = False
    ) -> ArmedResult:
        return ArmedResult(
            job=ArmedJob(ROMEO, "dahl", 1, mass, 60.0), felt_s=1.0, hinted_s=hinted_s,
            found_s=found_s, mass=mass, told_before=early, rearmed=0, modes={},
        )  # fmt: skip

    assert all(t.met for t in armed_targets([of(0.2, 14.0), of(0.5, None, 7.0)]))
    for wrong in (of(0.5, 16.0), of(0.5, None), of(0.5, None, 16.0), of(0.5, 2.0, early=True)):
        assert [t.met for t in armed_targets([of(0.2, 14.0), wrong])].count(False) == 1


def test_an_armed_arm_takes_a_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(armed_loads, "WATCHED_S", 12.0)
    found = armed_load(ArmedJob(ROMEO, "dahl", 3010, 0.5, 12.0))
    assert found.felt_s is not None
    assert found.felt_s < 1.0
    assert not found.told_before
    assert sum(found.modes.values()) <= 12.0 + 1e-6
    assert found.hinted_s is not None
    assert found.hinted_s < 4.0
    if found.found_s is not None:
        assert found.mass == pytest.approx(0.5, rel=0.3)


@pytest.mark.parametrize("touch", TOUCHES)
def test_hands_come_and_go_and_change(touch) -> None:
    robot = load_robot(ROMEO)
    q = np.tile(np.linspace(0.0, 0.5, 3000)[:, np.newaxis], (1, 7))
    torque = hand_torque(robot, q, touch, np.random.default_rng(3))
    assert torque.shape == q.shape
    strong = np.abs(torque).max(axis=1)
    assert (strong == 0.0).mean() > 0.02
    assert strong.max() > 0.3
    if touch == "lean":  # on a link: what is beyond it feels nothing
        return
    assert np.abs(np.diff(torque, axis=0)).max() < 3.0


def test_an_arm_takes_a_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "FREE_S", 25.0)
    monkeypatch.setattr(study, "LOADED_S", 20.0)
    (found,) = load(LoadJob(ROMEO, "smooth", 6, (0.5,)))
    assert found.found_s is not None
    assert found.mass == pytest.approx(0.5, rel=0.2)
    assert found.ratio < 1.3
    assert found.told_before == 0


def test_a_small_run_prints_its_targets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "loads", lambda *_: [result(), result(0.5, ratio=np.nan)])
    done = CliRunner().invoke(bench.main, ["--part", "load", "--json"], catch_exceptions=False)
    report = json.loads(done.stdout.splitlines()[-1])
    assert report["bench"] == "load"
    assert report["data"]["loads"][1]["ratio"] is None
