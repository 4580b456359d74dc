"""A RobStride motor: frames byte for byte, power, faults, time-out, and what it measures."""

import math
import struct

import can
import pytest

from simulator.robstride import motor as m
from simulator.robstride.models import MODELS, RobStrideMake
from tests.simulator.robstride.one_motor import HOST, ID, One

STOPPED, RUNNING = 0x00, 0x80
TIMEOUT = 0x7028


@pytest.fixture
def one() -> One:
    return One()


def test_it_says_its_name_at_power_up_and_when_asked(one: One) -> None:
    said = (0x0000_05FE, (0x3434_5101_005C_0016 + ID).to_bytes(8, "little"))
    assert [(f.arbitration_id, bytes(f.data)) for f in one.frames] == [said]
    assert one.order(0) == said


def test_only_its_own_frames_with_29_bits_are_answered(one: One) -> None:
    one.frames.clear()
    one.arm.receive(can.Message(arbitration_id=ID, data=bytes(8), is_extended_id=False))
    assert one.frames == []
    assert one.send(0x0300_FD06) == []
    assert one.send(0x0280_FD05) == []  # a feedback commands nothing


def test_a_parameter_is_read_and_written_as_the_manual_has_it(one: One) -> None:
    assert one.send(0x1100_FD05, bytes.fromhex("0B70000000000000")) == [
        (0x1100_05FD, bytes.fromhex("0B70000000008841"))  # 17 Nm
    ]
    (answer,) = one.send(0x1200_FD05, bytes.fromhex("0B7000000000F041"))
    assert answer[0] == 0x0200_05FD
    assert one.read(0x700B) == 30.0
    assert one.send(0x1100_FD05, bytes.fromhex("1234000000000000"))[0][0] == 0x1101_05FD


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("sign", [1, -1])
def test_it_follows_an_impedance(model: str, sign: int) -> None:
    one = One(RobStrideMake(model, motor_sign=sign))
    kp = 0.4 * one.model.kp_max if one.model.kp_max < 1e3 else 200.0
    assert one.decode(one.order(3))[0] == RUNNING
    goal = 0.3 * sign
    one.run(2.0, lambda: one.control(goal, 0.0, kp, 5.0, 0.0))
    mode, p, v, t = one.decode(one.control(goal, 0.0, kp, 5.0, 0.0))
    assert mode == RUNNING
    assert p == pytest.approx(sign * one.arm.plant.theta[0], abs=1e-3)
    assert abs(v) < 0.05
    assert t == pytest.approx(kp * (goal - p), abs=0.02 + kp * 4e-4)


def test_it_is_limp_until_a_command_comes_after_it_was_enabled(one: One) -> None:
    one.control(0.5, 0.0, 100.0, 2.0, 0.0)
    one.order(3)
    assert one.motor.command.kp == 0.0
    keeping = One()
    keeping.motor.keeps = True
    keeping.control(0.5, 0.0, 100.0, 2.0, 0.0)
    keeping.order(3)
    assert keeping.motor.command.kp == pytest.approx(100.0, abs=0.01)


def test_without_commands_it_resets_and_says_nothing(one: One) -> None:
    one.write(TIMEOUT, 2000, "<I")  # 0.1 s
    one.order(3)
    one.run(1.0, lambda: one.control(0.0, 0.0, 50.0, 1.0, 0.0))
    assert one.motor.mode == m.RUN
    one.frames.clear()
    one.arm.advance(one.arm.now + 0.11)
    assert (one.motor.mode, one.motor.faults) == (m.RESET, 0)
    assert one.frames == []
    assert one.decode(one.write(TIMEOUT, 2000, "<I"))[0] == STOPPED


def test_without_a_time_out_it_goes_on(one: One) -> None:
    one.order(3)
    one.control(0.3, 0.0, 50.0, 1.0, 0.0)
    one.arm.advance(one.arm.now + 3.0)
    assert one.motor.mode == m.RUN


@pytest.mark.parametrize(("fault", "word"), m.FAULT_WORDS.items())
def test_a_fault_is_reported_and_holds_until_it_is_cleared(one: One, fault: int, word: int) -> None:
    one.order(3)
    one.frames.clear()
    one.motor.fail(fault)
    ((can_id, data),) = [(f.arbitration_id, bytes(f.data)) for f in one.frames]
    assert can_id == 0x15 << 24 | ID << 8 | HOST
    assert struct.unpack("<II", data) == (word, 0)
    assert one.decode(one.order(3))[0] == fault
    assert one.decode(one.order(4))[0] == fault
    assert one.decode(one.order(4, b"\x01" + bytes(7)))[0] == STOPPED
    assert one.decode(one.order(3))[0] == RUNNING


def test_what_is_written_lasts_until_the_power_is_off(one: One) -> None:
    one.write(0x700B, 3.0)
    assert one.read(0x700B) == 3.0
    one.motor.boot()
    assert one.read(0x700B) == 17.0


def test_a_torque_limit_holds(one: One) -> None:
    one.write(0x700B, 0.5)
    one.order(3)
    one.run(0.3, lambda: one.control(3.0, 0.0, 400.0, 0.0, 0.0))
    torque = one.decode(one.control(3.0, 0.0, 400.0, 0.0, 0.0))[3]
    assert torque == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(("zero_sta", "at"), [(0, 2.0 * math.pi - 0.2), (1, -0.2)])
def test_where_it_begins_to_count_at_power_up(zero_sta: int, at: float) -> None:
    one = One(RobStrideMake("RS02", offset=0.2, parameters={0x7029: zero_sta}))
    assert one.read(0x7019) == pytest.approx(at, abs=1e-3)


def test_a_feedback_counts_round_after_two_turns(one: One) -> None:
    one.motor._turns = 4.0 * math.pi + 0.1
    assert one.decode(one.order(4))[1] == pytest.approx(0.1 - 4.0 * math.pi, abs=1e-3)
    assert one.read(0x7019) == pytest.approx(4.0 * math.pi + 0.1, abs=1e-3)


def test_a_silent_motor_hears_and_says_nothing(one: One) -> None:
    one.motor.silent = True
    assert one.send(0x0300_FD05) == []
    one.motor.fail(m.HOT)
    assert one.frames == []
