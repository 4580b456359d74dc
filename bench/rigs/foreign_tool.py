"""Writes of another program's tool to a drive that is ours: SDO downloads to its server."""

import struct
from typing import Final

from drivers.canopen.codec import receive_pdos
from drivers.canopen.ids import SYNC
from drivers.canopen.settings import CanopenDrive

#: Command specifiers of an expedited download of so many bytes (CiA 301).
_SPECIFIERS: Final = {1: 0x2F, 2: 0x2B, 4: 0x23}
OTHER_SYNC: Final = 0x81  # An unused identifier


def download(index: int, value: int, size: int, subindex: int = 0) -> bytes:
    """Expedited download of `size` bytes: 1, 2 or 4."""
    return struct.pack("<BHBI", _SPECIFIERS[size], index, subindex, value)


def sync_moved(cob_id: int = OTHER_SYNC) -> bytes:
    """SYNC gets another identifier (0x1005)."""
    return download(0x1005, cob_id, 4)


def sync_back() -> bytes:
    """SYNC gets its own identifier again."""
    return sync_moved(SYNC)


def mode_changed(mode: int) -> bytes:
    """Another mode of operation is chosen (0x6060)."""
    return download(0x6060, mode, 1)


def rpdo_off(drive: CanopenDrive) -> bytes:
    """The RPDO that brings the target velocity is turned off."""
    (pdo,) = [
        pdo
        for pdo in receive_pdos(drive)
        if any(field.entry == "target_velocity" for field in pdo.fields)
    ]
    return download(0x1400 + pdo.number - 1, 1 << 31 | pdo.cob_id, 4, subindex=1)
