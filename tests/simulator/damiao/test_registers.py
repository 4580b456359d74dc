"""Registers of a Damiao motor: what is read, taken, refused, saved."""

import math
import struct

import pytest

from simulator.damiao.models import MODELS, DamiaoMake
from simulator.damiao.registers import Registers
from tests.simulator.damiao.one_motor import CAN_ID, DISABLE, MASTER_ID, One, as_float


@pytest.mark.parametrize(
    ("model", "gear", "ranges"),
    [
        ("DM4310", 10, (12.5, 30, 10)),
        ("DM4340", 40, (12.5, 10, 28)),
        ("DM6006", 6, (12.5, 45, 20)),
        ("DM8009", 9, (12.5, 45, 54)),
    ],
)
def test_models_differ_in_gear_and_ranges(model, gear, ranges) -> None:
    one = One(DamiaoMake(model, MASTER_ID))
    assert as_float(one.read(20)) == gear
    assert tuple(as_float(one.read(n)) for n in (21, 22, 23)) == ranges


@pytest.mark.parametrize("model", MODELS)
def test_the_torque_constant_is_that_of_poles_flux_and_gear(model) -> None:
    registers = Registers.of(DamiaoMake(model, MASTER_ID), 1)
    assert registers.torque_constant == pytest.approx(MODELS[model].torque_constant, rel=1e-3)
    registers.values[1] = 0.5
    assert registers.torque_constant == 0.5


@pytest.mark.parametrize(
    ("register", "value"),
    [
        (0, 10.5), (1, 0.0), (2, 80.0), (2, 199.0), (3, 0.99), (4, 0.001), (5, -0.001), (6, 1.0),
        (9, 0), (9, 2**32 - 1), (10, 1), (10, 4), (21, 3.14), (22, 8.0), (23, 1.0), (24, 100.0),
        (25, 0.0), (30, 1.0), (31, 30.0), (32, 500.0), (35, 4),
    ],
)  # fmt: skip
def test_a_value_that_is_allowed_is_held(one: One, register, value) -> None:
    code = "<I" if isinstance(value, int) else "<f"
    assert one.write(register, value) == struct.pack(code, value)
    assert one.read(register) == struct.pack(code, value)


@pytest.mark.parametrize(
    ("register", "value"),
    [
        (0, 10.0), (2, 79.0), (2, 200.0), (3, 0.0), (3, 1.0), (4, 0.0), (4, -1.0), (5, 0.0),
        (6, 0.0), (10, 0), (10, 5), (21, 0.0), (22, -1.0), (24, 99.0), (25, -0.1), (30, 1.01),
        (31, 0.5), (32, 0.0), (35, 12), (4, math.nan), (21, math.nan),
        (21, math.inf), (25, math.inf), (5, -math.inf),
    ],
)  # fmt: skip
def test_another_is_refused_and_the_answer_says_what_holds(one: One, register, value) -> None:
    before = one.read(register)
    assert one.write(register, value) == before
    assert one.read(register) == before


@pytest.mark.parametrize("register", [11, 12, 14, 16, 20, 36, 50, 55, 80, 81, 37, 200])
def test_a_register_that_only_reads_answers_a_write_with_0(one: One, register) -> None:
    before = one.read(register)
    assert one.write(register, 3.0) == bytes(4)
    assert one.read(register) == before


def test_identifiers_are_masked_and_act_at_once(one: One) -> None:
    ((by, answer),) = one.send(0x7FF, bytes([CAN_ID, 0, 0x55, 7]) + struct.pack("<I", 0xF822))
    assert (by, answer[4:]) == (0x022, struct.pack("<I", 0x022))
    ((by, answer),) = one.send(0x7FF, bytes([CAN_ID, 0, 0x55, 8]) + struct.pack("<I", 6))
    assert (by, answer[:2]) == (0x022, b"\x06\x00")
    assert one.send(CAN_ID, DISABLE) == []
    assert len(one.send(6, DISABLE)) == 1
    one.motor.registers.values[8] = 0x106  # beyond what frames of commands can name
    assert one.send(0x106, DISABLE) == []
    ((by, answer),) = one.send(0x7FF, b"\x06\x01\xcc\x00")
    assert (by, answer[0]) == (0x022, 0x06)


@pytest.mark.parametrize("data", [bytes([6, 0, 0x33, 21]), bytes([CAN_ID, 1, 0x33, 21]), b"\x05"])
def test_frames_for_another_motor_are_not_answered(one: One, data) -> None:
    assert one.send(0x7FF, data.ljust(8, b"\0") if len(data) > 1 else data) == []


@pytest.mark.parametrize("length", [4, 8])
def test_a_refresh_is_answered_by_a_feedback(one: One, length) -> None:
    answer = one.ask(0x7FF, bytes([CAN_ID, 0, 0xCC, 0]).ljust(length, b"\0"))
    assert answer == one.ask(CAN_ID, DISABLE)


def test_what_is_saved_outlives_a_reset_and_nothing_else(one: One) -> None:
    one.write(21, 3.5)
    assert one.ask(0x7FF, bytes([CAN_ID, 0, 0xAA, 1, 0, 0, 0, 0])) == bytes([CAN_ID, 0, 0xAA, 1])
    one.write(22, 7.0)
    one.motor.boot()
    assert as_float(one.read(21)) == 3.5
    assert as_float(one.read(22)) == 10.0


def test_an_enabled_motor_takes_registers_but_does_not_save(one: One) -> None:
    one.enable(3)
    assert one.write(9, 77) == struct.pack("<I", 77)
    assert one.send(0x7FF, bytes([CAN_ID, 0, 0xAA, 1, 0, 0, 0, 0])) == []
    one.motor.boot()
    assert one.read(9) == bytes(4)
    assert one.read(10) == struct.pack("<I", 1)


def test_an_owner_may_have_saved_others() -> None:
    one = One(DamiaoMake("DM4310", MASTER_ID, registers={21: 3.1416, 9: 8000}))
    one.motor.boot()
    assert as_float(one.read(21)) == pytest.approx(3.1416)
    assert one.read(9) == struct.pack("<I", 8000)
