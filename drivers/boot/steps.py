"""The steps of one drive's boot-up. Each may be done again without harm."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from drivers.boot.identity import DriveIdentity, identify
from drivers.boot.pdo_mapping import map_pdos
from drivers.boot.required_objects import CYCLIC_SYNCHRONOUS_VELOCITY, DriveSetup, Group, Wanted
from drivers.boot.sdo import ObjectAccess
from drivers.cia402 import DriveState, drive_state
from drivers.ids import ENTER_PRE_OPERATIONAL, RESET_COMMUNICATION
from errors import DriveError

_LOOK_S: Final = 0.01
#: A drive may go on showing the mode it had until its own cycle has taken the new one over.
_MODE_S: Final = 0.3
# Some drives show a mode only when they are in operation: 0 until then.
_MODES_SHOWN: Final = (0, CYCLIC_SYNCHRONOUS_VELOCITY)


@dataclass(slots=True)
class BootingDrive:
    """One drive on its way up."""

    setup: DriveSetup
    access: ObjectAccess
    wanted: list[Wanted]
    patience_s: float  # with one step
    booted: threading.Event  # its boot-up message has come
    meanwhile: Callable[[], None]  # to be called while waiting
    identity: DriveIdentity | None = None
    fault: int | None = None  # code of the fault for which its communication was reset
    remarks: list[str] = field(default_factory=list)

    def write(self, group: Group) -> None:
        """Write and read back what is wanted; what the EDS lacks is left out, and told."""
        for row in self.wanted:
            if row.group != group or (row.without and not self.access.has(*_place(row))):
                continue
            self.access.hold(*_place(row), row.value, row.where)


@dataclass(frozen=True, slots=True)
class Step:
    """One step; raises DriveError or BusError."""

    name: str
    run: Callable[[BootingDrive], None]


def _identify(drive: BootingDrive) -> None:
    drive.identity = identify(drive.setup, drive.access)


def _recover(drive: BootingDrive) -> None:
    """A drive in fault has no torque, so that a reset of its communication lets nothing fall."""
    state = drive_state(drive.access.read(0x6041))
    if state is not DriveState.FAULT:
        return
    drive.fault = drive.access.read(0x603F) if drive.access.has(0x603F) else 0
    drive.booted.clear()
    drive.access.nmt(RESET_COMMUNICATION, "reset communication")


def _await_boot(drive: BootingDrive) -> None:
    if drive.fault is None:
        return
    give_up = time.monotonic() + drive.patience_s
    while not drive.booted.wait(_LOOK_S):
        drive.meanwhile()
        if time.monotonic() > give_up:
            raise DriveError(
                f"{drive.setup}: no boot-up message after NMT reset communication (it was in "
                f"fault, 0x{drive.fault:04X})"
            )
    drive.remarks.append(f"was in fault (0x{drive.fault:04X}): communication was reset")


def _leave_operational(drive: BootingDrive) -> None:
    """PDOs off; the drive keeps the power state and the torque that it has."""
    drive.access.nmt(ENTER_PRE_OPERATIONAL, "pre-operational")


def _choose_mode(drive: BootingDrive) -> None:
    drive.write("mode")
    if not drive.access.has(0x6061):
        return
    give_up = time.monotonic() + _MODE_S
    while (shown := drive.access.read(0x6061)) not in _MODES_SHOWN:
        if time.monotonic() > give_up:
            raise DriveError(
                f"{drive.setup}: object 0x6060:00 was written {CYCLIC_SYNCHRONOUS_VELOCITY}, but "
                f"the drive shows mode {shown} (0x6061)"
            )
        time.sleep(_LOOK_S)


def _map_pdos(drive: BootingDrive) -> None:
    map_pdos(drive.setup, drive.access)


def _place(row: Wanted) -> tuple[int, int]:
    return row.index, row.subindex


def _writes(group: Group) -> Callable[[Any], None]:
    return lambda drive: drive.write(group)


WAKE: Final = Step("pre-operational", _leave_operational)

#: Of all drives, one step after the other: nothing is written before all have shown who they are,
#: and those that have to boot do it side by side.
TOGETHER: Final = (
    Step("identity", _identify),
    Step("recovery", _recover),
    Step("boot", _await_boot),
)
#: Of one drive after the other.
SET_UP: Final = (
    WAKE,
    Step("communication", _writes("communication")),
    Step("stopping", _writes("stopping")),
    Step("mode", _choose_mode),
    Step("limits", _writes("limits")),
    Step("own objects", _writes("own objects")),
    Step("PDO mapping", _map_pdos),
)
