"""Packing of Damiao's frames: fields, ranges, bits."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.damiao import frames
from simulator.damiao.frames import Ranges

RANGES = Ranges(12.5, 10.0, 28.0)
BITS = {"position": 16, "velocity": 12, "kp": 12, "kd": 12, "torque": 12}
LOWEST = {"position": -12.5, "velocity": -10.0, "kp": 0.0, "kd": 0.0, "torque": -28.0}
HIGHEST = {"position": 12.5, "velocity": 10.0, "kp": 500.0, "kd": 5.0, "torque": 28.0}

fields = st.tuples(*(st.integers(0, 2**bits - 1) for bits in BITS.values()))


@given(fields)
def test_an_impedance_is_five_fields_from_the_first_bit_on(numbers: tuple[int, ...]) -> None:
    text = "".join(format(n, f"0{bits}b") for n, bits in zip(numbers, BITS.values(), strict=True))
    command = frames.impedance(bytes.fromhex(f"{int(text, 2):016x}"), RANGES)
    for number, (name, bits) in zip(numbers, BITS.items(), strict=True):
        span = HIGHEST[name] - LOWEST[name]
        expected = LOWEST[name] + span * number / (2**bits - 1)
        assert getattr(command, name) == pytest.approx(expected, abs=1e-9)


@given(
    st.integers(0, 255), st.integers(0, 15),
    st.tuples(*(st.floats(-2 * most, 2 * most) for most in RANGES)),
    st.tuples(st.floats(0, 200), st.floats(0, 200)),
)  # fmt: skip
def test_a_feedback_is_within_one_step_and_clips(can_id, status, measured, degC) -> None:
    data = frames.feedback(can_id, status, measured, RANGES, degC)
    assert len(data) == 8
    assert data[0] == can_id | (status << 4) & 0xF0
    assert (data[6], data[7]) == tuple(map(int, degC))
    bits = format(int.from_bytes(data[1:6], "big"), "040b")
    for x, most, number in zip(measured, RANGES, (bits[:16], bits[16:28], bits[28:]), strict=True):
        step = 2 * most / (2 ** len(number) - 1)
        meant = int(number, 2) * step - most
        clipped = min(max(x, -most), most)
        assert -1e-9 <= clipped - meant < step * (1 + 1e-9)


@pytest.mark.parametrize(
    ("decode", "data", "expected"),
    [
        (frames.position_velocity, struct.pack("<ff", 1.5, -2.0), {"position": 1.5, "velocity": 2}),
        (frames.velocity, struct.pack("<f", -0.25), {"velocity": -0.25}),
        (frames.velocity, struct.pack("<f4x", -0.25), {"velocity": -0.25}),
        (
            frames.hybrid,
            struct.pack("<fHH", -1.0, 250, 5000),
            {"position": -1, "velocity": 2.5, "share": 0.5},
        ),
        (
            frames.hybrid,
            struct.pack("<fHH", 0.0, 65535, 65535),
            {"position": 0, "velocity": 100.0, "share": 1.0},
        ),
    ],
)
def test_the_other_modes_are_little_endian(decode, data, expected) -> None:
    command = decode(data, RANGES)
    for name, value in expected.items():
        assert getattr(command, name) == pytest.approx(value)


@pytest.mark.parametrize("decode", [frames.impedance, frames.position_velocity, frames.hybrid])
def test_a_short_frame_is_no_command(decode) -> None:
    assert decode(bytes(7), RANGES) is None
    assert frames.velocity(bytes(3), RANGES) is None
