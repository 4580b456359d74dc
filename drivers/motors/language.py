"""Language of motors: what a make understands and answers, as one arm's motors need it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

from drivers.can.wire import Frame
from drivers.drive import Drive

MotorDrives = Sequence[Drive[Any]]
"""Motors of an arm; their profiles are a `drivers.motors.settings.MotorProfile`."""


class State(Enum):
    """States of a motor, of any make."""

    UNKNOWN = "not reported yet"
    OFF = "without torque"
    ON = "follows its setpoints"
    FAILED = "in fault"


@dataclass(frozen=True, slots=True)
class Status:
    """Status of a motor, as it reports it; one that is the same is equal."""

    state: State
    words: str
    code: str = ""  # as it is sent
    powered: bool = False  # it may have torque, also in fault
    supplied: bool | None = None  # None where it was not reported
    missed_us: bool = False  # it let go, as it heard no setpoint


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
    """Answer about an encoder at the output [rad]; about anything else, None."""

    position: float | None


Counts = tuple[float, float, float]
"""Value of one count of position [rad], velocity [rad/s] and torque [Nm], or their middle."""


class Language(ABC):
    """Language of the motors of one arm, of which a make says what differs. Positions and
    velocities are in the motor's own sense, at its output."""

    outputs: ClassVar[bool]
    """Each motor also answers about an encoder at its output."""
    asks_by_setpoint: ClassVar[bool] = False
    """The setpoint that it has is the request of a tick to a motor: its answer is all there is."""
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
        """Setpoint of each motor, whose data `pack` writes anew."""
        self.requests = [frame for drive in drives for frame in self.requests_to(drive)]
        """Request of a tick to each motor that is not asked by its setpoint. It commands nothing,
        and brings one feedback, and an `Output` where there are any. The first begins the tick."""
        self.steps = [steps_of(profile, self.bits) for profile in self.profiles]
        """Value of one count, by joint."""
        self.middle = [float((1 << bits - 1) - 1) for bits in self.bits]
        """Counts at 0."""

    def begins(self, frame: Frame) -> bool:
        """True for the frame of ours that a tick begins with."""
        return frame == self.requests[0] or (
            self.asks_by_setpoint and frame[0] == self.setpoints[0][0]
        )

    def pack(self, joint: int, position: float, velocity: float) -> None:
        """Write a setpoint with the gains of the profile."""
        self._pack(joint, self._data[joint], position, velocity, self._gains[joint])

    def restated(self, joint: int, data: bytes, position: float) -> bytes:
        """Data of a setpoint that was heard, with another position, and no velocity."""
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
        """Position and velocity of a setpoint; None for any other command."""
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
        """Request of a tick to one motor."""

    @abstractmethod
    def is_setpoint(self, can_id: int, data: bytes | bytearray) -> bool:
        """True for a setpoint among the frames that command a motor."""

    @abstractmethod
    def fields(self, data: bytes | bytearray) -> tuple[int, ...]:
        """Position, velocity, stiffness and damping of a setpoint, in counts."""

    @abstractmethod
    def write_fields(self, data: bytearray, fields: tuple[int, ...]) -> None:
        """Write these into the data of a setpoint."""

    @abstractmethod
    def answering(self, can_id: int) -> int | None:
        """Joint whose motor answers by this identifier."""

    @abstractmethod
    def commanded(self, can_id: int) -> int | None:
        """Joint whose motor a frame with this identifier commands."""

    @abstractmethod
    def masters(self, can_id: int) -> bool:
        """True for a frame that a master of these motors may send."""

    def zeroed(self, can_id: int) -> int | None:
        """Joint whose motor is given another zero, where one that holds takes it."""
        return None

    @abstractmethod
    def answer_of(
        self, joint: int, can_id: int, data: bytes | bytearray
    ) -> Feedback | Output | None:
        """Answer of a motor; None for a frame that cannot be its own."""

    @abstractmethod
    def enabling(self, joint: int) -> Sequence[Frame]:
        """Frames that give a motor its power, after its setpoint."""

    @abstractmethod
    def disabling(self, joint: int) -> Frame:
        """Frame that takes a motor's power."""

    @abstractmethod
    def clearing(self, joint: int) -> Frame:
        """Frame that clears a motor's fault."""

    @abstractmethod
    def time_out_of(self, can_id: int, data: bytes | bytearray) -> tuple[int, bool] | None:
        """Joint, and whether it has a time-out from now on, of a frame that sets it."""


def scaled(value: float, most: float, bits: int) -> int:
    """Value between -most and +most as a whole number of so many bits, the nearest."""
    highest = (1 << bits) - 1
    return min(max(round((value + most) * highest / (2.0 * most)), 0), highest)


def steps_of(profile: Any, bits: Sequence[int]) -> Counts:
    """Value of one count, of so many bits each."""
    most = profile.position_max, profile.velocity_max, profile.torque_max_Nm
    position, velocity, torque = (2.0 * m / ((1 << b) - 1) for m, b in zip(most, bits, strict=True))
    return position, velocity, torque
