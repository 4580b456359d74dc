"""Steps of one drive's boot-up. Each can safely be repeated."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from common.errors import DriveError
from drivers.canopen.boot.identity import DriveIdentity, identify
from drivers.canopen.boot.pdo_mapping import map_pdos
from drivers.canopen.boot.required_objects import (
    CYCLIC_SYNCHRONOUS_VELOCITY,
    MODES_SHOWN,
    DriveSetup,
    Group,
    RequiredValue,
)
from drivers.canopen.boot.sdo import ObjectAccess
from drivers.canopen.cia402 import QUICK_STOP, DriveState, drive_state, in_words
from drivers.canopen.codec import link_side, quantity
from drivers.canopen.ids import ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION
from drivers.canopen.settings import PdoEntry
from drivers.stopping.witness import PAUSE_S, STILL_RAD

_POLL_S: Final = 0.01
#: Time until a drive must display a new mode, which its own cycle takes over [s].
_MODE_S: Final = 0.3
#: Speed below which a joint stands [rad/s at the link].
STANDSTILL: Final = 0.02
#: Time allowed beyond the ramp until a drive stands and reports it [s], and the longest total,
#: whatever its ramp [s].
_SETTLING_S: Final = 0.3
_LONGEST_STOP_S: Final = 2.5
_MOVES: Final = (
    DriveState.OPERATION_ENABLED,
    DriveState.QUICK_STOP_ACTIVE,
    DriveState.FAULT_REACTION_ACTIVE,
)


@dataclass(slots=True)
class BootingDrive:
    """One drive during boot-up."""

    setup: DriveSetup
    access: ObjectAccess
    required: list[RequiredValue]
    step_timeout_s: float
    booted: threading.Event  # its boot-up message has arrived
    meanwhile: Callable[[], None]  # called while waiting
    sleep: Callable[[float], None]
    identity: DriveIdentity | None = None
    fault: int | None = None  # code of the fault for which its communication was reset
    remarks: list[str] = field(default_factory=list)

    def wait(self, seconds: float) -> None:
        """Wait, with a call of `meanwhile`."""
        self.meanwhile()
        self.sleep(seconds)

    def write(self, group: Group) -> None:
        """Write and read back the required objects of a group, except optional ones that the EDS
        lacks."""
        for row in self.required:
            if row.group != group or (row.without and not self.access.has(*_place(row))):
                continue
            self.access.hold(*_place(row), row.value, row.where)


@dataclass(frozen=True, slots=True)
class Step:
    """One step. `run` raises DriveError or BusError."""

    name: str
    run: Callable[[BootingDrive], None]


def _identify(drive: BootingDrive) -> None:
    drive.identity = identify(drive.setup, drive.access)


def _quick_stop(drive: BootingDrive) -> None:
    """Quick-stop, by SDO, a drive that is found in operation: its master died, or it never received
    a stop. SDO needs neither SYNC nor mapping."""
    statusword = drive.access.read(0x6041)
    if drive_state(statusword) is DriveState.OPERATION_ENABLED:
        drive.access.write_only(0x6040, 0, QUICK_STOP)
        drive.remarks.append(f"was found in {in_words(statusword)}: quick stop commanded")


def _await_standstill(drive: BootingDrive) -> None:
    """Wait until a drive with torque stands. Nothing is written to a moving drive: a changed ramp,
    mode or limit could have any effect."""
    statusword = drive.access.read(0x6041)
    if drive_state(statusword) not in _MOVES:
        return
    velocity = _velocity(drive)
    stop_s = min(_ramp_s(drive, velocity) + _SETTLING_S, _LONGEST_STOP_S)
    left_s = stop_s + PAUSE_S
    while left_s > 0.0:
        left = drive_state(statusword) not in (
            DriveState.OPERATION_ENABLED,
            DriveState.FAULT_REACTION_ACTIVE,
        )
        if left and abs(velocity) < STANDSTILL:
            if _rests(drive):
                return
            left_s -= PAUSE_S
        drive.wait(_POLL_S)
        left_s -= _POLL_S
        statusword, velocity = drive.access.read(0x6041), _velocity(drive)
    raise DriveError(
        f"{drive.setup} does not stop: {stop_s:.2f} s after a quick stop it is in "
        f"{in_words(statusword)} and moves at {velocity:+.3f} rad/s"
        + ("" if abs(velocity) >= STANDSTILL else ", but its positions change")
    )


def _rests(drive: BootingDrive) -> bool:
    """True if its positions rest, too: a velocity alone may be wrong. Observed briefly, since a
    drive that waits for our heartbeat may lose its torque meanwhile."""
    before = _positions(drive)
    for _ in range(math.ceil(PAUSE_S / _POLL_S)):
        drive.wait(_POLL_S)
    pairs = zip(before, _positions(drive), strict=True)
    return all(abs(now - then) <= STILL_RAD for then, now in pairs)


def _positions(drive: BootingDrive) -> list[float]:
    """Positions at the link [rad]: of the link, and of the motor if it has a sensor."""
    of = drive.setup.drive
    entries: list[PdoEntry] = ["link_position"]
    if of.profile.motor_position is not None:
        entries.append("motor_position")
    places = [(quantity(of.profile, entry), link_side(of, entry)[0]) for entry in entries]
    return [gain * drive.access.read(where.object, where.subindex) for where, gain in places]


def _velocity(drive: BootingDrive) -> float:
    """Velocity of the motor, at the link [rad/s]."""
    where = drive.setup.drive.profile.motor_velocity
    gain, bias = link_side(drive.setup.drive, "motor_velocity")
    return gain * drive.access.read(where.object, where.subindex) + bias


def _ramp_s(drive: BootingDrive, velocity: float) -> float:
    """Time to brake from `velocity` by the present ramp of the drive [s]."""
    ramp, gear = drive.setup.drive.profile.quick_stop_deceleration, drive.setup.drive.wiring.gear
    braking = drive.access.read(ramp.object, ramp.subindex) * ramp.scale / gear
    return abs(velocity) / braking if braking > 0.0 else math.inf


def _recover(drive: BootingDrive) -> None:
    """Reset the communication of a drive in fault; it has no torque, so no load falls."""
    state = drive_state(drive.access.read(0x6041))
    if state is not DriveState.FAULT:
        return
    drive.fault = drive.access.read(0x603F) if drive.access.has(0x603F) else 0
    drive.booted.clear()
    drive.access.nmt(RESET_COMMUNICATION, "reset communication")


def _await_boot(drive: BootingDrive) -> None:
    if drive.fault is None:
        return
    for _ in range(math.ceil(drive.step_timeout_s / _POLL_S)):
        if drive.booted.is_set():
            break
        drive.wait(_POLL_S)
    else:
        raise DriveError(
            f"{drive.setup}: no boot-up message after NMT reset communication (it was in "
            f"fault, 0x{drive.fault:04X})"
        )
    drive.remarks.append(f"was in fault (0x{drive.fault:04X}): communication was reset")


def _leave_operational(drive: BootingDrive) -> None:
    """Disable PDOs by NMT pre-operational; the drive keeps its power state and torque."""
    drive.access.nmt(ENTER_PRE_OPERATIONAL, "pre-operational")


def _choose_mode(drive: BootingDrive) -> None:
    drive.write("mode")
    if not drive.access.has(0x6061):
        return
    for _ in range(math.ceil(_MODE_S / _POLL_S)):
        if (shown := drive.access.read(0x6061)) in MODES_SHOWN:
            return
        drive.wait(_POLL_S)
    raise DriveError(
        f"{drive.setup}: object 0x6060:00 was written {CYCLIC_SYNCHRONOUS_VELOCITY}, but the "
        f"drive shows mode {shown} (0x6061)"
    )


def _map_pdos(drive: BootingDrive) -> None:
    map_pdos(drive.setup, drive.access)


def _place(row: RequiredValue) -> tuple[int, int]:
    return row.index, row.subindex


def _writes(group: Group) -> Callable[[Any], None]:
    return lambda drive: drive.write(group)


WAKE: Final = Step("pre-operational", _leave_operational)

#: Steps that all drives complete before the next step: nothing is written before all are identified
#: and stand, and drives that have to brake or boot do so in parallel.
TOGETHER: Final = (
    Step("identity", _identify),
    Step("quick stop", _quick_stop),
    Step("standstill", _await_standstill),
    Step("recovery", _recover),
    Step("boot", _await_boot),
)
#: Steps that one drive completes before the next drive.
SET_UP: Final = (
    WAKE,
    Step("communication", _writes("communication")),
    Step("stopping", _writes("stopping")),
    Step("mode", _choose_mode),
    Step("limits", _writes("limits")),
    Step("own objects", _writes("own objects")),
    Step("PDO mapping", _map_pdos),
)
