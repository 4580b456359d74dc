"""Messages for ROS 2 against two implementations that are not ours: rosbags reads every byte, and
cyclonedds writes the same bytes."""

import contextlib
import math
import struct
from dataclasses import dataclass
from typing import Any

import pytest
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import byte, float64, int32, sequence, uint32
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from programs.zenoh.cdr import CdrError, read_flag, refuse_unless_empty
from programs.zenoh.messages import (
    Diagnosis,
    JointStates,
    Level,
    diagnostic_array,
    diagnostic_status,
    numbers,
    outcome,
    read_diagnostic_array,
    read_diagnostic_status,
    read_outcome,
    stamp,
    string,
    wrench_stamped,
)
from programs.zenoh.type_hashes import TYPE_HASHES

STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(get_types_from_msg("bool data", "std_srvs/msg/Flag"))
STORE.register(get_types_from_msg("bool success\nstring message", "std_srvs/msg/Outcome"))

NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)
NUMBERS = st.floats(width=64)
TIMES = st.floats(0, 2**31 - 2)


@dataclass
class Time(IdlStruct):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class KeyValue(IdlStruct):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct):
    level: byte
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Text(IdlStruct):
    data: str


@dataclass
class Flag(IdlStruct):
    data: bool


@dataclass
class Outcome(IdlStruct):
    success: bool
    message: str


def cyclone(message: IdlStruct) -> bytes:
    """Plain CDR of version 1, little-endian, without the padding that DDS puts behind."""
    return bytes(message.serialize(use_version_2=False))


def rosbags(payload: bytes, name: str) -> Any:
    """The message as rosbags reads it; it takes every byte."""
    message = STORE.deserialize_cdr(payload, name)
    assert bytes(STORE.serialize_cdr(message, name)) == payload
    return message


def same(one: float, other: float) -> bool:
    return struct.pack("<d", one) == struct.pack("<d", other)


@given(st.data(), st.lists(NAMES, max_size=8), TIMES, st.booleans())
def test_joint_state(data: st.DataObject, names: list[str], wall_s: float, motion: bool) -> None:
    rows = [data.draw(st.lists(NUMBERS, min_size=len(names), max_size=len(names))) for _ in "123"]
    effort, position, velocity = rows[0], rows[1] if motion else [], rows[2] if motion else []
    payload = JointStates(names, motion=motion).encode(wall_s, effort, position, velocity)
    read = rosbags(payload, "sensor_msgs/msg/JointState")
    assert read.name == names
    for sent, found in (
        (effort, read.effort),
        (position, read.position),
        (velocity, read.velocity),
    ):
        assert len(sent) == len(found)
        assert all(map(same, sent, found))
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == stamp(wall_s)
    header = Header(Time(*stamp(wall_s)), "")
    assert payload == cyclone(JointState(header, names, position, velocity, effort))


@given(TIMES, NAMES, st.lists(NUMBERS, min_size=3, max_size=3))
def test_wrench_stamped(wall_s: float, frame: str, force: list[float]) -> None:
    read = rosbags(wrench_stamped(wall_s, frame, force), "geometry_msgs/msg/WrenchStamped")
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == stamp(wall_s)
    assert read.header.frame_id == frame
    found = read.wrench.force
    assert all(map(same, force, (found.x, found.y, found.z)))
    assert (read.wrench.torque.x, read.wrench.torque.y, read.wrench.torque.z) == (0.0, 0.0, 0.0)


@given(st.lists(NUMBERS, max_size=11))
def test_numbers(values: list[float]) -> None:
    read = rosbags(numbers(values), "std_msgs/msg/Float64MultiArray")
    assert len(read.data) == len(values)
    assert all(map(same, values, read.data))


DIAGNOSES = st.builds(
    Diagnosis,
    st.sampled_from(Level),
    NAMES,
    NAMES,
    NAMES,
    st.lists(st.tuples(NAMES, NAMES), max_size=4).map(tuple),
)


def as_cyclone(diagnosis: Diagnosis) -> DiagnosticStatus:
    values = [KeyValue(key, value) for key, value in diagnosis.values]
    level, name = int(diagnosis.level), diagnosis.name
    return DiagnosticStatus(level, name, diagnosis.message, diagnosis.hardware_id, values)


@given(DIAGNOSES)
def test_diagnostic_status(diagnosis: Diagnosis) -> None:
    payload = diagnostic_status(diagnosis)
    read = rosbags(payload, "diagnostic_msgs/msg/DiagnosticStatus")
    assert (read.level, read.name) == (diagnosis.level, diagnosis.name)
    assert [(pair.key, pair.value) for pair in read.values] == list(diagnosis.values)
    assert payload == cyclone(as_cyclone(diagnosis))


