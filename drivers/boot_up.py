"""Boot-up: every drive identified, set up, read back, by SDO, before NMT operational.

Nothing is reset: a drive may be holding the arm up. Nothing is written before all drives of the
arm have shown who they are.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import can

from drivers.bus import BUS_FAILURES
from drivers.codec import Pdo, receive_pdos, transmit_pdos
from drivers.drive_setup import (
    CYCLIC_SYNCHRONOUS_VELOCITY,
    DriveSetup,
    check_drive,
    objects_to_write,
)
from drivers.object_access import ObjectAccess, sdo_network
from errors import BusError, DriveError

Progress = Callable[[str], None]

SDO_TIMEOUT_S: Final = 0.5
LISTEN_S: Final = 0.15

_SYNC: Final = 0x080
_HEARTBEAT: Final = 0x700
_CIA_402: Final = 402
_PDO_DISABLED: Final = 1 << 31
_NO_RTR: Final = 1 << 30
_EVERY_SYNC: Final = 1
# Rated current in the drive scales every current that it reports.
_RATED_CURRENT_TOLERANCE: Final = 0.005


@dataclass(frozen=True, slots=True)
class DriveIdentity:
    """Object 0x1018 of one drive; None where the drive keeps it to itself."""

    name: str
    node: int
    vendor: int
    product: int | None
    revision: int | None
    serial: int | None


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
    """Set all drives up and leave them pre-operational; `progress` gets a line for each step.

    Raises ConfigurationError (the EDS does not have what is configured; the bus is not touched),
    BusError (the bus fails, another master is there) or DriveError (a drive does not answer, is
    another one, refuses or does not hold an object).
    """
    for setup in setups:
        check_drive(setup, period_ms, master_node)
    refuse_other_master(bus, master_node, listen_s)
    with sdo_network(bus) as network:
        accesses = [ObjectAccess(network, setup, sdo_timeout_s) for setup in setups]
        identities = []
        for setup, access in zip(setups, accesses, strict=True):
            identities.append(_identify(setup, access))
            progress(f"{setup}: {_describe(identities[-1])}")
        for setup, access in zip(setups, accesses, strict=True):
            access.enter_pre_operational()
            for wanted in objects_to_write(setup, period_ms, master_node):
                access.write(wanted.object, wanted.subindex, wanted.value)
            _refuse_other_mode(setup, access)
            _map_pdos(setup, access)
            progress(f"{setup}: set up and read back")
    return tuple(identities)


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


def _identify(setup: DriveSetup, access: ObjectAccess) -> DriveIdentity:
    device_profile = access.read(0x1000) & 0xFFFF
    if device_profile != _CIA_402:
        raise DriveError(f"{setup} is not a CiA 402 drive (device profile {device_profile})")
    vendor = access.read(0x1018, 1)
    product, revision, serial = (
        access.read(0x1018, sub) if access.has(0x1018, sub) else None for sub in (2, 3, 4)
    )
    if setup.wiring.serial is not None and serial != setup.wiring.serial:
        raise DriveError(
            f"{setup} is another drive: serial number {serial}, configured {setup.wiring.serial}"
        )
    if not access.read(0x6502) >> (CYCLIC_SYNCHRONOUS_VELOCITY - 1) & 1:
        raise DriveError(f"{setup} has no cyclic synchronous velocity (bit 8 of 0x6502)")
    rated, configured = access.read(0x6075) / 1000.0, setup.wiring.rated_current_A
    if abs(rated - configured) > _RATED_CURRENT_TOLERANCE * configured:
        raise DriveError(
            f"{setup}: object 0x6075:00 says a rated current of {rated:g} A, configured "
            f"{configured:g} A"
        )
    return DriveIdentity(setup.name, setup.wiring.node, vendor, product, revision, serial)


def _describe(identity: DriveIdentity) -> str:
    known = (
        f"{what} 0x{value:X}"
        for what, value in (
            ("vendor", identity.vendor),
            ("product", identity.product),
            ("revision", identity.revision),
        )
        if value is not None
    )
    return ", ".join((*known, f"serial {identity.serial}"))


def _refuse_other_mode(setup: DriveSetup, access: ObjectAccess) -> None:
    # Some drives show a mode only when they are in operation: 0 until then.
    shown = access.read(0x6061)
    if shown not in (0, CYCLIC_SYNCHRONOUS_VELOCITY):
        raise DriveError(
            f"{setup}: object 0x6060:00 was written {CYCLIC_SYNCHRONOUS_VELOCITY}, but the drive "
            f"shows mode {shown} (0x6061)"
        )


def _map_pdos(setup: DriveSetup, access: ObjectAccess) -> None:
    """Disable every PDO that the drive has, then map and enable ours (CiA 301, 7.5.2.36)."""
    node = setup.wiring.node
    for first in (0x1400, 0x1800):
        for communication in range(first, first + 0x200):
            if access.has(communication, 1):
                _disable(setup, access, communication)
    for pdo in receive_pdos(setup.profile, node):
        _map(setup, access, pdo, 0x1400 + pdo.number - 1, 0)
    for pdo in transmit_pdos(setup.profile, node):
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
    for number, field in enumerate(pdo.fields, start=1):
        access.write(mapping, number, field.index << 16 | field.subindex << 8 | field.bits)
    access.write(mapping, 0, len(pdo.fields))
    access.write_only(communication, 1, pdo.cob_id | flags)
    # Whether remote requests are answered is the drive's own choice.
    held = access.read(communication, 1)
    if held & ~_NO_RTR != pdo.cob_id:
        raise DriveError(
            f"{setup}: object 0x{communication:04X}:01 was written 0x{pdo.cob_id | flags:08X}, "
            f"reads 0x{held:08X}"
        )
