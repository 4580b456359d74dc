"""Language of motors: commands and answers of a make, for the motors of one arm."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

from drivers.can.wire import Frame
from drivers.drive import Drive

MotorDrives = Sequence[Drive[Any]]
"""Motors of an arm, each with a `drivers.motors.settings.MotorProfile`."""


class State(Enum):
    """State of a motor of any make."""

    UNKNOWN = "not reported yet"
    OFF = "without torque"
    ON = "follows its setpoints"
    FAILED = "in fault"


@dataclass(frozen=True, slots=True)
class Status:
    """Status that a motor reports; compared by value."""

    state: State
    words: str
    code: str = ""  # as transmitted
    powered: bool = False  # it may have torque, even in fault
    supplied: bool | None = None  # None if not reported
    missed_us: bool = False  # it went limp for lack of setpoints


UNREPORTED = Status(State.UNKNOWN, "unknown")


@dataclass(frozen=True, slots=True)
class Feedback:
    """Feedback of a motor, in counts."""

    status: Status
    position: int
    velocity: int
    torque: int
    degC: float  # of its hottest part


@dataclass(frozen=True, slots=True)
class Output:
    """Answer with the position of the output encoder [rad]; None for any other register."""

    position: float | None


Counts = tuple[float, float, float]
"""Value of one count of position [rad], velocity [rad/s] and torque [Nm]."""


class Language(ABC):
    """Language of the motors of one arm; each make implements the differences. Positions and
    velocities are at the output, in the motor's own direction."""

    outputs: ClassVar[bool]
    """Each motor also reports the position of an encoder at its output."""
    asks_by_setpoint: ClassVar[bool] = False
    """The setpoint of a motor is its request of a tick, and its feedback the only answer."""
    bits: ClassVar[tuple[int, int, int]]
    """Bits of position, velocity and torque."""
    gain_bits: ClassVar[int]

    def __init__(self, drives: MotorDrives) -> None:
        self.motors = [drive.node for drive in drives]
        self.profiles: list[Any] = [drive.profile for drive in drives]
        self.joint_of = {motor: joint for joint, motor in enumerate(self.motors)}
        self._gains = [
            tuple(
                round(value / most * ((1 << self.gain_bits) - 1))
                for value, most in ((p.stiffness, f.stiffest), (p.damping, f.most_damping))
            )
            for p, f in ((p, p.figures) for p in self.profiles)
        ]
        self._data = [bytearray(8) for _ in drives]
        self.setpoints: list[Frame] = [
            (self.setpoint_id(motor), data)
            for motor, data in zip(self.motors, self._data, strict=True)
        ]
        """Setpoint of each motor, whose data `pack` overwrites."""
        self.requests = [frame for drive in drives for frame in self.requests_to(drive)]
        """Requests of a tick to motors whose setpoint is not the request. They command nothing, and
        yield one feedback per motor, and an `Output` if it has one. The first begins the tick."""
        self.steps = [steps_of(profile, self.bits) for profile in self.profiles]
        """Value of one count, by joint."""
        self.middle = [float((1 << bits - 1) - 1) for bits in self.bits]
        """Counts of the value 0."""

    def begins(self, frame: Frame) -> bool:
        """True if this frame, sent by us, begins a tick."""
        return frame == self.requests[0] or (
            self.asks_by_setpoint and frame[0] == self.setpoints[0][0]
        )

    def pack(self, joint: int, position: float, velocity: float) -> None:
        """Pack a setpoint with the gains of the profile."""
        self._pack(joint, self._data[joint], position, velocity, self._gains[joint])

    def restated(self, joint: int, data: bytes, position: float) -> bytes:
        """Data of a setpoint with another position and zero velocity, but the same gains."""
        written = bytearray(8)
        self._pack(joint, written, position, 0.0, self.fields(data)[2:])
        return bytes(written)

    def _pack(
        self, joint: int, data: bytearray, p: float, v: float, gains: tuple[int, ...]
    ) -> None:
        most, (of_p, of_v, _) = self.profiles[joint], self.bits
        position, velocity = scaled(p, most.position_max, of_p), scaled(v, most.velocity_max, of_v)
        self.write_fields(data, (position, velocity, *gains))

    def setpoint_of(
        self, joint: int, can_id: int, data: bytes | bytearray
    ) -> tuple[float, float] | None:
        """Position and velocity of a setpoint; None for other commands."""
        if not self.is_setpoint(can_id, data):
            return None
        counts, (of_p, of_v, _) = self.fields(data), self.bits
        position, velocity, _ = self.steps[joint]
        return (
            (counts[0] - ((1 << of_p) - 1) / 2) * position,
            (counts[1] - ((1 << of_v) - 1) / 2) * velocity,
        )

    @abstractmethod
    def setpoint_id(self, motor: int) -> int:
        """Identifier of a motor's setpoint."""

    @abstractmethod
    def requests_to(self, drive: Drive[Any]) -> Sequence[Frame]:
        """Requests of a tick to one motor."""

    @abstractmethod
    def is_setpoint(self, can_id: int, data: bytes | bytearray) -> bool:
        """True if a frame that commands a motor is a setpoint."""

    @abstractmethod
    def fields(self, data: bytes | bytearray) -> tuple[int, ...]:
        """Position, velocity, stiffness and damping of a setpoint, in counts."""

    @abstractmethod
    def write_fields(self, data: bytearray, fields: tuple[int, ...]) -> None:
        """Pack these counts into the data of a setpoint."""

    @abstractmethod
    def answering(self, can_id: int) -> int | None:
        """Joint whose motor answers under this identifier."""

    @abstractmethod
    def commanded(self, can_id: int) -> int | None:
        """Joint whose motor is commanded under this identifier."""

    @abstractmethod
    def masters(self, can_id: int) -> bool:
        """True for an identifier under which only a master of these motors sends."""

    def zeroed(self, can_id: int) -> int | None:
        """Joint whose motor is given a new zero by this frame, if it accepts that while holding."""
        return None

    @abstractmethod
    def answer_of(
        self, joint: int, can_id: int, data: bytes | bytearray
    ) -> Feedback | Output | None:
        """Decoded answer of a motor; None for a frame that it cannot have sent."""

    @abstractmethod
    def enabling(self, joint: int) -> Sequence[Frame]:
        """Frames that enable a motor, to be sent after its setpoint."""

    @abstractmethod
    def disabling(self, joint: int) -> Frame:
        """Frame that disables a motor."""

    @abstractmethod
    def clearing(self, joint: int) -> Frame:
        """Frame that clears a motor's fault."""

    @abstractmethod
    def time_out_of(self, can_id: int, data: bytes | bytearray) -> tuple[int, bool] | None:
        """Joint in a frame that sets a timeout, and whether the timeout is then enabled."""


def scaled(value: float, most: float, bits: int) -> int:
    """Value between -most and +most, quantised to an integer of `bits` bits and saturated."""
    highest = (1 << bits) - 1
    return min(max(round((value + most) * highest / (2.0 * most)), 0), highest)


def steps_of(profile: Any, bits: Sequence[int]) -> Counts:
    """Value of one count of position, velocity and torque, with these numbers of bits."""
    most = profile.position_max, profile.velocity_max, profile.torque_max_Nm
    position, velocity, torque = (2.0 * m / ((1 << b) - 1) for m, b in zip(most, bits, strict=True))
    return position, velocity, torque