@given(TIMES, st.lists(DIAGNOSES, max_size=4))
def test_diagnostic_array(wall_s: float, diagnoses: list[Diagnosis]) -> None:
    payload = diagnostic_array(wall_s, diagnoses)
    read = rosbags(payload, "diagnostic_msgs/msg/DiagnosticArray")
    assert [status.message for status in read.status] == [d.message for d in diagnoses]
    header = Header(Time(*stamp(wall_s)), "")
    assert payload == cyclone(DiagnosticArray(header, [as_cyclone(d) for d in diagnoses]))


@given(NAMES, st.booleans())
def test_texts_and_outcomes(text: str, done: bool) -> None:
    assert rosbags(string(text), "std_msgs/msg/String").data == text
    assert string(text) == cyclone(Text(text))
    read = rosbags(outcome(done, text), "std_srvs/msg/Outcome")
    assert (read.success, read.message) == (done, text)
    assert outcome(done, text) == cyclone(Outcome(done, text))


@given(TIMES)
def test_time(wall_s: float) -> None:
    seconds, nanoseconds = stamp(wall_s)
    assert 0 <= nanoseconds < 1_000_000_000
    assert abs(seconds + nanoseconds * 1e-9 - wall_s) < 1e-6
    assert not math.isnan(wall_s)


@pytest.mark.parametrize("name", [name for name in TYPE_HASHES if "/msg/" in name])
def test_hashes_are_those_that_rosbags_computes(name: str) -> None:
    """The generated ones are of ros2-pyterfaces."""
    assert TYPE_HASHES[name] == STORE.hash_rihs01(name)


# --- what others send --------------------------------------------------------------------------


@given(TIMES, st.lists(DIAGNOSES, max_size=4), st.booleans(), NAMES)
def test_written_messages_are_read(
    wall_s: float, diagnoses: list[Diagnosis], done: bool, text: str
) -> None:
    assert read_diagnostic_array(diagnostic_array(wall_s, diagnoses)) == diagnoses
    for diagnosis in diagnoses:
        assert read_diagnostic_status(diagnostic_status(diagnosis)) == diagnosis
    assert read_outcome(outcome(done, text)) == (done, text)


@given(st.binary(max_size=80), st.booleans())
def test_invalid_bytes_raise_only_cdr_errors(payload: bytes, headed: bool) -> None:
    for read in (read_diagnostic_array, read_diagnostic_status, read_outcome):
        with contextlib.suppress(CdrError):
            read(b"\0\1\0\0" + payload if headed else payload)


@given(st.data(), DIAGNOSES)
def test_a_damaged_message_is_an_error_or_another_message(
    data: st.DataObject, diagnosis: Diagnosis
) -> None:
    payload = bytearray(diagnostic_status(diagnosis))
    at = data.draw(st.integers(0, len(payload) - 1))
    payload[at] = data.draw(st.integers(0, 255))
    with contextlib.suppress(CdrError):
        read_diagnostic_status(bytes(payload))


@pytest.mark.parametrize(
    "payload",
    [b"\0\1\0\0" + b"\xff" * 60, b"\0\1\0\0" + bytes(1 << 18), b"\0\7\0\0\0", b"\0\1\0\0\4"],
)
def test_lengths_beyond_the_payload_are_refused(payload: bytes) -> None:
    with pytest.raises(CdrError):
        read_diagnostic_status(payload)


@pytest.mark.parametrize(
    "payload", [b"", b"\0\1\0", b"\0\2\0\0\0", b"\1\1\0\0\0", b"\0\1\0\0\0\0\0\0\0", b"x" * 1000]
)
def test_a_trigger_has_no_fields(payload: bytes) -> None:
    with pytest.raises(CdrError, match="no Trigger request"):
        refuse_unless_empty(payload)
    for size in range(4, 9):
        refuse_unless_empty(b"\0\1\0\0\0\0\0\0"[:size])


@given(st.booleans(), st.integers(0, 3))
def test_a_flag_of_others_is_read(flag: bool, more: int) -> None:
    kind = STORE.types["std_srvs/msg/Flag"]
    assert read_flag(bytes(STORE.serialize_cdr(kind(flag), "std_srvs/msg/Flag"))) is flag
    assert read_flag(cyclone(Flag(flag)) + bytes(more)) is flag


@given(st.binary(max_size=12), st.booleans())
def test_invalid_bytes_are_a_flag_or_an_error(payload: bytes, headed: bool) -> None:
    with contextlib.suppress(CdrError):
        assert read_flag(b"\0\1\0\0" + payload if headed else payload) in (True, False)


@pytest.mark.parametrize(
    "payload", [b"", b"\0\1\0\0", b"\0\1\0\0\2", b"\0\2\0\0\1", b"\0\1\0\0\1\0\0\0\0"]
)
def test_a_flag_is_one_bool(payload: bytes) -> None:
    with pytest.raises(CdrError, match="no SetBool request"):
        read_flag(payload)
