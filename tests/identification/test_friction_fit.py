"""Uncertainty of friction, and how long a motion would make it smaller."""

from dataclasses import replace

import numpy as np
import pytest

from identification.friction_errors import with_steps
from identification.friction_fit import WIDE, FrictionFit
from identification.friction_verdict import Verdict

T, DT = 0.01, 5e-5  # [s] of setpoints, and of the simulated motor
VISCOUS = 0.05  # Nm s/rad


def fit(noise: float, stays: float, coulomb: float = 1.0, viscous: float = 0.5) -> FrictionFit:
    """Friction of a motion of 60 s, Coulomb's with errors by noise and by what stays [Nm]."""
    return FrictionFit(
        joint="a", verdict=Verdict.GOOD, reason="",
        values={"K_theta_s": coulomb, "K_theta_v": viscous},
        errors={"K_theta_s": float(np.hypot(noise, stays)), "K_theta_v": 0.001},
        noise={"K_theta_s": noise, "K_theta_v": 0.001},
        seconds=60.0, r2=1.0, condition=1.0, gravity_scale=1.0, gravity_change=1.0, offset=0.0,
        rotor_doubt="", stiction=0.0, stiction_error=1.0, load_bound=0.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("noise", "stays", "seconds"),
    [
        (0.04, 0.0, 65.6),  # 0.0383 are allowed
        (0.08, 0.0, 262.3),  # four times as long: half
        (0.08, 0.03, 680.2),
        (0.08, 0.0383, np.inf),
        (0.0, 0.1, np.inf),
        (0.01, 0.0, 4.1),
    ],
)
def test_a_longer_motion_takes_off_noise_and_no_more(noise, stays, seconds):
    one = fit(noise, stays)
    assert one.seconds_for(WIDE) == pytest.approx(seconds, rel=0.01)
    if np.isfinite(seconds):
        assert one.uncertainty_after(one.seconds_for(WIDE)) == pytest.approx(WIDE)
    assert one.uncertainty_after(1e9) == pytest.approx(3.92 * stays, abs=1e-4)


def test_viscous_friction_that_hardly_matters_is_no_reason():
    assert fit(0.01, 0.0, viscous=0.0).uncertainty == pytest.approx(3.92 * 0.01)


@pytest.mark.parametrize(
    ("scale", "change", "off"),
    [(0.88, 0.05, 0.0), (0.88, 2.0, 0.24), (1.25, 4.0, 1.0), (1.0, 9.0, 0.0), (np.nan, 9.0, 0.0)],
)
def test_gravity_that_is_off_by_little_of_the_friction_is_not_off(scale, change, off):
    one = replace(fit(0.01, 0.0), gravity_scale=scale, gravity_change=change)
    assert one.gravity_off == pytest.approx(off)


def test_what_is_printed_is_half_of_a_95_percent_interval():
    assert fit(0.05, 0.0).half_interval("K_theta_s") == pytest.approx(0.098)


def sampled(velocity: float, inertia: float, kp: float, kd: float, phase: float) -> float:
    """Torque [Nm], filtered by 40 Hz, at that phase of a period of a motor that goes at a velocity
    by a position that steps once a period."""
    p = q = speed = shown = torque = 0.0
    for k in range(120 * round(T / DT)):
        if k % round(T / DT) == 0:
            p += velocity * T
        torque = kp * (p - q) + kd * (velocity - speed)
        speed += DT * (torque - VISCOUS * speed) / inertia
        q += DT * speed
        shown += (torque - shown) * DT / 0.004
        if k == 119 * round(T / DT) + round(phase * T / DT) - 1:
            return shown
    return shown


@pytest.mark.parametrize("inertia", [0.001, 0.02, 0.5])
@pytest.mark.parametrize(("kp", "kd"), [(36.0, 5.0), (173.0, 11.0)])
@pytest.mark.parametrize("phase", [0.6, 1.0])
def test_a_motor_rubs_within_the_interval(
    inertia: float, kp: float, kd: float, phase: float
) -> None:
    found = sampled(1.0, inertia, kp, kd, phase)
    (new,) = with_steps([fit(0.01, 0.0, viscous=found)], np.array([kp * T]))
    assert abs(found - VISCOUS) <= new.half_interval("K_theta_v")
    assert new.errors["K_theta_s"] == 0.01
    assert not new.rotor_trusted
    assert with_steps([fit(0.01, 0.0)], np.zeros(1)) == [fit(0.01, 0.0)]
