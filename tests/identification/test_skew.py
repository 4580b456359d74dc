"""Skew of columns: late and early velocities and currents are found and taken off; others stay."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.foreign_logs import Stranger, Style, stranger, write_csv
from estimator.model import Model
from estimator.settings import EstimatorSettings
from identification.motion_log import MotionLog
from identification.skew import LONGEST_S, without_skew

DRIVES = 3.5  # of the simulated drives' own filter [ms]
SETTINGS = EstimatorSettings(motor_position="integrated", current_delay_ms=DRIVES)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return stranger(3, 25.0, tmp_path_factory.mktemp("stranger"))


def written(arm: Stranger, style: Style, folder: Path) -> MotionLog:
    rows = np.loadtxt(write_csv(arm, style, folder / "log.csv"), delimiter=",", skiprows=1)
    q, theta, v, current = np.moveaxis(rows[:, 1:].reshape(len(rows), -1, 4), 2, 0)
    return MotionLog(arm.log.joints, rows[:, 0], current, q, v, theta)


@pytest.mark.parametrize("rate_Hz", [40.0, 100.0, 500.0])
@pytest.mark.parametrize(
    ("velocity", "current"), [(0.0, 0.0), (5.0, 0.0), (-10.0, 0.0), (0.0, -8.0), (4.0, 7.0)]
)
def test_skew_is_found_and_taken_off(
    tmp_path: Path, arm: Stranger, rate_Hz: float, velocity: float, current: float
) -> None:
    late = {"motor_velocity": 1e-3 * velocity, "current": 1e-3 * current}
    log = written(arm, Style(rate_Hz=rate_Hz, late_s=late), tmp_path)
    aligned, skew = without_skew(log, Model(arm.arm.urdf, log.joints), SETTINGS)
    assert 1e3 * skew.velocity == pytest.approx(np.full(log.n, velocity), abs=0.6)
    assert 1e3 * skew.current == pytest.approx(current, abs=1.6)
    assert bool(skew.notes(log.joints)) == bool(velocity or current)
    straight = written(arm, Style(rate_Hz=rate_Hz), tmp_path)
    for name in ("motor_velocity", "current"):
        before, after = (
            np.square(getattr(one, name) - getattr(straight, name))[5:-5].mean()
            for one in (log, aligned)
        )
        assert after <= (0.5 * before if late[name] else 0.0), name


def test_pauses_are_no_skew(tmp_path: Path, arm: Stranger) -> None:
    log = written(arm, Style(pauses=2, late_s={"motor_velocity": 0.005}), tmp_path)
    aligned, skew = without_skew(log, Model(arm.arm.urdf, log.joints), SETTINGS)
    assert 1e3 * skew.velocity == pytest.approx(np.full(log.n, 5.0), abs=0.6)
    assert len(aligned.stretches()) == len(log.stretches()) == 3


@pytest.mark.parametrize("what", ["stands", "later than any", "noise"])
def test_where_nothing_shows_nothing_is_taken_off(tmp_path: Path, arm: Stranger, what: str) -> None:
    log = written(arm, Style(), tmp_path)
    rng = np.random.default_rng(1)
    v = {
        "stands": np.zeros_like(log.motor_velocity),
        "later than any": np.roll(log.motor_velocity, round(2.0 * LONGEST_S / log.period_s), 0),
        "noise": rng.standard_normal(log.motor_velocity.shape),
    }[what]
    still = np.tile(log.link_position[:1], (len(v), 1))
    log = replace(log, motor_velocity=v)
    if what == "stands":
        log = replace(log, link_position=still, motor_position=still)
    _, skew = without_skew(log, Model(arm.arm.urdf, log.joints), SETTINGS)
    assert not skew.velocity.any()
