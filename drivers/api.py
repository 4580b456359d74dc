"""Drives of one arm, as the daemon asks for them: above this line nothing says which bus it is.

Another make of bus is one more folder beside `canopen/`, with a class that does what `Drives` and
`BootableDrives` say. Vectors have shape (n,), one row per joint, SI at the link; times are in
seconds, and come from the caller.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector

Report = Callable[[str], None]


class PowerTarget(IntEnum):
    """Target of a drive: without power, following its setpoint, or stopped and holding."""

    OFF = 0
    ON = 1
    QUICK_STOP = 2


class DriveCondition(Enum):
    """Condition of a drive, as it reports it."""

    UNKNOWN = "unknown"  # or not reported yet
    OFF = "off"
    STANDBY = "standby"  # switched on, without torque
    OPERATING = "operating"  # follows its setpoints
    STOPPED = "stopped"  # stops, or holds, by itself
    FAILING = "failing"  # stops because of a fault
    FAILED = "failed"  # without torque, until a reset

    @property
    def in_fault(self) -> bool:
        """True for a drive that must be reset."""
        return self in (DriveCondition.FAILING, DriveCondition.FAILED)

    @property
    def powered(self) -> bool:
        """True where the motor may have torque."""
        return self not in _UNPOWERED

    def reached(self, target: PowerTarget) -> bool:
        """True if a drive in this condition needs no further step towards `target`."""
        return self in _REACHED[target]


_D = DriveCondition
_UNPOWERED: Final = frozenset({_D.OFF, _D.STANDBY, _D.FAILED})
_REACHED: Final = {
    PowerTarget.OFF: _UNPOWERED - {_D.STANDBY},
    PowerTarget.ON: frozenset({_D.OPERATING}),
    PowerTarget.QUICK_STOP: _UNPOWERED | {_D.STOPPED},
}


@dataclass(frozen=True, slots=True)
class DriveStatus:
    """Report of one drive about itself."""

    condition: DriveCondition
    state: str  # the drive's own name for its condition, as published
    detail: str  # the same, as reported in full
    supplied: bool | None  # its power stage has voltage; None before the first report
    following: bool  # it follows its setpoints


class Kind(Enum):
    """Kinds of events beside the samples. Most mean a fault; the daemon's table says which."""

    DISTURBED = "the bus failed for once, or an answer came late"
    LOADED = "too much of the bus is taken"
    PASSIVE = "the bus works, but badly"
    OFF_BUS = "nothing is sent or received"
    ADAPTER_GONE = "this bus must be opened anew"
    FOREIGN_MASTER = "another master commands the drives"
    ABSENT = "the drives heard nothing of us, and may have stopped by themselves"
    BAD_SETPOINT = "a target velocity that is not finite was refused"
    ERROR = "a drive reports an error"
    UNHEARD = "a drive missed us"
    SILENT = "a drive is no longer heard"
    DROPPED = "a drive no longer takes setpoints"
    RESTARTED = "a drive has lost its set-up"
    OLD_SAMPLES = "samples are a period old"
    REPEATED_SAMPLES = "samples repeat, and were not measured"
    TWO_DRIVES = "two drives answer as one"
    NOT_SEEN_TO_STOP = "a drive was commanded to stop, and is not seen to"
    UNPROVED = "nothing more can be done to stop a drive"
    UNGUARDED = "nothing would hold the arm without this process"


@dataclass(frozen=True, slots=True)
class Event:
    """Event of one tick, reported once while it lasts."""

    kind: Kind
    text: str  # with the joints of the drives that it is about


@dataclass(frozen=True, slots=True)
class Samples:
    """Measurements of one tick, reports and events beside them. Nothing of it changes afterwards:
    the arrays are read-only.

    A joint is fresh when all of it was measured in this tick, came in time, and the tick's first
    answer no later than usual (else no joint is); of any other the values are the last that came
    (NaN before the first), not necessarily of one moment.
    """

    current: Vector  # A
    link_position: Vector  # rad
    motor_velocity: Vector  # rad/s
    motor_position: Vector | None  # rad; None unless every drive sends it
    fresh: NDArray[np.bool_]
    age_s: Vector  # since the last sample that came, or since samples are asked for again [s]
    starting: NDArray[np.bool_]  # not fresh since then, and may still be starting up
    drives: tuple[DriveStatus, ...]
    events: tuple[Event, ...] = ()

    @property
    def came(self) -> NDArray[np.bool_]:
        """Joints (n,) whose samples came in this tick, of whatever moment: enough to see what a
        drive reports, and that it stands."""
        came: NDArray[np.bool_] = self.age_s == 0.0
        return came


@dataclass(frozen=True, slots=True)
class Objection:
    """Reason why drives are not fit for an arm that yields to hands; fails this arming check."""

    check: Literal["drives", "samples", "heartbeats", "emergencies", "set-up"]
    text: str


class Drives(Protocol):
    """Drives of an arm in a tick, which is `sync`, `collect`, `command`. None of these waits, but
    `collect` for its deadline; no failure of the bus is an exception."""

    @property
    def names(self) -> tuple[str, ...]:
        """Joints, in the order of the arm."""

    @property
    def silenced(self) -> bool:
        """True in the last stage of a stop: nothing is sent to the drives."""

    def sync(self, now: float) -> None:
        """Begin a tick: all drives measure now."""

    def collect(self, deadline: float) -> Samples:
        """Samples that arrive until `deadline`, on the drives' clock."""

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        ask: bool = False,
    ) -> None:
        """Lead every drive towards `power`, and let those in operation follow `velocity` [rad/s];
        `reset` also asks those in fault for a reset. `ask` permits slow questions to drives, at
        rest."""

    def unproved(self) -> tuple[str, ...]:
        """Joints commanded to stop and not confirmed at standstill since."""

    def objections(self) -> tuple[Objection, ...]:
        """Reasons against arming that samples do not show."""


class BootableDrives(Drives, Protocol):
    """Drives over their whole life: set up before the first tick, proved again between two while
    the arm stands, and let go after the last. Methods that wait raise ContactdError."""

    @property
    def identities(self) -> Sequence[str]:
        """Make and number of each drive that was set up, in words."""

    @property
    def serials(self) -> Sequence[int | None]:
        """Serial number of each drive that was set up; None where it has none."""

    @property
    def left_alone(self) -> bool:
        """True when every drive has had the time to miss us and to stop by itself."""

    def boot_up(self, report: Report) -> None:
        """Set all drives up, and read back; `report` gets lines of text."""

    def start(self, now: float, renewed: Sequence[int] | None = None) -> None:
        """Begin to tick: samples flow from now on. renewed: joints whose drives were just set up;
        None is all. What is known of the others is kept."""

    def prove(self, meanwhile: Callable[[], None], report: Report, warn: Report) -> list[int]:
        """Read back the set-up of all drives, and set up again those that lost it, whose joints are
        returned. `meanwhile` is called again and again; `warn` gets what was lost. `start` must
        follow, also after an exception."""

    def acknowledge(self) -> None:
        """A person has reset the fault: errors that no drive shows any more are over."""

    def quick_stop(self) -> None:
        """Command all drives to stop and hold, now, whatever else is broken or unknown."""

    def end(self) -> None:
        """End the session: no late setpoint acts any more."""

    def let_go(self) -> None:
        """End the drives' watch on us, as the arm is at rest for good."""
