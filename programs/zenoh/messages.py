"""CDR encoding and decoding of the ROS 2 messages that contactd uses. Pure functions."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from programs.zenoh.cdr import CdrError, Reader, Writer

MOST_JOINTS: Final = 32


class Level(IntEnum):
    """Level of a DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Content of a DiagnosticStatus."""

    level: Level
    name: str
    message: str
    hardware_id: str = ""
    values: tuple[tuple[str, str], ...] = ()


class JointStates:
    """Encoder of sensor_msgs/msg/JointState for joints with these names, from a template with
    everything but time and numbers."""

    def __init__(self, names: Sequence[str], *, motion: bool) -> None:
        n = len(names)
        writer = Writer()
        writer.int32(0)
        writer.uint32(0)
        writer.text("")  # frame_id, which joints do not have
        writer.texts(names)
        self._position = writer.doubles(n if motion else 0)
        self._velocity = writer.doubles(n if motion else 0)
        self._effort = writer.doubles(n)
        self._template = bytes(writer.payload)
        self._numbers = struct.Struct(f"<{n}d")
        self._motion = motion

    def encode(
        self,
        wall_s: float,
        effort: Sequence[float],
        position: Sequence[float] = (),
        velocity: Sequence[float] = (),
    ) -> bytes:
        """Message for a Unix time [s]; each sequence is (n,) in Nm, rad, rad/s; position and
        velocity are empty for an encoder without motion."""
        payload = bytearray(self._template)
        struct.pack_into("<iI", payload, 4, *stamp(wall_s))
        self._numbers.pack_into(payload, self._effort, *effort)
        if self._motion:
            self._numbers.pack_into(payload, self._position, *position)
            self._numbers.pack_into(payload, self._velocity, *velocity)
        return bytes(payload)


def wrench_stamped(wall_s: float, frame: str, force: Sequence[float]) -> bytes:
    """Message geometry_msgs/msg/WrenchStamped with force (3,) [N] and zero torque."""
    writer = Writer()
    seconds, nanoseconds = stamp(wall_s)
    writer.int32(seconds)
    writer.uint32(nanoseconds)
    writer.text(frame)
    writer.align(8)
    writer.payload += struct.pack("<6d", *force, 0.0, 0.0, 0.0)
    return bytes(writer.payload)


def numbers(values: Sequence[float]) -> bytes:
    """Message std_msgs/msg/Float64MultiArray without dimensions."""
    writer = Writer()
    writer.uint32(0)
    writer.uint32(0)
    at = writer.doubles(len(values))
    struct.pack_into(f"<{len(values)}d", writer.payload, at, *values)
    return bytes(writer.payload)


def stamp(wall_s: float) -> tuple[int, int]:
    """Seconds and nanoseconds of a builtin_interfaces/msg/Time, rounded to microseconds, the
    resolution of a Unix time as a float."""
    seconds, microseconds = divmod(round(wall_s * 1e6), 1_000_000)
    return seconds, microseconds * 1000


def string(text: str) -> bytes:
    """Message std_msgs/msg/String."""
    writer = Writer()
    writer.text(text)
    return bytes(writer.payload)


def diagnostic_status(diagnosis: Diagnosis) -> bytes:
    """Message diagnostic_msgs/msg/DiagnosticStatus."""
    writer = Writer()
    _write(writer, diagnosis)
    return bytes(writer.payload)


def diagnostic_array(wall_s: float, diagnoses: Sequence[Diagnosis]) -> bytes:
    """Message diagnostic_msgs/msg/DiagnosticArray."""
    writer = Writer()
    seconds, nanoseconds = stamp(wall_s)
    writer.int32(seconds)
    writer.uint32(nanoseconds)
    writer.text("")
    writer.uint32(len(diagnoses))
    for diagnosis in diagnoses:
        _write(writer, diagnosis)
    return bytes(writer.payload)


def outcome(success: bool, message: str) -> bytes:
    """Response of std_srvs/srv/Trigger and SetBool."""
    writer = Writer()
    writer.byte(success)
    writer.text(message)
    return bytes(writer.payload)


def _write(writer: Writer, diagnosis: Diagnosis) -> None:
    writer.byte(diagnosis.level)
    writer.text(diagnosis.name)
    writer.text(diagnosis.message)
    writer.text(diagnosis.hardware_id)
    writer.uint32(len(diagnosis.values))
    for key, value in diagnosis.values:
        writer.text(key)
        writer.text(value)


@dataclass(frozen=True, slots=True)
class JointTarget:
    """Target from a JointState: names, positions [rad], velocities [rad/s] or empty, time [s]."""

    stamp_s: float
    names: list[str]
    position: list[float]
    velocity: list[float]


def read_joint_target(payload: bytes) -> JointTarget:
    """Target from a received JointState. Raises CdrError for anything else, or numbers that are not
    finite."""
    reader = Reader(payload)
    seconds, nanoseconds = reader.uint32(), reader.uint32()
    reader.text()
    names = reader.texts(MOST_JOINTS)
    position, velocity = reader.doubles(MOST_JOINTS), reader.doubles(MOST_JOINTS)
    if not all(map(math.isfinite, (*position, *velocity))):
        raise CdrError("a target is not a finite number")
    return JointTarget(seconds + 1e-9 * nanoseconds, names, position, velocity)


def read_diagnostic_array(payload: bytes) -> list[Diagnosis]:
    """Diagnoses of a received DiagnosticArray. Raises CdrError for anything else."""
    reader = Reader(payload)
    reader.uint32()
    reader.uint32()
    reader.text()
    return [_read(reader) for _ in range(reader.uint32())]


def read_diagnostic_status(payload: bytes) -> Diagnosis:
    """Diagnosis of a received DiagnosticStatus. Raises CdrError for anything else."""
    return _read(Reader(payload))


def read_outcome(payload: bytes) -> tuple[bool, str]:
    """Success and message of a response. Raises CdrError for anything else."""
    reader = Reader(payload)
    return reader.byte() == 1, reader.text()


def _read(reader: Reader) -> Diagnosis:
    level = reader.byte()
    if level > Level.STALE:
        raise CdrError(f"diagnosis level {level}: must be at most {Level.STALE:d}")
    name, message, hardware_id = reader.text(), reader.text(), reader.text()
    pairs = range(reader.uint32())
    values = tuple((reader.text(), reader.text()) for _ in pairs)
    return Diagnosis(Level(level), name, message, hardware_id, values)
