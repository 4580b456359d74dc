"""Boot-up: every drive identified, set up, read back, by SDO, before NMT operational.

One sequence of steps per drive, `IDENTIFY` and then `SET_UP`. Each step may be done again without
harm, has a time of its own and as many tries. Nothing is written before all drives of the arm have
shown who they are. Nothing is reset but the communication of a drive in fault, which has no torque
and so holds nothing up: some drives let go of the loss of their master (0x8130) only so.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import can
import canopen

from drivers.bus import BUS_FAILURES
from drivers.cia402 import DriveState, drive_state
from drivers.codec import Pdo, receive_pdos, transmit_pdos
from drivers.drive_setup import (
    CYCLIC_SYNCHRONOUS_VELOCITY,
    DriveSetup,
    Group,
    Wanted,
    check_drive,
    lacks,
    rated_object,
    wanted,
)
from drivers.object_access import ObjectAccess, sdo_network
from errors import BusError, DriveError, SilentDriveError

Progress = Callable[[str], None]

SDO_TIMEOUT_S: Final = 0.5
AGAIN_TIMEOUT_S: Final = 0.15
LISTEN_S: Final = 0.15
TRIES: Final = 3
#: A step that is answered, but for ever, ends after so long.
STEP_S: Final = 3.0
#: How long a drive may take to boot after NMT reset communication, in time-outs of one SDO.
BOOT_PATIENCE: Final = 30

_SYNC: Final = 0x080
_HEARTBEAT: Final = 0x700
_OPERATIONAL: Final = 5
_CIA_402: Final = 402
_ENTER_PRE_OPERATIONAL: Final = 128
_RESET_COMMUNICATION: Final = 130
_PDO_DISABLED: Final = 1 << 31
_NO_RTR: Final = 1 << 30
_EVERY_SYNC: Final = 1
# What is rated in the drive scales every current or torque that it reports.
_RATED_TOLERANCE: Final = 0.005


@dataclass(frozen=True, slots=True)
class DriveIdentity:
    """Who one drive is: objects 0x1018 and 0x1008; None where the drive keeps it to itself."""

    name: str
    node: int
    vendor: int
    product: int | None
    revision: int | None
    serial: int | None
    device: str | None = None

    def __str__(self) -> str:
        numbers = (("vendor", self.vendor), ("product", self.product), ("revision", self.revision))
        known = [f"{what} 0x{value:X}" for what, value in numbers if value is not None]
        device = [self.device] if self.device else []
        serial = "no serial number" if self.serial is None else f"serial {self.serial}"
        return ", ".join([*device, *known, serial])


@dataclass(slots=True)
class _Drive:
    """One drive on its way up."""

    setup: DriveSetup
    access: ObjectAccess
    wanted: list[Wanted]
    sdo_timeout_s: float
    booted: threading.Event  # its boot-up message has come
    beat: Callable[[], None]  # the master's heartbeat, if it is time for it
    identity: DriveIdentity | None = None
    remarks: list[str] = field(default_factory=list)

    def write(self, group: Group) -> None:
        """Write and read back what is wanted; what the EDS lacks is left out, and told."""
        for row in self.wanted:
            if row.group != group or (row.without and not self.access.has(*_place(row))):
                continue
            if self.access.writable(*_place(row)):
                self.access.write(*_place(row), row.value, row.where)
            else:
                self.access.compare(*_place(row), row.value, row.where)


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the sequence."""

    name: str
    run: Callable[[_Drive], None]


def boot_up(
    bus: can.BusABC,
    setups: Sequence[DriveSetup],
    *,
    period_ms: int,
    master_node: int = 127,
    progress: Progress = lambda line: None,
    listen_s: float = LISTEN_S,
    sdo_timeout_s: float = SDO_TIMEOUT_S,
) -> tuple[DriveIdentity, ...]:
    """Set all drives up and leave them pre-operational; `progress` gets lines for people.

    Raises ConfigurationError (the EDS does not have what is configured; the bus is not touched),
    BusError (the bus fails, another master is there) or DriveError (a drive does not answer, is
    another one, refuses or does not hold an object).
    """
    for setup in setups:
        check_drive(setup, period_ms, master_node)
    refuse_other_master(bus, master_node, listen_s)
    return _bring_up(bus, setups, period_ms, master_node, progress, sdo_timeout_s, None)


