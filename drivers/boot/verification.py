"""Verification: what a drive must hold, read by SDO without writing anything.

A set-up that was written once may not be there any more: another tool has written to the drive, or
it has restarted and nobody heard it. No heartbeat and no statusword shows that.
"""

from collections.abc import Iterator
from typing import Final

from drivers.boot.identity import DriveIdentity
from drivers.boot.pdo_mapping import wanted_pdos
from drivers.boot.required_objects import (
    CYCLIC_SYNCHRONOUS_VELOCITY,
    MODES_SHOWN,
    DriveSetup,
    Wanted,
    wanted,
)
from drivers.boot.sdo import ObjectAccess
from drivers.cia402 import DriveState, drive_state
from drivers.events import COMMUNICATION_ERROR, PROTOCOL_ERROR, emergency_words
from errors import DriveError, SilentDriveError

_NUMBERS: Final = ((1, "vendor"), (2, "product"), (4, "serial"))


def all_wanted(setup: DriveSetup, period_ms: int, master_node: int) -> list[Wanted]:
    """Everything that a drive of this EDS shall hold, its PDOs included, each object once: what
    the configuration writes has the last word on a limit."""
    ours, others = wanted_pdos(setup)
    rows = [
        *wanted(setup, period_ms, master_node),
        *(row for pdo in ours for row in pdo.rows),
        *others,
    ]
    return list({(row.index, row.subindex): row for row in rows}.values())


def deviations(
    setup: DriveSetup, access: ObjectAccess, rows: list[Wanted], identity: DriveIdentity | None
) -> list[str]:
    """What a drive does not hold, in words; empty if it holds all. Raises BusError.

    Each object is read once. One that the EDS calls read-only cannot have changed since the start,
    where it was compared; `identity` is that of the start, None if there was none.
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
    except DriveError as error:  # it refuses to say
        found.append(str(error).removeprefix(f"{setup}: "))
    return found


def _locked(access: ObjectAccess) -> Iterator[str]:
    """A fault of communication, or of no known cause: some drives take no fault reset before they
    are set up again, whatever they say is over. A reset of communication harms none in fault."""
    statusword = access.read(0x6041)
    if drive_state(statusword) is not DriveState.FAULT:
        return
    if not access.has(0x603F):
        yield "in fault, and it has no object 0x603F that says why"
        return
    code = access.read(0x603F)
    if code == 0:
        yield "in fault, and object 0x603F does not say why"
    elif code & 0xFF00 in (COMMUNICATION_ERROR, PROTOCOL_ERROR):
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
