"""Frames of Damiao motors, against bytes that public clients send and understand.

Sources: enactic/openarm_can (C++), jia-xie/python-damiao-driver, cmjang/DM_Control_Python.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rigs.lockstep import OPENARM
from daemon.config.load import load_robot
from drivers.damiao.frames import (
    CLEAR_ERROR,
    DISABLE,
    ENABLE,
    Feedback,
    Register,
    feedback_of,
    read,
    refresh,
    register_of,
    setpoint,
    setpoint_of,
    value_of,
    write,
)
from drivers.damiao.language import DamiaoLanguage
from drivers.motors.language import Feedback as Spoken
from drivers.motors.language import State, steps_of

DRIVES = load_robot(OPENARM).configuration.joint_drives
DM4310 = DRIVES[4].profile
LANGUAGE = DamiaoLanguage(DRIVES)


@pytest.mark.parametrize(
    ("frame", "wanted"),
    [
        ((0, ENABLE), (0, "FFFFFFFFFFFFFFFC")),
        ((0, DISABLE), (0, "FFFFFFFFFFFFFFFD")),
        ((0, CLEAR_ERROR), (0, "FFFFFFFFFFFFFFFB")),
        (refresh(0x03), (0x7FF, "0300CC0000000000")),
        (refresh(0x103), (0x7FF, "0301CC0000000000")),
        (read(0x01, Register.OUTPUT_POSITION), (0x7FF, "0100335100000000")),
        (read(0x07, Register.POSITION_MAX), (0x7FF, "0700331500000000")),
        (write(0x01, Register.MODE, 3), (0x7FF, "0100550A03000000")),
        (write(0x02, Register.TIMEOUT, 2000), (0x7FF, "02005509D0070000")),
        (write(0x01, Register.VELOCITY_MAX, 30.0), (0x7FF, "010055160000F041")),
    ],
)
def test_commands_are_byte_equal_to_those_of_public_clients(frame, wanted) -> None:
    assert (frame[0], bytes(frame[1]).hex().upper()) == wanted


# Position, velocity, stiffness, damping and torque as clients give them, and their frame.
@pytest.mark.parametrize(
    ("asked", "wanted"),
    [
        ((0x7FFF, 0x7FF, 0, 0), "7FFF7FF0000007FF"),
        ((0xFFFF, 0x7FF, 0xFFF, 0xFFF), "FFFF7FFFFFFFF7FF"),
        ((0x8000, 0x801, 0x333, 0x0CC), "80008013330CC7FF"),
    ],
)
def test_a_setpoint(asked: tuple[int, int, int, int], wanted: str) -> None:
    data = bytearray(8)
    position, velocity, *gains = asked
    setpoint(data, position, velocity, (gains[0], gains[1]))
    assert data.hex().upper() == wanted
    assert setpoint_of(data) == asked


@given(*(st.integers(0, most) for most in (0xFFFF, 0xFFF, 0xFFF, 0xFFF)))
def test_a_setpoint_is_unpacked_as_it_was_packed(p: int, v: int, kp: int, kd: int) -> None:
    data = bytearray(8)
    setpoint(data, p, v, (kp, kd))
    assert setpoint_of(data) == (p, v, kp, kd)


def test_a_command_is_no_setpoint() -> None:
    assert [setpoint_of(each) for each in (ENABLE, DISABLE, CLEAR_ERROR, b"\0\0")] == [None] * 4


def test_a_feedback_of_a_public_client() -> None:
    # DM4310, id 1, enabled, at 0 rad, 0 rad/s, 0 Nm, 30 and 28 degC: the middle of all ranges.
    found = feedback_of(1, bytes.fromhex("117FFF7FF7FF1E1C"))
    assert found == Feedback(1, 0x7FFF, 0x7FF, 0x7FF, 30, 28)
    position, velocity, torque = steps_of(DM4310, DamiaoLanguage.bits)
    assert (found.position - 0xFFFF / 2.0) * position == pytest.approx(0.0, abs=2e-4)
    assert position == pytest.approx(0.38e-3, rel=0.01)
    assert velocity == pytest.approx(14.7e-3, rel=0.01)
    assert torque == pytest.approx(4.9e-3, rel=0.01)


@given(
    st.integers(0, 15), st.integers(0, 15), st.integers(0, 0xFFFF), st.integers(0, 0xFFF),
    st.integers(0, 0xFFF), st.integers(0, 255), st.integers(0, 255),
)  # fmt: skip
def test_a_feedback_is_unpacked_as_it_was_packed(status, motor, p, v, t, bridge, coil) -> None:
    packed = status << 60 | motor << 56 | p << 40 | v << 28 | t << 16 | bridge << 8 | coil
    found = feedback_of(0x40 | motor, packed.to_bytes(8, "big"))
    assert found == Feedback(status, p, v, t, bridge, coil)


@given(st.binary(max_size=7))
def test_a_short_feedback_is_none(data: bytes) -> None:
    assert feedback_of(1, data) is None


@given(st.integers(1, 15), st.binary(min_size=8, max_size=8))
def test_a_feedback_is_of_one_motor(motor: int, data: bytes) -> None:
    assert (feedback_of(motor, data) is None) is (data[0] & 0xF != motor)


@pytest.mark.parametrize(
    ("nibble", "state"),
    [(0, State.OFF), (1, State.ON), (8, State.FAILED), (13, State.FAILED), (2, State.UNKNOWN),
     (15, State.UNKNOWN)],
)  # fmt: skip
def test_statuses(nibble: int, state: State) -> None:
    found = LANGUAGE.answer_of(0, 0x11, bytes([nibble << 4 | 1]) + bytes(7))
    assert isinstance(found, Spoken)
    assert found.status.state is state
    assert found.status.missed_us is (nibble == 13)


@pytest.mark.parametrize(
    ("motor", "data", "register"),
    [
        (1, "0100335100000000", 81),
        (1, "0100550A03000000", 10),
        (2, "0100335100000000", None),  # another motor's
        (1, "1100335100000000", None),  # a feedback of an enabled one
        (1, "01003351", None),  # cut short
    ],
)
def test_an_answer_about_a_register(motor: int, data: str, register: int | None) -> None:
    assert register_of(motor, bytes.fromhex(data)) == register


def test_values_of_registers() -> None:
    assert value_of(Register.SERIAL, bytes.fromhex("0100330F78563412")) == 0x12345678
    assert value_of(Register.POSITION_MAX, bytes.fromhex("0100331500004841")) == 12.5
    assert math.isnan(value_of(Register.POSITION_MAX, bytes.fromhex("01003315FFFFFFFF")))


@given(st.sampled_from(list(Register)), st.integers(0, 2**24))
def test_a_written_value_reads_the_same(register: Register, value: int) -> None:
    assert value_of(register, bytes(write(5, register, value)[1])) == value
