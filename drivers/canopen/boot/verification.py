"""Verification of a drive's set-up by SDO, read-only.

A set-up may be lost because another tool has written to the drive, or because the drive restarted
unnoticed; neither heartbeat nor statusword shows that.
"""

from collections.abc import Iterator
from typing import Final

from common.errors import DriveError, SilentDriveError
from drivers.canopen.boot.identity import DriveIdentity
from drivers.canopen.boot.pdo_mapping import required_pdos
from drivers.canopen.boot.required_objects import (
    CYCLIC_SYNCHRONOUS_VELOCITY,
    MODES_SHOWN,
    DriveSetup,
    RequiredValue,
    required_values,
)
from drivers.canopen.boot.sdo import ObjectAccess
from drivers.canopen.cia402 import DriveState, drive_state
from drivers.canopen.emergency_codes import OF_COMMUNICATION, emergency_words

_NUMBERS: Final = ((1, "vendor"), (2, "product"), (4, "serial"))


def all_required(setup: DriveSetup, period_ms: int, master_node: int) -> list[RequiredValue]:
    """All required objects of a drive, PDO parameters included, each once: a value written by the
    configuration takes precedence over a limit."""
    ours, others = required_pdos(setup)
    rows = [
        *required_values(setup, period_ms, master_node),
        *(row for pdo in ours for row in pdo.rows),
        *others,
    ]
    return list({(row.index, row.subindex): row for row in rows}.values())


def deviations(
    setup: DriveSetup,
    access: ObjectAccess,
    rows: list[RequiredValue],
    identity: DriveIdentity | None,
) -> list[str]:
    """Deviations of a drive from its set-up, as text; empty if there are none. Raises BusError.

    Each object is read once, except those that the EDS declares read-only: they were compared at
    the start and cannot have changed. `identity` is that of the start, None if there was none.
    """
    found: list[str] = []
    try:
        found += _locked(access)
        if identity is not None:
            found += _of_identity(access, identity)
        for row in rows:
            place = row.index, row.subindex
            if not access.has(*place) or not access.writable(*place):
                continue
            if not row.holds(held := access.read(*place)):
                found.append(f"{row.where} reads {row.shown(held)}, must be {row.shown(row.value)}")
        found += _of_mode(access)
    except SilentDriveError as error:
        found.append(str(error).removeprefix(f"{setup} "))
    except DriveError as error:  # it refused to be read
        found.append(str(error).removeprefix(f"{setup}: "))
    return found


def _locked(access: ObjectAccess) -> Iterator[str]:
    """Communication fault, or one of unknown cause: some drives accept no fault reset before they
    are set up again, even if they report the cause as cleared. A communication reset is harmless
    for a drive in fault."""
    statusword = access.read(0x6041)
    if drive_state(statusword) is not DriveState.FAULT:
        return
    if not access.has(0x603F):
        yield "in fault of unknown cause: it has no object 0x603F"
        return
    code = access.read(0x603F)
    if code == 0:
        yield "in fault of unknown cause: object 0x603F reads 0"
    elif code & 0xFF00 in OF_COMMUNICATION:
        yield f"in fault for {emergency_words(code)} (0x{code:04X})"


def _of_identity(access: ObjectAccess, identity: DriveIdentity) -> Iterator[str]:
    for subindex, name in _NUMBERS:
        known = getattr(identity, name)
        if known is not None and (held := access.read(0x1018, subindex)) != known:
            yield f"object 0x1018:{subindex:02X} ({name}) reads 0x{held:X}, was 0x{known:X}"


def _of_mode(access: ObjectAccess) -> Iterator[str]:
    if access.has(0x6061) and (shown := access.read(0x6061)) not in MODES_SHOWN:
        yield (
            f"object 0x6061:00 (mode of operation display) reads {shown}, must be "
            f"{CYCLIC_SYNCHRONOUS_VELOCITY}"
        )
