"""PDO mapping of one drive by SDO: disable all PDOs, then map and enable ours (CiA 301).

The required values are data, so that set-up and verification use the same ones.
"""

from dataclasses import dataclass
from typing import Final

from common.errors import DriveError
from drivers.canopen.boot.data_sheet import find_object
from drivers.canopen.boot.required_objects import DriveSetup, RequiredValue
from drivers.canopen.boot.sdo import ObjectAccess
from drivers.canopen.codec import Pdo, receive_pdos, transmit_pdos

_PDO_DISABLED: Final = 1 << 31
# Whether remote requests are allowed is left to the drive.
_NO_RTR: Final = 1 << 30
_EVERY_SYNC: Final = 1


@dataclass(frozen=True, slots=True)
class RequiredPdo:
    """Required objects of one of our PDOs. `flags` are added to its COB-ID on writing."""

    cob_id: RequiredValue
    transmission: RequiredValue
    fields: tuple[RequiredValue, ...]
    count: RequiredValue
    flags: int

    @property
    def rows(self) -> tuple[RequiredValue, ...]:
        """All required objects of the PDO."""
        return (self.cob_id, self.transmission, *self.fields, self.count)


def required_pdos(setup: DriveSetup) -> tuple[list[RequiredPdo], list[RequiredValue]]:
    """Our PDOs, and the rows that disable all other PDOs of the drive."""
    drive = setup.drive
    ours = [_required(pdo, 0x1400, 0) for pdo in receive_pdos(drive)] + [
        _required(pdo, 0x1800, _NO_RTR) for pdo in transmit_pdos(drive)
    ]
    used = {pdo.cob_id.index for pdo in ours}
    others = [
        _off(communication)
        for first in (0x1400, 0x1800)
        for communication in range(first, first + 0x200)
        if communication not in used and find_object(setup.data_sheet, communication, 1) is not None
    ]
    return ours, others


def _required(pdo: Pdo, first: int, flags: int) -> RequiredPdo:
    communication = first + pdo.number - 1
    mapping = communication + 0x200
    name = f"{'RPDO' if first == 0x1400 else 'TPDO'} {pdo.number}"
    return RequiredPdo(
        _row(communication, 1, pdo.cob_id, f"COB-ID of {name}", ~_NO_RTR),
        _row(communication, 2, _EVERY_SYNC, f"{name} with every SYNC"),
        tuple(
            _row(mapping, number, part.index << 16 | part.subindex << 8 | part.bits,
                 f"{part.entry} in {name}")
            for number, part in enumerate(pdo.fields, start=1)
        ),
        _row(mapping, 0, len(pdo.fields), f"objects in {name}"),
        flags,
    )  # fmt: skip


def _off(communication: int) -> RequiredValue:
    return _row(communication, 1, _PDO_DISABLED, "a disabled PDO", _PDO_DISABLED)


def _row(index: int, subindex: int, value: int, meaning: str, mask: int = -1) -> RequiredValue:
    return RequiredValue("PDO mapping", index, subindex, value, meaning, mask=mask)


def map_pdos(setup: DriveSetup, access: ObjectAccess) -> None:
    """Disable all PDOs of the drive, then map and enable ours (CiA 301, 7.5.2.36).

    Objects that the EDS declares read-only are only compared: a drive with fixed PDOs is accepted
    if they match. Raises DriveError if it does not keep a written value.
    """
    ours, others = required_pdos(setup)
    changed = [_off(pdo.cob_id.index) for pdo in ours if _writable(access, pdo.cob_id)]
    for row in sorted([*changed, *others], key=lambda row: row.index):
        _disable(setup, access, row)
    for pdo in ours:
        _map(setup, access, pdo)


def _disable(setup: DriveSetup, access: ObjectAccess, row: RequiredValue) -> None:
    held = access.read(row.index, row.subindex)
    if _writable(access, row):
        access.write_only(row.index, row.subindex, held | _PDO_DISABLED)
        held = access.read(row.index, row.subindex)
    if not row.holds(held):
        raise DriveError(
            f"{setup}: object 0x{row.index:04X}:{row.subindex:02X} reads {row.shown(held)}: the "
            "PDO stays enabled"
        )


def _map(setup: DriveSetup, access: ObjectAccess, pdo: RequiredPdo) -> None:
    _hold(access, pdo.transmission)
    if _writable(access, pdo.count):
        access.write(pdo.count.index, 0, 0)
    for row in (*pdo.fields, pdo.count):
        _hold(access, row)
    _enable(setup, access, pdo)


def _hold(access: ObjectAccess, row: RequiredValue) -> None:
    access.hold(row.index, row.subindex, row.value)


def _enable(setup: DriveSetup, access: ObjectAccess, pdo: RequiredPdo) -> None:
    row, verb = pdo.cob_id, "must be"
    value = row.value | pdo.flags
    if _writable(access, row):
        access.write_only(row.index, row.subindex, value)
        verb = "was written"
    held = access.read(row.index, row.subindex)
    if not row.holds(held):
        raise DriveError(
            f"{setup}: object 0x{row.index:04X}:{row.subindex:02X} {verb} {row.shown(value)}, "
            f"reads {row.shown(held)}"
        )


def _writable(access: ObjectAccess, row: RequiredValue) -> bool:
    return access.writable(row.index, row.subindex)
