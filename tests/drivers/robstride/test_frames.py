"""Frames of RobStride motors, against bytes that manuals print and public clients send.

Sources: the maker's EL05 and RS00 manuals and Python SDK, sirwart/robstride, kscalelabs/robstride.
"""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.wire import EXTENDED
from drivers.robstride import frames as f
from drivers.robstride.frames import Fault, Kind, Parameter


@pytest.mark.parametrize(
    ("frame", "wanted"),
    [
        (f.get_id(0x7F), (0x0000FD7F, "0000000000000000")),
        (f.enable(0x7F), (0x0300FD7F, "0000000000000000")),
        (f.stop(0x7F), (0x0400FD7F, "0000000000000000")),
        (f.clear(0x7F), (0x0400FD7F, "0100000000000000")),
        (f.read(0x7F, Parameter.POSITION), (0x1100FD7F, "1970000000000000")),
        (f.write(0x01, Parameter.MODE, 1), (0x1200FD01, "0570000001000000")),
        (f.write(0x7F, Parameter.TIMEOUT, 0), (0x1200FD7F, "2870000000000000")),
        (f.write(0x02, Parameter.TIMEOUT, 20_000), (0x1200FD02, "28700000204E0000")),
        (f.write(0x02, Parameter.TORQUE_LIMIT, 30.0), (0x1200FD02, "0B7000000000F041")),
    ],
)
def test_commands_are_byte_equal_to_those_of_manuals_and_clients(frame, wanted) -> None:
    assert (frame[0] & ~EXTENDED, bytes(frame[1]).hex().upper()) == wanted
    assert frame[0] & EXTENDED


@pytest.mark.parametrize(
    ("asked", "wanted"),
    [
        ((0x8000, 0x804C, 0, 0), "8000804C00000000"),  # 20 rpm of a rotor geared 9 : 1
        ((0xFFFF, 0x7FFF, 0x3333, 0x1999), "FFFF7FFF33331999"),
    ],
)
def test_a_setpoint(asked: tuple[int, int, int, int], wanted: str) -> None:
    data = bytearray(8)
    position, velocity, *gains = asked
    f.setpoint(data, position, velocity, (gains[0], gains[1]))
    assert data.hex().upper() == wanted
    assert f.setpoint_id(0x7F) == EXTENDED | 0x017FFF7F
    assert f.kind_of(f.setpoint_id(1)) == Kind.SETPOINT


@given(*[st.integers(0, 0xFFFF)] * 4)
def test_a_setpoint_is_unpacked_as_it_was_packed(p: int, v: int, kp: int, kd: int) -> None:
    data = bytearray(8)
    f.setpoint(data, p, v, (kp, kd))
    assert f.fields_of(data) == (p, v, kp, kd)


def test_a_feedback_of_a_public_client() -> None:
    can_id = EXTENDED | 0x02807FFD
    found = f.feedback_of(can_id, bytes.fromhex("80008000800000FA"))
    assert (f.kind_of(can_id), f.sender_of(can_id)) == (Kind.FEEDBACK, 0x7F)
    assert found == f.Feedback(0x80, 0x8000, 0x8000, 0x8000, pytest.approx(25.0))
    assert (f.mode_of(found.code), f.faults_of(found.code)) == (f.RUN, Fault(0))


@given(
    st.integers(0, 2), st.integers(0, 63), st.integers(1, 127), st.integers(0, 255),
    *[st.integers(0, 0xFFFF)] * 4,
)  # fmt: skip
def test_a_feedback_is_unpacked_as_it_was_packed(mode, faults, motor, host, p, v, t, c) -> None:
    can_id = EXTENDED | 2 << 24 | mode << 22 | faults << 16 | motor << 8 | host
    found = f.feedback_of(can_id, struct.pack(">HHHH", p, v, t, c))
    assert f.sender_of(can_id) == motor
    assert (f.mode_of(found.code), f.faults_of(found.code)) == (mode, faults)
    assert (found.position, found.velocity, found.torque) == (p, v, t)
    assert found.degC == pytest.approx(c / 10.0)


@given(st.binary(max_size=7))
def test_a_short_feedback_is_refused(data: bytes) -> None:
    with pytest.raises(struct.error):
        f.feedback_of(0, data)


def test_a_frame_of_11_bits_has_no_type() -> None:
    assert f.kind_of(0x200) == -1


@pytest.mark.parametrize(
    ("can_id", "data", "value"),
    [
        (0x110005FD, "0B7000000000F041", 30.0),
        (0x110105FD, "0B7000000000F041", None),  # the motor has none
        (0x110005FD, "197000000000F041", None),  # another one
        (0x110005FD, "0B70", None),
    ],
)
def test_values_of_parameters(can_id: int, data: str, value: float | None) -> None:
    found = f.read_value(Parameter.TORQUE_LIMIT, can_id | EXTENDED, bytes.fromhex(data))
    assert found == value


def test_a_byte_is_read_as_one() -> None:
    data = bytes.fromhex("05700000020000FF")
    assert f.read_value(Parameter.MODE, EXTENDED | 0x110005FD, data) == 2


def test_a_motors_number() -> None:
    assert f.uid_of(bytes.fromhex("16005C0001513434")) == 0x34345101005C0016
