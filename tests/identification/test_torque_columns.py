"""Currents that are exchanged between joints, or low-passed, are refused; others are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.rigs.foreign_logs import Stranger, Style, stranger, write_csv
from common.errors import LogError
from estimator.model import Model
from estimator.settings import EstimatorSettings
from identification.motion_log import MotionLog
from identification.torque_columns import refuse_other_torques

SETTINGS = EstimatorSettings(motor_position="integrated")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return stranger(3, 25.0, tmp_path_factory.mktemp("stranger"), by_urdf=False)


def written(arm: Stranger, folder: Path, rate_Hz: float) -> MotionLog:
    style = Style(rate_Hz=rate_Hz, eccentric=0.0015, late_s={"current": 0.01})
    rows = np.loadtxt(write_csv(arm, style, folder / "log.csv"), delimiter=",", skiprows=1)
    q, theta, v, current = np.moveaxis(rows[:, 1:].reshape(len(rows), -1, 4), 2, 0)
    return MotionLog(arm.log.joints, rows[:, 0], current, q, v, theta)


def check(arm: Stranger, log: MotionLog) -> None:
    refuse_other_torques(log, Model(arm.arm.urdf, log.joints), SETTINGS)


@pytest.mark.parametrize("rate_Hz", [25.0, 500.0])
def test_exchanged_columns_are_named(tmp_path: Path, arm: Stranger, rate_Hz: float) -> None:
    log = written(arm, tmp_path, rate_Hz)
    order = [0, 2, 1, *range(3, log.n)]
    with pytest.raises(LogError, match=f"of {log.joints[1]} and {log.joints[2]} .*exchange"):
        check(arm, replace(log, current=log.current[:, order]))


@pytest.mark.parametrize("rate_Hz", [25.0, 500.0])
@pytest.mark.parametrize("lag_s", [0.0, 0.01, 0.1])
def test_low_passed_currents_are_named(
    tmp_path: Path, arm: Stranger, rate_Hz: float, lag_s: float
) -> None:
    log = written(arm, tmp_path, rate_Hz)
    if lag_s:
        back = np.exp(-log.period_s / lag_s)
        begin = back * log.current[None, 0]
        passed, _ = lfilter([1.0 - back], [1.0, -back], log.current, axis=0, zi=begin)
        log = replace(log, current=passed)
    if lag_s < 0.1:
        check(arm, log)
    else:
        with pytest.raises(LogError, match="low-pass of about 100 ms"):
            check(arm, log)
