"""A Damiao motor: power, errors, time-out, and what it measures."""

import struct
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.damiao import motor as m
from simulator.damiao.models import DamiaoMake
from simulator.sensors import Readings
from tests.examples import scaled
from tests.simulator.damiao.one_motor import (
    CAN_ID,
    CLEAR,
    DISABLE,
    ENABLE,
    JOINT,
    MASTER_ID,
    NOMINAL,
    ZERO,
    One,
    as_float,
)

REFRESH = bytes([CAN_ID, 0, 0xCC, 0, 0, 0, 0, 0])
STANDING = struct.pack("<f", 0.0)


def status(one: One) -> int:
    return one.ask(0x7FF, REFRESH)[0] >> 4


def test_a_motor_sends_nothing_by_itself(one: One) -> None:
    one.enable(3)
    one.frames.clear()
    one.run(0.5)
    assert one.frames == []


@pytest.mark.parametrize("offset", [0x000, 0x100, 0x200, 0x300, 0x400])
def test_special_frames_are_for_the_low_byte(one: One, offset) -> None:
    for frame, then in ((ENABLE, 1), (ENABLE, 1), (DISABLE, 0), (ENABLE, 1), (CLEAR, 0)):
        answer = one.ask(CAN_ID + offset, frame)
        assert answer[0] == then << 4 | CAN_ID


@pytest.mark.parametrize(
    ("events", "after"),
    [
        ([], 0), ([ENABLE], 1), ([ENABLE, 0xE], 0xE), ([0xB, ENABLE], 0xB), ([0xB, DISABLE], 0xB),
        ([0xB, CLEAR], 0), ([0xB, CLEAR, ENABLE], 1), ([ENABLE, 0xA, CLEAR], 0),
        ([ENABLE, CLEAR], 0), ([0x8, 0x9], 0x9),
    ],
)  # fmt: skip
def test_commands_and_errors_decide_the_status(one: One, events, after) -> None:
    for event in events:
        if isinstance(event, int):
            one.motor.fail(event)
        else:
            one.ask(CAN_ID, event)
    one.arm.advance(one.arm.now + 0.01)
    assert status(one) == one.motor.status == after
    assert (one.arm.servo.current[0] != 0.0) == (after == 1 and one.gravity != 0.0)


def test_an_error_returns_until_its_cause_is_over(one: One) -> None:
    one.motor.trouble = m.OVERLOAD
    one.enable(3)
    one.arm.advance(one.arm.now + 0.002)
    for _ in range(2):
        assert status(one) == m.OVERLOAD
        one.ask(CAN_ID, CLEAR)
        one.arm.advance(one.arm.now + 0.002)
    one.motor.trouble = 0
    one.ask(CAN_ID, CLEAR)
    one.arm.advance(one.arm.now + 0.002)
    assert status(one) == 0


@pytest.mark.parametrize(
    ("cob_id", "data", "feeds"),
    [
        (0x200 + CAN_ID, STANDING, True),
        (CAN_ID, bytes(8), True),  # another mode's
        (0x700 + CAN_ID, b"", True),
        (CAN_ID, ENABLE, True),
        (0x7FF, REFRESH, False),
        (0x7FF, bytes([CAN_ID, 0, 0x33, 21, 0, 0, 0, 0]), False),
        (0x200 + CAN_ID + 1, STANDING, False),
    ],
)
def test_the_time_out_is_fed_by_frames_of_commands_alone(one: One, cob_id, data, feeds) -> None:
    one.write(9, 1000)  # 50 ms
    one.enable(3)
    for _ in range(7):
        one.arm.advance(one.arm.now + 0.04)
        one.send(cob_id, data)
    assert status(one) == (1 if feeds else m.LOST)


