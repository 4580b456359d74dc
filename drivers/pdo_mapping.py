"""PDOs of one drive by SDO: everything that it has off, then ours mapped and on (CiA 301)."""

from typing import Final

from drivers.codec import Pdo, receive_pdos, transmit_pdos
from drivers.drive_setup import DriveSetup
from drivers.object_access import ObjectAccess
from errors import DriveError

_PDO_DISABLED: Final = 1 << 31
_NO_RTR: Final = 1 << 30
_EVERY_SYNC: Final = 1


def map_pdos(setup: DriveSetup, access: ObjectAccess) -> None:
    """Disable every PDO that the drive has, then map and enable ours (CiA 301, 7.5.2.36).

    Raises DriveError if it does not hold what it was told.
    """
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