def boot_up_again(
    bus: can.BusABC,
    setups: Sequence[DriveSetup],
    *,
    period_ms: int,
    master_node: int = 127,
    progress: Progress = lambda line: None,
) -> tuple[DriveIdentity, ...]:
    """Set some drives of a standing arm up again, while the others go on hearing their master.

    The sequence itself sends the heartbeat while it waits for answers, so that one that hangs falls
    silent. A drive that does not answer ends it within a second. Raises BusError or DriveError.
    """
    beat_s = min(setup.profile.master_timeout_ms for setup in setups) / 6000.0
    return _bring_up(bus, setups, period_ms, master_node, progress, AGAIN_TIMEOUT_S, beat_s)


def forget_master(
    bus: can.BusABC, setups: Sequence[DriveSetup], *, sdo_timeout_s: float = SDO_TIMEOUT_S
) -> None:
    """After the last tick: tell the drives to mind no master's heartbeat any more (0x1016:1 = 0).

    For drives that are off or hold in quick stop, so that our leaving is no fault to them. Every
    drive is told; then the first DriveError is raised, if there was one.
    """
    errors = []
    with sdo_network(bus) as network:
        for setup in setups:
            try:
                ObjectAccess(network, setup, sdo_timeout_s).write(0x1016, 1, 0)
            except DriveError as error:
                errors.append(error)
    if errors:
        raise errors[0]


def refuse_other_master(bus: can.BusABC, master_node: int, listen_s: float) -> None:
    """Listen for what only a master sends; raises BusError if somebody does."""
    deadline = time.monotonic() + listen_s
    while (remaining := deadline - time.monotonic()) > 0.0:
        try:
            frame = bus.recv(remaining)
        except BUS_FAILURES as error:
            raise BusError(f"bus {bus.channel_info}: {error}") from error
        if frame is None or frame.is_error_frame or frame.is_extended_id:
            continue
        if frame.arbitration_id == _HEARTBEAT + master_node:
            raise BusError(f"another master (node {master_node}) is on this bus")
        if frame.arbitration_id == _SYNC:
            raise BusError("another master is on this bus: somebody sends SYNC")


# --- the sequence -----------------------------------------------------------------------------


def _bring_up(
    bus: can.BusABC,
    setups: Sequence[DriveSetup],
    period_ms: int,
    master_node: int,
    progress: Progress,
    sdo_timeout_s: float,
    heartbeat_s: float | None,
) -> tuple[DriveIdentity, ...]:
    with sdo_network(bus) as network:
        beat = _Beat(network, master_node, heartbeat_s)
        drives = []
        for setup in setups:
            access = ObjectAccess(network, setup, sdo_timeout_s, beat)
            rows = wanted(setup, period_ms, master_node)
            booted = _listen_for_boot_up(network, setup.wiring.node)
            drives.append(_Drive(setup, access, rows, sdo_timeout_s, booted, beat))
        for drive in drives:
            _run(IDENTIFY, drive)
            progress(f"{drive.setup}: {drive.identity}")
        for name, setup in {drive.setup.wiring.profile: drive.setup for drive in drives}.items():
            for remark in lacks(setup, period_ms, master_node):
                progress(f"drive profile {name}: {remark}")
        for drive in drives:
            begun = time.monotonic()
            for step in SET_UP:
                _run(step, drive)
            for remark in drive.remarks:
                progress(f"{drive.setup}: {remark}")
            took_ms = 1000.0 * (time.monotonic() - begun)
            names = ", ".join(step.name for step in SET_UP)
            progress(f"{drive.setup}: set up and read back in {took_ms:.0f} ms ({names})")
    return tuple(drive.identity for drive in drives if drive.identity is not None)


