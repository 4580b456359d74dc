"""PDOs of one drive by SDO: everything that it has off, then ours mapped and on (CiA 301)."""

from typing import Final

from drivers.boot.required_objects import DriveSetup
from drivers.boot.sdo import ObjectAccess
from drivers.codec import Pdo, receive_pdos, transmit_pdos
from errors import DriveError

_PDO_DISABLED: Final = 1 << 31
_NO_RTR: Final = 1 << 30
_EVERY_SYNC: Final = 1


def map_pdos(setup: DriveSetup, access: ObjectAccess) -> None:
    """Disable every PDO that the drive has, then map and enable ours (CiA 301, 7.5.2.36).

    What the EDS calls read-only is compared: a drive with fixed PDOs comes up if they are ours.
    Raises DriveError if it does not hold what it was told.
    """
    ours = [(0x1400 + pdo.number - 1, pdo, 0) for pdo in receive_pdos(setup.drive)] + [
        (0x1800 + pdo.number - 1, pdo, _NO_RTR) for pdo in transmit_pdos(setup.drive)
    ]
    fixed = {index for index, _, _ in ours if not access.writable(index, 1)}
    for first in (0x1400, 0x1800):
        for communication in range(first, first + 0x200):
            if access.has(communication, 1) and communication not in fixed:
                _disable(setup, access, communication)
    for communication, pdo, flags in ours:
        _map(setup, access, pdo, communication, flags)


def _disable(setup: DriveSetup, access: ObjectAccess, communication: int) -> None:
    held = access.read(communication, 1)
    if access.writable(communication, 1):
        access.write_only(communication, 1, held | _PDO_DISABLED)
        held = access.read(communication, 1)
    if not held & _PDO_DISABLED:
        raise DriveError(
            f"{setup}: object 0x{communication:04X}:01 reads 0x{held:08X}: the PDO stays enabled"
        )


def _map(setup: DriveSetup, access: ObjectAccess, pdo: Pdo, communication: int, flags: int) -> None:
    mapping = communication + 0x200
    access.hold(communication, 2, _EVERY_SYNC)
    if access.writable(mapping, 0):
        access.write(mapping, 0, 0)
    for number, part in enumerate(pdo.fields, start=1):
        access.hold(mapping, number, part.index << 16 | part.subindex << 8 | part.bits)
    access.hold(mapping, 0, len(pdo.fields))
    _enable(setup, access, pdo.cob_id, communication, flags)


def _enable(
    setup: DriveSetup, access: ObjectAccess, cob_id: int, communication: int, flags: int
) -> None:
    verb = "must be"
    if access.writable(communication, 1):
        access.write_only(communication, 1, cob_id | flags)
        verb = "was written"
    # Whether remote requests are answered is the drive's own choice.
    held = access.read(communication, 1)
    if held & ~_NO_RTR != cob_id:
        raise DriveError(
            f"{setup}: object 0x{communication:04X}:01 {verb} 0x{cob_id | flags:08X}, "
            f"reads 0x{held:08X}"
        )