def test_the_time_out_is_counted_in_50_us_and_ends_limp(one: One) -> None:
    one.write(9, 8000)  # 400 ms
    one.enable(3)
    one.velocity(0.3)
    one.arm.advance(one.arm.now + 0.399)
    assert status(one) == 1
    assert one.arm.servo.current[0] != 0.0
    one.arm.advance(one.arm.now + 0.003)
    assert one.arm.servo.current[0] == 0.0
    assert one.velocity(0.3)[0] >> 4 == status(one) == m.LOST
    one.run(0.1)
    assert one.arm.servo.current[0] == 0.0
    one.ask(CAN_ID, CLEAR)
    one.enable(3)
    one.run(0.02)
    assert status(one) == 1
    assert one.arm.servo.target[0] == 0.0  # the last command is gone


@pytest.mark.parametrize("timeout", [0, 1000])
def test_without_a_time_out_or_power_silence_is_no_error(one: One, timeout) -> None:
    one.write(9, timeout)
    if not timeout:
        one.enable(3)
    one.run(2.0)
    assert status(one) == (0 if timeout else 1)


def test_a_silent_motor_ignores_frames_and_times_out(one: One) -> None:
    one.write(9, 1000)
    one.enable(3)
    one.motor.silent = True
    for _ in range(10):
        one.arm.advance(one.arm.now + 0.01)
        assert one.send(0x200 + CAN_ID, STANDING) == one.send(0x7FF, REFRESH) == []
    one.motor.silent = False
    assert status(one) == m.LOST


def test_a_reset_shows_in_the_status_alone(one: One) -> None:
    one.write(9, 1000)
    one.enable(3)
    one.frames.clear()
    one.motor.boot()
    assert one.frames == []
    assert status(one) == 0
    assert one.read(9) == bytes(4)
    assert one.read(10)[0] == 1


# --- measurements ---------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("where", [-2.9, -0.4, 0.0, 1.3])
def test_positions_are_of_rotor_and_output_in_the_motors_sense(sign, where) -> None:
    make = DamiaoMake("DM4310", MASTER_ID, motor_sign=sign, link_sign=sign, offset=0.2)
    one = One(make, replace(JOINT, half_gap=0.02))
    one.arm.plant.place(np.array([where]), np.array([0.015]))
    one.motor.boot()
    one.arm.advance(one.arm.now + 0.00025)
    p_m, xout = as_float(one.read(80)), as_float(one.read(81))
    assert p_m == pytest.approx(sign * (where - 0.015 - 0.2), abs=1e-4)
    assert xout == pytest.approx(sign * (where - 0.2), abs=4e-4)
    assert one.decode(one.ask(CAN_ID, DISABLE))[1] == pytest.approx(p_m, abs=3e-4)


def test_turns_of_the_output_are_counted_and_forgotten_by_a_reset(one: One) -> None:
    one.arm.plant.place(np.array([5.0]))
    one.run(0.01)
    before = as_float(one.read(81))
    one.motor.boot()
    assert before == pytest.approx(float(one.arm.plant.q[0]), abs=1e-3)
    for register in (80, 81):
        assert as_float(one.read(register)) == pytest.approx(before - 2 * np.pi, abs=2e-3)


def test_a_zero_is_of_both_encoders_and_outlives_a_reset(one: One) -> None:
    one.arm.plant.place(np.array([0.7]))
    one.run(0.01)
    there = float(one.arm.plant.q[0])
    assert abs(one.decode(one.ask(CAN_ID, ZERO))[1]) < 3e-4
    one.motor.boot()
    one.arm.plant.place(np.array([there + 0.3]))
    one.run(0.01)
    moved = float(one.arm.plant.q[0]) - there
    for register in (80, 81):
        assert as_float(one.read(register)) == pytest.approx(moved, abs=1e-3)


def test_beyond_the_range_a_feedback_stands_at_its_end(one: One) -> None:
    one.write(21, 0.5)
    one.arm.plant.place(np.array([0.9]))
    one.run(0.01)
    assert one.ask(CAN_ID, DISABLE)[1:3] == b"\xff\xff"
    assert as_float(one.read(80)) == pytest.approx(0.9, abs=0.01)


