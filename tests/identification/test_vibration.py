"""Vibration that drowns friction is found, filtered and said; quiet logs stay as they are."""

import re
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.foreign_logs import Stranger, Style, stranger, write_csv
from estimator.model import Model
from estimator.settings import EstimatorSettings
from identification.motion_log import MotionLog
from identification.vibration import without_vibration

SETTINGS = EstimatorSettings(motor_position="integrated")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return stranger(8, 25.0, tmp_path_factory.mktemp("stranger"))


def written(arm: Stranger, style: Style, folder: Path) -> MotionLog:
    rows = np.loadtxt(write_csv(arm, style, folder / "log.csv"), delimiter=",", skiprows=1)
    q, theta, v, current = np.moveaxis(rows[:, 1:].reshape(len(rows), -1, 4), 2, 0)
    return MotionLog(arm.log.joints, rows[:, 0], current, q, v, theta)


@pytest.mark.parametrize(
    ("rate_Hz", "share", "hertz"), [(100.0, 2.0, 9.0), (100.0, 4.0, 20.0), (500.0, 4.0, 14.0)]
)
def test_vibration_is_filtered_and_said(
    tmp_path: Path, arm: Stranger, rate_Hz: float, share: float, hertz: float
) -> None:
    log = written(arm, Style(rate_Hz=rate_Hz, vibration=(share, hertz)), tmp_path)
    straight = written(arm, Style(rate_Hz=rate_Hz), tmp_path)
    constants = arm.truth.torque_constant
    found, notes = without_vibration(log, Model(arm.arm.urdf, log.joints), SETTINGS, constants)
    turns = np.exp(2.0j * np.pi * hertz * log.time_s)
    before, after = (np.abs(turns @ (one.current - straight.current)) for one in (log, found))
    assert (after < 0.15 * before).all()
    (note,) = notes
    for joint, friction in zip(log.joints, arm.friction, strict=True):
        ((size, edge),) = re.findall(rf"{joint} ([\d.]+) Nm above ([\d.]+) Hz", note)
        assert float(size) == pytest.approx(share * friction, rel=0.3)
        assert 0.5 * hertz < float(edge) < hertz


@pytest.mark.parametrize("rate_Hz", [10.0, 50.0, 500.0])
def test_a_quiet_log_stays_as_it_is(tmp_path: Path, arm: Stranger, rate_Hz: float) -> None:
    log = written(arm, Style(rate_Hz=rate_Hz, vibration=(0.2, 9.0)), tmp_path)
    model = Model(arm.arm.urdf, log.joints)
    found, notes = without_vibration(log, model, SETTINGS, np.ones(log.n))
    assert notes == ()
    assert found is log