def _run(step: Step, drive: _Drive) -> None:
    """Do one step, again if the drive was silent; its name goes into every error."""
    for tries in range(1, TRIES + 1):
        drive.access.deadline = time.monotonic() + STEP_S
        try:
            if tries > 1:
                drive.access.settle()
                # A drive that somebody has stopped answers no SDO.
                _leave_operational(drive)
            step.run(drive)
        except SilentDriveError as error:
            if tries == TRIES:
                raise SilentDriveError(
                    f"{error}; step `{step.name}`, tried {TRIES} times"
                ) from error
            drive.remarks.append(f"step `{step.name}` was done again: {error}")
        except DriveError as error:
            raise DriveError(f"{error}; step `{step.name}`") from error
        else:
            return


class _Beat:
    """The master's heartbeat while somebody waits; none where `every_s` is None."""

    def __init__(self, network: canopen.Network, master_node: int, every_s: float | None) -> None:
        self._network, self._cob_id, self._every_s = network, _HEARTBEAT + master_node, every_s
        self._next_s = 0.0

    def __call__(self) -> None:
        now = time.monotonic()
        if self._every_s is not None and now >= self._next_s:
            self._next_s = now + self._every_s
            self._network.send_message(self._cob_id, [_OPERATIONAL])


def _listen_for_boot_up(network: canopen.Network, node: int) -> threading.Event:
    booted = threading.Event()

    def hear(_: int, data: bytearray, __: float) -> None:
        if data[:1] == b"\0":
            booted.set()

    network.subscribe(_HEARTBEAT + node, hear)
    return booted


# --- its steps --------------------------------------------------------------------------------


def _identify(drive: _Drive) -> None:
    setup, access = drive.setup, drive.access
    device_profile = access.read(0x1000) & 0xFFFF
    if device_profile != _CIA_402:
        raise DriveError(
            f"{setup} is not a CiA 402 drive: object 0x1000:00 says device profile "
            f"{device_profile}, expected {_CIA_402}"
        )
    vendor = access.read(0x1018, 1)
    product, revision, serial = (
        access.read(0x1018, sub) if access.has(0x1018, sub) else None for sub in (2, 3, 4)
    )
    if setup.wiring.serial is not None and serial != setup.wiring.serial:
        raise DriveError(
            f"{setup} is another drive: object 0x1018:04 says serial number {serial}, configured "
            f"{setup.wiring.serial}"
        )
    device = access.read_text(0x1008) if access.has(0x1008) else None
    node = setup.wiring.node
    drive.identity = DriveIdentity(setup.name, node, vendor, product, revision, serial, device)
    modes = access.read(0x6502) if access.has(0x6502) else -1
    if not modes >> (CYCLIC_SYNCHRONOUS_VELOCITY - 1) & 1:
        raise DriveError(
            f"{setup} has no cyclic synchronous velocity: object 0x6502:00 reads 0x{modes:08X}, "
            "bit 8 is needed"
        )
    _refuse_other_rating(setup, access)


def _refuse_other_rating(setup: DriveSetup, access: ObjectAccess) -> None:
    index, wiring, what = rated_object(setup.profile), setup.wiring, setup.profile.effort
    in_current = what == "current"
    configured = wiring.rated_current_A if in_current else wiring.rated_torque_Nm
    unit = "A" if in_current else "Nm"
    if configured is None or not access.has(index):
        return
    rated = access.read(index) / 1000.0
    if abs(rated - configured) > _RATED_TOLERANCE * configured:
        raise DriveError(
            f"{setup}: object 0x{index:04X}:00 says a rated {what} of {rated:g} {unit}, configured "
            f"{configured:g} {unit}"
        )


