"""Expedited SDO inside the tick, byte by byte."""

import math
import struct
from dataclasses import replace

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.api import DriveCondition, PowerTarget
from drivers.canopen.codec import link_side
from drivers.canopen.expedited_stop import ANSWER_TICKS, ExpeditedStop, expedited_quick_stops
from drivers.stopping.stop_watch import StopReading
from drivers.wiring import Harmonic
from tests.examples import scaled

STOP, OFF = PowerTarget.QUICK_STOP, PowerTarget.OFF
TELL_STOP = bytes.fromhex("2b40600002000000")
TELL_OFF = bytes.fromhex("2b40600000000000")
COMMANDED = bytes.fromhex("6040600000000000")
ASK_STATUSWORD = bytes.fromhex("4041600000000000")
ASK_VELOCITY = bytes.fromhex("406c600000000000")
ASK_LINK = bytes.fromhex("40e4600100000000")


def statusword(value: int) -> bytes:
    return struct.pack("<BHBI", 0x4B, 0x6041, 0, value)


def velocity(counts: int, first: int = 0x43) -> bytes:
    return struct.pack("<BHBi", first, 0x606C, 0, counts)


@pytest.fixture
def stop(joint_drives) -> ExpeditedStop:
    stop = ExpeditedStop(joint_drives[2])
    stop.begin()
    return stop


def test_it_commands_and_then_asks_for_statusword_and_velocity(stop, joint_drives) -> None:
    assert stop.request(STOP) == (0x603, TELL_STOP)
    assert not stop.confirmed
    stop.on_sdo(COMMANDED)
    assert stop.confirmed
    assert stop.request(STOP) == (0x603, ASK_STATUSWORD)
    stop.on_sdo(statusword(0x0207))
    assert stop.take() is None
    assert stop.request(STOP) == (0x603, ASK_VELOCITY)
    stop.on_sdo(velocity(-500))
    gain, bias = link_side(joint_drives[2], "motor_velocity")
    seen = stop.take()
    assert seen is not None
    assert (seen.condition, seen.velocity) == (DriveCondition.STOPPED, -500 * gain + bias)
    assert math.isnan(seen.current)
    assert math.isnan(seen.position)
    assert stop.take() is None, "once"
    assert stop.request(STOP) == (0x603, ASK_LINK), "it obeys: it need not be commanded again"


def test_positions_are_read_in_turn_and_are_those_of_the_samples(joint_drives) -> None:
    """With what the link encoder errs taken off."""
    wiring = msgspec.structs.replace(
        joint_drives[2].wiring, link_offset=0.1, link_correction=[Harmonic(order=1, cosine=0.01)]
    )
    stop = ExpeditedStop(replace(joint_drives[2], wiring=wiring))
    stop.begin()
    answers = {0x6041: statusword(0x0207), 0x606C: velocity(0)}
    answers |= {0x60E4: struct.pack("<BHBi", 0x43, 0x60E4, 1, 1000)}
    answers |= {0x6064: struct.pack("<BHBi", 0x43, 0x6064, 0, -700), 0x6040: COMMANDED}
    seen, asked = [], []
    for _ in range(9):
        asked.append(int.from_bytes(stop.request(STOP)[1][1:3], "little"))
        stop.on_sdo(answers[asked[-1]])
        seen += [reading] if (reading := stop.take()) else []
    ask = [0x6041, 0x606C]
    assert asked == [0x6040, *ask, 0x60E4, *ask, 0x6064, *ask]
    assert [math.isnan(s.position) for s in seen] == [True, False, False]
    assert [math.isnan(s.motor) for s in seen] == [True, True, False]
    gain, bias = link_side(replace(joint_drives[2], wiring=wiring), "link_position")
    angle = 1000 * gain + bias
    assert seen[-1].position == pytest.approx(angle - 0.01 * math.cos(angle - 0.1))
    gain, bias = link_side(joint_drives[2], "motor_position")
    assert seen[-1].motor == -700 * gain + bias
    assert seen[-1].asked
    stop.begin()
    for _ in range(3):
        stop.on_sdo(answers[int.from_bytes(stop.request(STOP)[1][1:3], "little")])
    assert math.isnan(stop.take().position), "nothing of before"


