"""Guards of a drive's objects: they refuse values beyond the limits that an EDS can express."""

import struct

from canopen.sdo.exceptions import SdoAbortedError

from simulator import objects as o
from simulator.axis import CSV
from simulator.objects import Objects
from simulator.pdo import INVALID, SYNCHRONOUS, pdo_numbers

ALLOWED = {0x605A: {0, 2, 6}, 0x605E: {0, 2}, 0x1005: range(1, 0x800)}
"""Supported values where the EDS can only give a range."""
CURRENT_LIMITS = (0x6072, 0x6073)


def guard_values(objects: Objects, peak_permille: int) -> None:
    """Make single objects refuse values that the drive does not support; peak_permille: its peak
    current [per mille of the rated current]."""
    for index in (*ALLOWED, 0x1003, 0x1016, *CURRENT_LIMITS):
        objects.guards[index] = _value_guard(index, peak_permille)
    objects.guards[0x6060] = _mode_guard(objects)


def _value_guard(index: int, peak_permille: int) -> o.Guard:
    def guard(subindex: int, value: int) -> None:
        if index in CURRENT_LIMITS and value > peak_permille:
            raise SdoAbortedError(o.TOO_HIGH)
        if (
            (index in ALLOWED and value not in ALLOWED[index])
            or (index == 0x1003 and value != 0)
            or (index == 0x1016 and value & 0xFFFF and not 1 <= value >> 16 <= 127)
        ):
            raise SdoAbortedError(o.INVALID_VALUE)

    return guard


def _mode_guard(objects: Objects) -> o.Guard:
    """Guard of the mode: it accepts the modes in 6502 and 0 (none); only CSV without 6502."""
    modes = objects.number(0x6502) or 1 << (CSV - 1)

    def guard(_: int, value: int) -> None:
        if value and (value < 0 or not modes >> (value - 1) & 1):
            raise SdoAbortedError(o.INVALID_VALUE)

    return guard


def guard_pdos(objects: Objects) -> None:
    """Make the PDO objects refuse writes that CiA 301 forbids.

    Entries may change only while subindex 0 is 0, subindex 0 only while the PDO is invalid (bit
    31), the COB-ID only from or to invalid; mapped objects must exist, be mappable, match in length
    and fit into the PDO.
    """
    for communication, mapped in ((0x1400, 0x1600), (0x1800, 0x1A00)):
        for n in pdo_numbers(objects, communication):
            objects.guards[communication + n] = _communication_guard(objects, communication + n)
            objects.guards[mapped + n] = _mapping_guard(objects, communication + n, mapped + n)


def _communication_guard(objects: Objects, index: int) -> o.Guard:
    def guard(subindex: int, value: int) -> None:
        present = objects.number(index, 1)
        if subindex == 1:
            changed = (value ^ present) & 0x7FF
            if (changed and not (value | present) & INVALID) or value & 0x3FFFF800:
                raise SdoAbortedError(o.INVALID_VALUE)
        elif (subindex == 2 and SYNCHRONOUS < value < 254) or (
            subindex == 3 and not present & INVALID
        ):
            raise SdoAbortedError(o.INVALID_VALUE)

    return guard


def _mapping_guard(objects: Objects, communication: int, index: int) -> o.Guard:
    receives = index < 0x1800

    def check(entry: int) -> int:
        """Length of one mapped object [bit]."""
        target = objects.entries.get(entry >> 8)
        if target is None:
            raise SdoAbortedError(o.NO_OBJECT)
        direction = target.writable if receives else target.readable
        if not target.mappable or not direction:
            raise SdoAbortedError(o.NOT_MAPPABLE)
        bits = 8 * struct.calcsize(target.code)
        if entry & 0xFF != bits:
            raise SdoAbortedError(o.NOT_MAPPABLE)
        return bits

    def guard(subindex: int, value: int) -> None:
        if not objects.number(communication, 1) & INVALID:
            raise SdoAbortedError(o.UNSUPPORTED_ACCESS)
        if subindex == 0:
            if sum(check(objects.number(index, sub)) for sub in range(1, value + 1)) > 64:
                raise SdoAbortedError(o.PDO_TOO_LONG)
        elif objects.number(index, 0) != 0:
            raise SdoAbortedError(o.UNSUPPORTED_ACCESS)
        elif value:
            check(value)

    return guard