def _recover(drive: _Drive) -> None:
    """A drive in fault: reset its communication, and wait until it has booted."""
    state = drive_state(drive.access.read(0x6041))
    if state is not DriveState.FAULT:
        return
    code = drive.access.read(0x603F) if drive.access.has(0x603F) else 0
    drive.booted.clear()
    drive.access.nmt(_RESET_COMMUNICATION, "reset communication")
    give_up = time.monotonic() + min(BOOT_PATIENCE * drive.sdo_timeout_s, STEP_S)
    while not drive.booted.wait(0.01):
        drive.beat()
        if time.monotonic() > give_up:
            raise DriveError(
                f"{drive.setup}: no boot-up message after NMT reset communication (it was in "
                f"fault, 0x{code:04X})"
            )
    drive.remarks.append(f"was in fault (0x{code:04X}): communication was reset")


def _leave_operational(drive: _Drive) -> None:
    """PDOs off; the drive keeps the power state and the torque that it has."""
    drive.access.nmt(_ENTER_PRE_OPERATIONAL, "pre-operational")


def _choose_mode(drive: _Drive) -> None:
    drive.write("mode")
    # Some drives show a mode only when they are in operation: 0 until then.
    if drive.access.has(0x6061):
        shown = drive.access.read(0x6061)
        if shown not in (0, CYCLIC_SYNCHRONOUS_VELOCITY):
            raise DriveError(
                f"{drive.setup}: object 0x6060:00 was written {CYCLIC_SYNCHRONOUS_VELOCITY}, but "
                f"the drive shows mode {shown} (0x6061)"
            )


def _map_pdos(drive: _Drive) -> None:
    """Disable every PDO that the drive has, then map and enable ours (CiA 301, 7.5.2.36)."""
    setup, access = drive.setup, drive.access
    for first in (0x1400, 0x1800):
        for communication in range(first, first + 0x200):
            if access.has(communication, 1):
                _disable(setup, access, communication)
    for pdo in receive_pdos(setup.profile, setup.wiring.node):
        _map(setup, access, pdo, 0x1400 + pdo.number - 1, 0)
    for pdo in transmit_pdos(setup.profile, setup.wiring.node):
        _map(setup, access, pdo, 0x1800 + pdo.number - 1, _NO_RTR)


def _disable(setup: DriveSetup, access: ObjectAccess, communication: int) -> None:
    access.write_only(communication, 1, access.read(communication, 1) | _PDO_DISABLED)
    held = access.read(communication, 1)
    if not held & _PDO_DISABLED:
        raise DriveError(
            f"{setup}: object 0x{communication:04X}:01 reads 0x{held:08X}: the PDO stays enabled"
        )


def _map(setup: DriveSetup, access: ObjectAccess, pdo: Pdo, communication: int, flags: int) -> None:
    mapping = communication + 0x200
    access.write(communication, 2, _EVERY_SYNC)
    access.write(mapping, 0, 0)
    for number, part in enumerate(pdo.fields, start=1):
        access.write(mapping, number, part.index << 16 | part.subindex << 8 | part.bits)
    access.write(mapping, 0, len(pdo.fields))
    access.write_only(communication, 1, pdo.cob_id | flags)
    # Whether remote requests are answered is the drive's own choice.
    held = access.read(communication, 1)
    if held & ~_NO_RTR != pdo.cob_id:
        raise DriveError(
            f"{setup}: object 0x{communication:04X}:01 was written 0x{pdo.cob_id | flags:08X}, "
            f"reads 0x{held:08X}"
        )


def _place(row: Wanted) -> tuple[int, int]:
    return row.index, row.subindex


def _writes(group: Group) -> Callable[[Any], None]:
    return lambda drive: drive.write(group)


IDENTIFY: Final = Step("identity", _identify)
SET_UP: Final = (
    Step("recovery", _recover),
    Step("pre-operational", _leave_operational),
    Step("communication", _writes("communication")),
    Step("stopping", _writes("stopping")),
    Step("mode", _choose_mode),
    Step("limits", _writes("limits")),
    Step("own objects", _writes("own objects")),
    Step("PDO mapping", _map_pdos),
)