def test_velocity_and_torque_lag_by_a_filter_of_40_Hz(one: One) -> None:
    one.enable(1)
    one.arm.plant.weigh(np.zeros(3))
    one.mit(0.0, 0.0, 0.0, 0.0, 4.0)
    shares = []
    for _ in range(12):
        one.arm.advance(one.arm.now + 0.001)
        shares.append(one.decode(one.ask(0x7FF, REFRESH))[3] / 4.0)
    lag = 1.0 / (2 * np.pi * 40.0)
    expected = 1.0 - np.exp(-np.arange(1, 13) * 0.001 / lag)
    assert shares == pytest.approx(expected, abs=0.01)
    # Of an even acceleration, the filtered velocity is late by the lag.
    start, seen = one.arm.now, []
    for _ in range(30):
        one.arm.advance(one.arm.now + 0.001)
        true = float(one.arm.plant.theta_dot[0])
        seen.append(true - one.decode(one.ask(0x7FF, REFRESH))[2])
    acceleration = true / (start + 0.030)
    assert np.mean(seen[-10:]) == pytest.approx(acceleration * lag, rel=0.2)


def test_the_reported_torque_is_wrong_by_the_torque_constant() -> None:
    """With another torque constant than the maker's it is wrong by as much."""
    wrong = msgspec.structs.replace(NOMINAL, torque_constant=20)
    one = One(DamiaoMake("DM4340", MASTER_ID), mismatch=wrong)
    one.arm.plant.place(np.array([1.0]))
    one.enable(3)
    for _ in range(100):
        one.arm.advance(one.arm.now + 0.01)
        answer = one.velocity(0.0)
    share = one.gravity / one.decode(answer)[3]
    assert abs(share - 1.0) == pytest.approx(0.2, abs=0.01)


def test_temperatures_are_two_bytes(one: One) -> None:
    one.motor.degC = (71.9, 128.0)
    assert one.ask(CAN_ID, DISABLE)[6:] == bytes([71, 128])


def test_frozen_encoders_stand_while_the_arm_falls(one: One) -> None:
    one.arm.plant.place(np.array([0.7]))
    one.run(0.01)
    one.motor.frozen = True
    before = one.ask(0x7FF, REFRESH)[1:3], one.read(80), one.read(81)
    one.run(0.2)
    assert (one.ask(0x7FF, REFRESH)[1:3], one.read(80), one.read(81)) == before


def test_sensors_can_be_replaced_as_those_of_other_drives(one: One) -> None:
    one.arm.sense = lambda *_: Readings([4096], [0], [0], [0])
    one.run(0.01)
    assert as_float(one.read(81)) == pytest.approx(np.pi / 2)


FRAMES = st.tuples(
    st.one_of(
        st.sampled_from([0x7FF, *(CAN_ID + 0x100 * family for family in range(8))]),
        st.integers(0, 0x7FF),
    ),
    st.one_of(
        st.sampled_from([ENABLE, DISABLE, ZERO, CLEAR, REFRESH]),
        st.binary(max_size=8),
        st.builds(
            lambda what, register, raw: bytes([CAN_ID, 0, what, register]) + raw,
            st.sampled_from([0x33, 0x55, 0xAA, 0xCC]),
            st.integers(0, 90).filter(lambda n: n not in (7, 8)),
            st.binary(min_size=4, max_size=4),
        ),
    ),
)


@given(st.lists(FRAMES, max_size=30))
@settings(max_examples=scaled(60))
def test_a_motor_answers_a_refresh_after_any_frames(frames) -> None:
    one = One(DamiaoMake("DM4340", MASTER_ID), replace(JOINT, half_gap=0.005))
    for cob_id, data in frames:
        assert len(one.send(cob_id, data)) <= 1
        one.arm.advance(one.arm.now + 0.002)
    assert one.ask(0x7FF, REFRESH)[0] & 0xF == CAN_ID
    assert np.isfinite([*one.arm.plant.q, *one.arm.plant.theta_dot]).all()