def test_a_drive_that_runs_on_is_commanded_again(stop) -> None:
    for answer in (COMMANDED, statusword(0x0227), velocity(300)):
        stop.request(STOP)
        stop.on_sdo(answer)
    assert stop.take().condition is DriveCondition.OPERATING
    assert stop.request(OFF) == (0x603, TELL_OFF)


def test_nothing_is_asked_while_an_answer_is_awaited_and_a_late_one_still_counts(stop) -> None:
    stop.request(STOP)
    stop.on_sdo(COMMANDED)
    assert stop.request(STOP) == (0x603, ASK_STATUSWORD)
    assert [stop.request(STOP) for _ in range(ANSWER_TICKS - 1)] == [None] * (ANSWER_TICKS - 1)
    assert stop.request(STOP) == (0x603, ASK_STATUSWORD), "asked again"
    stop.on_sdo(statusword(0x0207))
    assert stop.request(STOP) == (0x603, ASK_VELOCITY)


def test_a_drive_that_refuses_is_asked_all_the_same(stop) -> None:
    stop.request(STOP)
    stop.on_sdo(struct.pack("<BHBI", 0x80, 0x6040, 0, 0x08000022))
    assert not stop.confirmed
    assert stop.request(STOP) == (0x603, ASK_STATUSWORD)
    stop.on_sdo(statusword(0x0240))
    stop.request(STOP)
    stop.on_sdo(struct.pack("<BHBI", 0x80, 0x606C, 0, 0x06020000))
    assert stop.take() is None, "of its velocity nothing is known"
    assert stop.request(STOP) == (0x603, TELL_STOP)


@pytest.mark.parametrize(
    "answer",
    [
        struct.pack("<BHBI", 0x80, 0x6041, 0, 0x08000022),  # refused
        struct.pack("<BHBI", 0x41, 0x6041, 0, 4),  # in segments
        struct.pack("<BHBI", 0x60, 0x6041, 0, 0),
    ],
)
def test_what_is_no_statusword_proves_nothing(stop, answer: bytes) -> None:
    for commanded in (COMMANDED, answer):
        stop.request(STOP)
        stop.on_sdo(commanded)
    assert stop.take() is None
    assert stop.request(STOP) == (0x603, TELL_STOP), "commanded anew"


@pytest.mark.parametrize(
    "stray",
    [
        b"",
        COMMANDED[:7],
        statusword(0x0207),  # of an object that was not asked for
        struct.pack("<BHBI", 0x60, 0x6060, 0, 0),  # an answer to another program's tool
        struct.pack("<BHBI", 0x60, 0x6040, 1, 0),
    ],
)
def test_answers_to_others_change_nothing(stop, stray: bytes) -> None:
    stop.on_sdo(COMMANDED)
    assert not stop.confirmed, "not asked for"
    stop.request(STOP)
    stop.on_sdo(stray)
    assert not stop.confirmed
    stop.on_sdo(COMMANDED)
    assert stop.confirmed
    stop.begin()
    assert not stop.confirmed


@settings(max_examples=scaled(200))
@given(frames=st.lists(st.binary(max_size=8) | st.sampled_from([COMMANDED, statusword(0x0207)])))
def test_no_frame_makes_an_exception(joint_drives, frames: list[bytes]) -> None:
    stop = ExpeditedStop(joint_drives[0])
    for frame in frames:
        stop.request(STOP)
        stop.on_sdo(frame)
        seen = stop.take()
        assert seen is None or isinstance(seen, StopReading)


def test_for_when_no_one_reads_the_answers(joint_drives) -> None:
    frames = expedited_quick_stops(joint_drives)
    assert frames == [(0x600 + node, TELL_STOP) for node in range(1, 8)]
