"""Friction of a measured industrial arm, whose wrist is coupled: nine seconds of a TX40."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from common.errors import LogError
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission
from identification.friction import identify_friction
from identification.friction_fit import FrictionFit
from identification.friction_verdict import Verdict
from identification.masses import MassesVerdict, identify_masses
from identification.motion_log import MotionLog

DATA = Path(os.environ.get("CONTACTD_DATA", Path(__file__).parents[3] / "shared" / "data"))
GEAR = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
ZERO = np.array([0.0, -0.5, 0.5, 0.0, 0.0, 0.0]) * np.pi
COULOMB = (7.14, 8.26, 6.34, 2.48)
"""Published, joints 1 to 4 [Nm]"""
VISCOUS = (8.05, 5.53, 1.97, 1.11)
JOINTS = tuple(f"joint_{i}" for i in range(1, 7))


def column(name: str) -> np.ndarray:
    path = DATA / "tx40" / f"{name}.csv.gz"
    if not path.exists():
        pytest.skip(f"no real measurements at {DATA} (set CONTACTD_DATA)")
    return np.loadtxt(path, delimiter=",", skiprows=1)


@pytest.fixture(scope="module")
def log() -> MotionLog:
    """At 100 Hz, without what is faster."""
    slow = butter(4, 30.0 / 2500.0)
    q = filtfilt(*slow, column("pos_read_data") / GEAR + ZERO, axis=0)
    current = filtfilt(*slow, np.sign(GEAR) * column("curr_data"), axis=0)
    q_dot = np.gradient(q, 1.0 / 5000.0, axis=0)
    time_s = np.arange(len(q)) / 5000.0
    return MotionLog(JOINTS, *(values[::50] for values in (time_s, current, q, q_dot, q)))


def known() -> tuple[Model, Transmission, EstimatorSettings]:
    urdf = (DATA / "tx40" / "tx40.urdf").read_text()
    begin = urdf.rindex("<inertia ")  # rounded to zero
    end = urdf.index("/>", begin)
    body = '<inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"'
    none = np.zeros(6)
    guess = Transmission(
        joints=JOINTS, torque_constant=np.abs(GEAR), rotor_inertia=none + 0.1, half_gap=none,
        motor_coulomb=none + 4.0, motor_viscous=none + 3.0, link_coulomb=none, link_viscous=none,
    )  # fmt: skip
    settings = EstimatorSettings(current_delay_ms=0.0, motor_position="measured")
    model = Model(urdf[:begin] + body + urdf[end:], JOINTS)
    return model, guess, settings


def identified(log: MotionLog, shortest_s: float) -> list[FrictionFit]:
    model, guess, settings = known()
    return identify_friction(log, model, guess, settings, np.full(6, 10.0), shortest_s)[0]


def test_nine_seconds_are_enough_only_by_request(log):
    with pytest.raises(LogError, match=r"too short: 9\.0 s, at least 10 s"):
        identified(log, 10.0)


def test_friction_is_as_published_and_the_coupled_wrist_is_refused(log):
    fits = identified(log, 9.0)
    for fit, coulomb, viscous in zip(fits, COULOMB, VISCOUS, strict=False):
        assert fit.verdict is Verdict.GOOD, fit
        assert fit.values["K_theta_s"] == pytest.approx(coulomb, rel=0.15), fit
        assert fit.values["K_theta_v"] == pytest.approx(viscous, rel=0.15), fit
        for name, published in (("K_theta_s", coulomb), ("K_theta_v", viscous)):
            assert abs(fit.values[name] - published) < fit.half_interval(name), fit
    for fit, other in ((fits[4], "joint_6"), (fits[5], "joint_5")):
        assert fit.verdict is Verdict.COUPLED, fit
        assert f"follows the motion of {other}" in fit.reason


def test_nine_seconds_are_too_few_for_masses(log):
    """By their length; and by request, because of the coupled wrist. The joints that carry most
    would be better by a third on motion that was not fitted."""
    model, guess, settings = known()
    more = (np.full(6, 10.0), (model.lower, model.upper))
    with pytest.raises(LogError, match=r"too short: 9\.0 s, at least 20 s"):
        identify_masses(log, model, guess, settings, *more)
    found = identify_masses(log, model, guess, settings, *more, 9.0)
    assert not found.usable
    assert [fit.verdict for fit in found.fits[4:]] == [MassesVerdict.COUPLED] * 2
    assert found.fits[1].by_this < 0.7 * found.fits[1].by_urdf
