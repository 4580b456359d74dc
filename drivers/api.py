"""Interface between the daemon and the drives of one arm; the daemon does not know which bus it is.

Another make of drive is one more folder beside `canopen/`, with a class that implements `Drives` or
`BootableDrives`. Vectors have shape (n,), one row per joint, in SI units at the link; times are in
seconds and are passed in by the caller.
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
    """Target state of a drive: unpowered, following its setpoint, or stopped and holding."""

    OFF = 0
    ON = 1
    QUICK_STOP = 2


class DriveCondition(Enum):
    """Condition that a drive reports."""

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
        """True if the motor may produce torque."""
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
    """Status that one drive reports."""

    condition: DriveCondition
    state: str  # the drive's own name for its condition, as published
    detail: str  # the same, as reported in full
    supplied: bool | None  # its power stage has voltage; None before the first report
    following: bool  # it follows its setpoints


class Kind(Enum):
    """Kinds of events reported with samples. Most mean a fault, as the daemon's table says."""

    DISTURBED = "a single bus error, or an answer that came late"
    LOADED = "the bus load is too high"
    PASSIVE = "the controller is error-passive"
    OFF_BUS = "the controller is bus-off: nothing is sent or received"
    ADAPTER_GONE = "the adapter is gone: the bus must be reopened"
    FOREIGN_MASTER = "another master commands the drives"
    ABSENT = "the drives missed the master, and may have stopped by themselves"
    BAD_SETPOINT = "a target velocity that is not finite was refused"
    ERROR = "a drive reports an error"
    UNHEARD = "a drive reports that it missed the master"
    SILENT = "a drive is no longer heard"
    DROPPED = "a drive no longer accepts setpoints"
    RESTARTED = "a drive has lost its set-up"
    OLD_SAMPLES = "samples are a period old"
    REPEATED_SAMPLES = "samples repeat the previous ones instead of being measured"
    TWO_DRIVES = "two drives answer under the same identifier"
    NOT_SEEN_TO_STOP = "a drive was commanded to stop, but is not observed to stop"
    UNPROVED = "every means to stop a drive is exhausted"
    UNGUARDED = "nothing would hold the arm if this process died"


@dataclass(frozen=True, slots=True)
class Event:
    """Event of one tick, reported once while it lasts."""

    kind: Kind
    text: str  # names the joints of the affected drives


@dataclass(frozen=True, slots=True)
class Samples:
    """Measurements of one tick, with drive reports and events. Immutable: the arrays are read-only.

    A joint is fresh if all of its values were measured in this tick and arrived in time, and the
    first answer of the tick came no later than usual (otherwise no joint is fresh). Other joints
    keep the last values received (NaN before the first), not necessarily of one instant.
    """

    current: Vector  # A
    link_position: Vector  # rad
    motor_velocity: Vector  # rad/s
    motor_position: Vector | None  # rad; None unless every drive sends it
    fresh: NDArray[np.bool_]
    age_s: Vector  # since the last complete sample, or since sampling was restarted [s]
    starting: NDArray[np.bool_]  # not fresh since the restart; the drive may still be starting up
    drives: tuple[DriveStatus, ...]
    events: tuple[Event, ...] = ()

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Joints (n,) whose samples arrived in this tick, whenever they were measured: sufficient
        to read the drive's status and to observe a standstill."""
        arrived: NDArray[np.bool_] = self.age_s == 0.0
        return arrived


@dataclass(frozen=True, slots=True)
class Objection:
    """Reason why the drives are unfit for an arm that yields to contact; fails an arming check."""

    check: Literal["drives", "samples", "heartbeats", "emergencies", "set-up"]
    text: str


class Drives(Protocol):
    """Drives of an arm within a tick: `sync`, `collect`, `command`. Only `collect` blocks, at most
    until its deadline; bus failures are reported as events, not raised."""

    @property
    def names(self) -> tuple[str, ...]:
        """Joints, in the order of the arm."""

    @property
    def silenced(self) -> bool:
        """True in the last stage of a stop: neither heartbeat nor setpoints are sent."""

    def sync(self, now: float) -> None:
        """Begin a tick: trigger the measurement of all drives."""

    def collect(self, deadline: float) -> Samples:
        """Samples that arrive until `deadline`, on the drives' clock."""

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        ask: bool = False,
    ) -> None:
        """Take every drive one step towards `power`, and send `velocity` [rad/s] to those in
        operation. `reset` also resets drives in fault; `ask` permits slow queries, for an arm at
        rest."""

    def unproved(self) -> tuple[str, ...]:
        """Joints commanded to stop and not confirmed at standstill since."""

    def objections(self) -> tuple[Objection, ...]:
        """Reasons against arming that are not visible in the samples."""


class BootableDrives(Drives, Protocol):
    """Drives over their life cycle: set up before the first tick, verified between ticks while the
    arm is at rest, and released after the last. Methods that block raise ContactdError."""

    @property
    def identities(self) -> Sequence[str]:
        """Make and serial number of each drive that was set up, as text."""

    @property
    def serials(self) -> Sequence[int | None]:
        """Serial number of each drive that was set up; None if it has none."""

    @property
    def master_timeout_passed(self) -> bool:
        """True once every drive has had the time to miss the master and to stop by itself."""

    def boot_up(self, report: Report) -> None:
        """Set up all drives and read the settings back; `report` receives progress lines."""

    def start(self, now: float, renewed: Sequence[int] | None = None) -> None:
        """Start cyclic operation. renewed: joints whose drives were just set up (None: all); the
        history of the other drives is kept."""

    def prove(self, meanwhile: Callable[[], None], report: Report, warn: Report) -> list[int]:
        """Read back the set-up of all drives and repeat it where it was lost; returns the joints of
        these drives. `meanwhile` is called repeatedly; `warn` receives the settings that were lost.
        `start` must follow, even after an exception."""

    def acknowledge(self) -> None:
        """Acknowledge a fault on the operator's reset: clear errors that no drive reports now."""

    def quick_stop(self) -> None:
        """Command all drives to stop and hold immediately, whatever has failed or is unknown."""

    def end(self) -> None:
        """End the session: a late setpoint no longer has any effect."""

    def disable_monitoring(self) -> None:
        """Disable the drives' monitoring of the master, now that the arm stays at rest."""
