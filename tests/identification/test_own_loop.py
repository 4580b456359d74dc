"""Rotors of drives that step, by currents that are sampled when much of them is over."""

from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from daemon.config.load import load_robot
from identification.log_intervals import Intervals, intervals
from identification.motion_log import MotionLog
from identification.own_loop import rotors_of_whole_periods

PERIOD, STEP, DELAY = 0.01, 1e-4, 0.003
CONSTANT = 2.0  # [Nm/A]


def stepped(rotor: float, w: float, seed: int, *, noise: float = 0.0) -> MotionLog:
    """Log of a rotor [kg m2] with Coulomb friction, whose drive's loop of w [rad/s] takes each
    setpoint as a step, one SYNC after it was sent."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(2500)
    setpoint = 0.3 * np.sin(2 * np.pi * 0.5 * t) + 0.15 * np.sin(2 * np.pi * 0.9 * t + 1.0)
    gain = rotor * w / CONSTANT
    theta = speed = integral = shown = 0.0
    rows = []
    for k in range(len(t)):
        rows.append((shown, speed, theta))
        asked = setpoint[k - 1] if k else 0.0
        for _ in range(round(PERIOD / STEP)):
            integral += (asked - speed) * STEP
            current = gain * ((asked - speed) + 20.0 * integral)
            speed += STEP / rotor * (CONSTANT * current - 0.1 * np.tanh(speed / 0.01))
            theta += STEP * speed
            shown += STEP / DELAY * (current - shown)
    found = np.array(rows)
    velocity = found[:, 1] + noise * rng.standard_normal(len(t))
    columns = [found[:, 0], found[:, 2], velocity, found[:, 2].copy(), setpoint]
    current, link, velocity, position, setpoint = (c[:, None] for c in columns)
    return MotionLog(("joint",), t, current, link, velocity, position, setpoint)


def rotor_of(log: MotionLog, fitted: float) -> float:
    robot = load_robot(SINGLE_JOINT)
    rows = intervals(log, robot.model, robot.configuration.estimator)

    def refit(rows: Intervals) -> np.ndarray:
        moving = np.abs(rows.theta_dot[:, 0]) > 0.03
        A = np.column_stack([rows.theta_ddot[:, 0], np.sign(rows.theta_dot[:, 0])])[moving]
        return np.linalg.lstsq(A, CONSTANT * rows.current[moving, 0], rcond=None)[0][:1]

    if not fitted:
        return float(refit(rows)[0])
    found = rotors_of_whole_periods(
        log, rows, np.array([fitted]), np.zeros(1), np.array([CONSTANT]), DELAY, refit
    )
    return float(found[0])


@pytest.mark.parametrize("w", [40.0, 100.0])
@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_what_was_over_when_it_was_sampled_is_added(w: float, noise: float) -> None:
    true = 0.07
    log = stepped(true, w, 3, noise=noise)
    sampled = rotor_of(log, 0.0)
    assert sampled < 0.92 * true
    assert rotor_of(log, sampled) == pytest.approx(true, rel=0.07)


def test_without_a_motors_position_its_velocity_serves() -> None:
    log = replace(stepped(0.07, 100.0, 3), motor_position=None)
    assert rotor_of(log, 0.05) == pytest.approx(0.07, rel=0.07)


def test_a_current_that_no_such_loop_makes_says_nothing() -> None:
    log = stepped(0.07, 100.0, 3)
    rng = np.random.default_rng(1)
    other = 0.5 * np.std(log.current) * rng.standard_normal(log.current.shape)
    assert np.isnan(rotor_of(replace(log, current=log.current + other), 0.05))
