"""The velocity loops: ramps that arrive, limits that do not wind up, limp motors."""

import numpy as np
import pytest

from simulator.description import ArmDescription
from simulator.servo import SERVO_PERIOD_S, Servo

LINK = np.full(7, 0.01)
AT_REST = np.zeros(7)


@pytest.fixture
def servo(romeo: ArmDescription) -> Servo:
    return Servo(romeo, LINK)


@pytest.mark.parametrize("start", [0.7, -0.3, 1e-7])
def test_a_ramp_is_straight_and_arrives_exactly(servo: Servo, start: float) -> None:
    servo.energise(0, start)
    servo.ramp(0, 0.0, 10.0)
    values = []
    while not servo.arrived(0):
        servo.update(AT_REST)
        values.append(float(servo.reference[0]))
    assert len(values) == pytest.approx(abs(start) / 0.01, abs=1.01)
    assert np.abs(np.diff(values[:-1])) == pytest.approx(0.01)
    assert servo.reference[0] == 0.0


def test_a_setpoint_takes_the_interpolation_period(servo: Servo) -> None:
    servo.energise(0, 0.2)
    servo.follow(0, 0.5, over_s=0.010)
    values = [0.2]
    for _ in range(12):
        servo.update(AT_REST)
        values.append(float(servo.reference[0]))
    assert values[:11] == pytest.approx(np.linspace(0.2, 0.5, 11))
    assert values[11:] == pytest.approx([0.5, 0.5])


def test_limit_does_not_wind_up(servo: Servo) -> None:
    """Two seconds against a wall, then free: the current turns round at once."""
    servo.energise(0, 0.0)
    servo.follow(0, 1.0, over_s=0.0)
    for _ in range(2000):
        servo.update(AT_REST)
    assert servo.current[0] == 4.0
    assert servo.saturated(0)
    fast = np.full(7, 1.5)
    for _ in range(5):
        servo.update(fast)
    assert servo.current[0] < 4.0
    assert not servo.saturated(0)


def test_only_the_energised_have_current(servo: Servo) -> None:
    servo.energise(1, 0.0)
    servo.follow(1, 0.3, over_s=0.0)
    servo.follow(2, 0.3, over_s=0.0)
    servo.update(AT_REST)
    assert np.flatnonzero(servo.current).tolist() == [1]
    servo.release(1)
    servo.update(AT_REST)
    assert not servo.current.any()


def test_a_slew_rises_and_falls_at_rates_of_its_own(servo: Servo) -> None:
    servo.energise(0, 0.0)
    for velocity, rate in ((0.5, 2.0), (-0.5, -5.0)):
        servo.slew(0, velocity, 2.0, 5.0)
        before = float(servo.reference[0])
        for _ in range(20):
            servo.update(AT_REST)
        assert servo.reference[0] - before == pytest.approx(0.02 * rate)


def test_gains_can_be_others(servo: Servo) -> None:
    servo.energise(0, 0.0)
    servo.tune(0, 0.5, 10.0)
    servo.follow(0, 0.2, 0.0)
    currents = []
    for _ in range(3):
        servo.update(AT_REST)
        currents.append(float(servo.current[0]))
    assert currents == pytest.approx([0.5 * 0.2 + 10.0 * 0.001 * 0.2 * k for k in (1, 2, 3)])


def test_a_stop_is_held_by_a_spring_and_a_damper(servo: Servo, romeo: ArmDescription) -> None:
    servo.energise(0, 0.0)
    for _ in range(50):
        servo.update(np.full(7, -0.01))
    turned = 0.01 * 50 * SERVO_PERIOD_S
    held = servo.stiffness[0] * turned + servo.damping[0] * 0.01
    assert servo.current[0] * romeo.joints[0].torque_constant == pytest.approx(held)
    assert servo.stiffness[0] == pytest.approx(20.0 * servo.damping[0])
