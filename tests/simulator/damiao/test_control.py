"""Motion of Damiao motors after a command, held against the equations of the plant."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from simulator.damiao.models import MODELS, DamiaoMake
from tests.simulator.damiao.one_motor import CAN_ID, DISABLE, ENABLE, JOINT, MASTER_ID, ZERO, One

RUBBED = replace(JOINT, motor_viscous=1.0, link_viscous=0.2)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("p", "kp", "t"), [(0.6, 40.0, 0.0), (-0.6, 20.0, 1.0), (0.0, 5.0, 1.5), (0.3, 100.0, -0.5)]
)
def test_an_impedance_comes_to_rest_where_it_carries_the_weight(p, kp, t, sign) -> None:
    """kp (p - theta) + t = gravity."""
    one = One(DamiaoMake("DM4340", MASTER_ID, motor_sign=sign, link_sign=sign), RUBBED)
    one.enable(1)
    one.run(5.0, lambda: one.mit(p, 0.0, kp, 2.0, t))
    assert abs(float(one.arm.plant.theta_dot[0])) < 5e-3
    assert kp * (p - sign * one.theta) + t == pytest.approx(sign * one.gravity, abs=0.03)


@pytest.mark.parametrize("model", MODELS)
def test_the_stiffest_impedance_is_stable_in_every_model(model) -> None:
    """The law acts at every step of the plant: at 1 kHz alone, kd = 5 would throw a light rotor."""
    one = One(DamiaoMake(model, MASTER_ID), replace(JOINT, half_gap=0.01))
    one.enable(1)
    one.run(1.0, lambda: one.mit(0.2, 0.0, 500.0, 5.0, 0.0))
    speeds = one.run(0.5, lambda: (one.mit(0.2, 0, 500.0, 5.0, 0), one.arm.plant.theta_dot[0])[1])
    assert np.abs(speeds).max() < 0.3
    assert one.theta == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("sign", [-1, 1])
def test_damping_alone_drags_to_a_velocity_until_it_is_off(sign) -> None:
    """kd (v - theta_dot) carries friction: theta_dot = kd v / (kd + friction)."""
    one = One(DamiaoMake("DM4310", MASTER_ID, motor_sign=sign), RUBBED)
    one.arm.plant.weigh(np.zeros(3))
    one.enable(1)
    one.run(1.0, lambda: one.mit(0.0, 2.0, 0.0, 4.0, 0.0))
    expected = 4.0 * 2.0 / (4.0 + 1.2)
    assert one.arm.plant.theta_dot[0] == pytest.approx(sign * expected, rel=0.01)
    _, _, velocity, torque = one.decode(one.mit(0.0, 2.0, 0.0, 4.0, 0.0))
    assert (velocity, torque) == pytest.approx((expected, 1.2 * expected), rel=0.02)
    one.ask(CAN_ID, DISABLE)
    one.run(0.3)
    assert one.arm.servo.current[0] == 0.0


@pytest.mark.parametrize("v", [-0.8, 0.5])
@pytest.mark.parametrize("model", MODELS)
def test_a_velocity_is_held_against_gravity(model, v) -> None:
    one = One(DamiaoMake(model, MASTER_ID))
    one.enable(3)
    one.run(1.0, lambda: one.velocity(v))
    assert one.arm.plant.theta_dot[0] == pytest.approx(v, abs=0.01)
    assert one.decode(one.velocity(v))[2] == pytest.approx(v, abs=0.02)
    one.run(1.0, lambda: one.velocity(0.0))
    stood = one.theta
    one.run(1.0, lambda: one.velocity(0.0))
    assert one.theta == pytest.approx(stood, abs=1e-4)


@pytest.mark.parametrize("sign", [-1, 1])
def test_every_rise_is_ramped_by_ACC_and_every_fall_by_DEC(sign) -> None:
    """rad/s of the rotor per millisecond."""
    one = One(DamiaoMake("DM4310", MASTER_ID, motor_sign=sign, link_sign=sign))
    one.write(4, 0.02)  # 2 rad/s2 at the output
    one.write(5, -0.05)  # 5
    one.enable(3)
    slopes = []
    for v in (0.6, -0.6, 0.0):
        one.velocity(v)
        references = []
        for _ in range(150):
            one.arm.advance(one.arm.now + 0.001)
            references.append(sign * float(one.arm.servo.reference[0]))
        slopes.append((references[60] - references[10]) / 0.050)
        one.run(0.3)
    assert slopes == pytest.approx([2.0, -5.0, 2.0])


def test_MAX_SPD_limits_velocity_commands(one: One) -> None:
    one.write(6, 12.0)  # of the rotor
    one.enable(3)
    one.run(0.5, lambda: one.velocity(1.0))
    assert one.arm.servo.reference[0] == pytest.approx(12.0 / 40.0)


@pytest.mark.parametrize(("limit", "v"), [(0.5, -1), (1.0, 1)])
def test_a_position_is_reached_no_faster_than_it_says(limit, v) -> None:
    one = One(DamiaoMake("DM4340", MASTER_ID))
    one.enable(2)
    frame = struct.pack("<ff", 1.2, np.copysign(limit, v))
    reference = one.arm.servo.reference
    asked = one.run(9.0, lambda: (one.ask(0x100 + CAN_ID, frame), float(reference[0]))[1])
    assert max(asked) == limit
    assert one.theta == pytest.approx(1.2, abs=2e-3)
    # KP_APR / gear [1/s] is the rate at which the rest of the way shrinks.
    one.ask(0x100 + CAN_ID, struct.pack("<ff", 1.0, 100.0))
    way = []
    for _ in range(300):
        one.arm.advance(one.arm.now + 0.001)
        way.append(one.theta - 1.0)
    assert np.log(way[100] / way[250]) / 0.150 == pytest.approx(54.0 / 40.0, rel=0.1)


def test_a_hybrid_gives_no_more_than_its_share() -> None:
    one = One(DamiaoMake("DM4310", MASTER_ID))
    one.arm.plant.place(np.array([-1.0]))
    one.enable(4)
    frame = struct.pack("<fHH", 1.5, 200, 1000)  # a tenth
    one.ask(0x300 + CAN_ID, frame)
    currents = []
    for _ in range(50):
        one.arm.advance(one.arm.now + 0.001)
        currents.append(abs(float(one.arm.servo.current[0])))
    assert max(currents) == pytest.approx(0.1 * 10.261)


@pytest.mark.parametrize("mode", [1, 3])
def test_the_current_ends_at_OC_in_every_mode(mode) -> None:
    one = One(DamiaoMake("DM4310", MASTER_ID))
    one.write(3, 0.05)
    one.arm.plant.place(np.array([-1.5]))
    one.enable(mode)
    command = (lambda: one.velocity(5.0)) if mode == 3 else (lambda: one.mit(9, 0, 500, 0, 5))
    one.run(0.1, command)
    assert one.arm.servo.current[0] == pytest.approx(0.05 * 10.261)


def test_frames_of_another_mode_are_answered_and_not_carried_out(one: One) -> None:
    one.enable(3)
    one.run(0.2, lambda: one.velocity(0.0))
    stood = one.theta
    one.run(0.5, lambda: one.mit(2.0, 0.0, 400.0, 2.0, 0.0))
    assert one.theta == pytest.approx(stood, abs=1e-3)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_no_command(one: One, number) -> None:
    one.enable(3)
    one.run(0.3, lambda: one.velocity(0.3))
    one.run(0.1, lambda: one.velocity(number))
    assert one.arm.plant.theta_dot[0] == pytest.approx(0.3, abs=0.02)


def test_another_mode_begins_with_no_command() -> None:
    one = One(DamiaoMake("DM4310", MASTER_ID), RUBBED)
    one.enable(3)
    one.run(0.5, lambda: one.velocity(0.5))
    one.write(10, 1)
    assert one.arm.motors[0].status == 1
    one.run(0.05)
    assert one.arm.servo.current[0] == 0.0
    assert (one.arm._laws.positions, one.arm._laws.impedances) == (0, 1)
    one.write(10, 2)
    assert (one.arm._laws.positions, one.arm._laws.impedances) == (1, 0)
    one.write(10, 3)
    assert (one.arm._laws.positions, one.arm._laws.impedances) == (0, 0)
    one.run(0.5)
    assert one.arm.plant.theta_dot[0] == pytest.approx(0.0, abs=1e-3)


def test_a_command_that_came_while_it_was_off_acts_from_its_enabling_on(one: One) -> None:
    one.write(10, 3)
    one.velocity(0.4)
    one.run(0.1)
    assert one.arm.servo.current[0] == 0.0
    one.ask(CAN_ID, ENABLE)
    one.run(0.5)
    assert one.arm.plant.theta_dot[0] == pytest.approx(0.4, abs=0.01)
    one.ask(CAN_ID, DISABLE)
    one.ask(CAN_ID, ENABLE)
    one.run(0.5)
    assert one.arm.plant.theta_dot[0] == pytest.approx(0.0, abs=0.01)


def test_a_zero_that_is_set_while_it_holds_does_not_move_it() -> None:
    one = One(DamiaoMake("DM4340", MASTER_ID), RUBBED)
    one.enable(2)
    one.run(3.0, lambda: one.ask(0x100 + CAN_ID, struct.pack("<ff", 0.5, 1.0)))
    held = one.theta
    one.ask(CAN_ID, ZERO)
    one.run(1.0)
    assert one.theta == pytest.approx(held, abs=3e-3)


def test_a_brake_holds_a_motor_that_is_off() -> None:
    one = One(DamiaoMake("DM4340", MASTER_ID), replace(JOINT, brake=True))
    one.arm.plant.place(np.array([1.0]))
    one.run(0.5)
    assert one.theta == pytest.approx(1.0)
    one.enable(1)
    one.run(0.5)
    assert one.theta < 0.7
