"""Torque that a motor reports against the one it was asked for, where friction holds it."""

import numpy as np
import pytest

from identification.motion_log import MotionLog
from identification.motor_torque import reported_by_asked
from identification.wiring import WiringResult, with_torque_range
from programs.identify.motions import WIRING_SPEED, strokes

PERIOD_S, STIFFNESS, DAMPING, Nm_per_A = 0.01, 60.0, 4.0, 0.8
COUNT, FINE = 3.8e-4, 20  # of a position [rad]; steps of a period in which the motor acts


def motor(
    ratio: float, phase: float, friction: float, load: float, noise: float = 0.002,
    shakes: float = 5e-4,
) -> MotionLog:  # fmt: skip
    """Strokes of a motor that takes a setpoint up a share of a period before it is sampled."""
    path = strokes(np.zeros(1), 0, 0.02, WIRING_SPEED, 3, PERIOD_S)
    u = np.gradient(path[:, 0], PERIOD_S)
    taken = np.repeat(np.concatenate([np.zeros(2), u]), FINE)[round((1.0 - phase) * FINE) :]
    p = np.cumsum(u) * PERIOD_S
    held = np.repeat(np.concatenate([np.zeros(2), p]), FINE)[round((1.0 - phase) * FINE) :]
    q, v, rows = load / STIFFNESS, 0.0, []
    for k in range(FINE * (len(u) - 2)):
        bent = STIFFNESS * (held[k] - q) + DAMPING * taken[k] - load
        v = np.sign(bent) * max(abs(bent) - friction, 0.0) / DAMPING
        q += v * PERIOD_S / FINE
        rows.append((q, v, STIFFNESS * (held[k] - q) + DAMPING * (taken[k] - v)))
    rng = np.random.default_rng(3)
    q, v, torque = (np.array(rows)[FINE - 1 :: FINE].T)[:, :, None]
    return MotionLog(
        joints=("upright",),
        time_s=PERIOD_S * np.arange(len(q)),
        current=(ratio * torque + rng.normal(0.0, noise, q.shape)) / Nm_per_A,
        link_position=np.round(q / COUNT) * COUNT,
        motor_velocity=v + rng.normal(0.0, shakes, v.shape),
        setpoint=u[: len(q), None],
    )


@pytest.mark.parametrize("ratio", [1.0, 14 / 17, 17 / 14, 36 / 60])
@pytest.mark.parametrize("phase", [0.05, 0.5, 0.95])
@pytest.mark.parametrize("load", [0.0, 0.6])
def test_the_ratio_lies_within_its_error(ratio, phase, load):
    found, error = reported_by_asked(
        motor(ratio, phase, 0.25, load), 0, STIFFNESS, DAMPING, Nm_per_A
    )
    assert abs(found - ratio) <= error + 0.03 * ratio
    assert 0.01 < error < 0.06, "neither tick alone"


@pytest.mark.parametrize(
    ("friction", "noise"), [(0.0, 0.002), (0.005, 0.002), (0.6, 0.6), (0.25, 0.1)]
)
def test_a_motor_that_works_against_nothing_or_is_not_heard_shows_none(friction, noise):
    log = motor(1.0, 0.5, friction, 0.3, noise)
    found = reported_by_asked(log, 0, STIFFNESS, DAMPING, Nm_per_A)
    assert found[1] > 0.06


def test_a_velocity_that_shakes_changes_no_ratio():
    found, error = reported_by_asked(
        motor(1.0, 0.5, 0.25, 0.0, shakes=0.015), 0, STIFFNESS, DAMPING, Nm_per_A
    )
    assert abs(found - 1.0) <= error + 0.01


def test_setpoints_are_needed():
    log = motor(1.0, 0.5, 0.25, 0.0)
    without = MotionLog(log.joints, log.time_s, log.current, log.link_position, log.motor_velocity)
    assert reported_by_asked(without, 0, STIFFNESS, DAMPING, Nm_per_A)[1] == np.inf


@pytest.mark.parametrize(
    ("ratio", "error", "problems", "notes"),
    [
        (1.0, 0.02, 0, 0), (0.88, 0.03, 0, 0), (14 / 17, 0.06, 1, 0), (17 / 14, 0.06, 1, 0),
        (0.6, 0.07, 0, 1), (np.nan, np.inf, 0, 1),
    ],
)  # fmt: skip
def test_a_range_is_wrong_right_or_not_checked(ratio, error, problems, notes):
    found = with_torque_range(WiringResult(joint="upright", problems=()), ratio, error)
    assert (len(found.problems), len(found.notes)) == (problems, notes)
