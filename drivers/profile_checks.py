"""A drive's profile against its EDS, before anything is on the bus."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import canopen
from canopen.objectdictionary import datatypes

from drivers.codec import WORDS, PdoField, receive_pdos, transmit_pdos
from drivers.drive_setup import load_data_sheet
from drivers.settings import DriveProfile
from errors import ConfigurationError

QUANTITIES: Final = (
    "current",
    "link_position",
    "motor_velocity",
    "motor_position",
    "target_velocity",
    "quick_stop_deceleration",
)
TYPE_NAMES: Final = {
    getattr(datatypes, name): name
    for name in ("INTEGER8", "INTEGER16", "INTEGER32", "UNSIGNED8", "UNSIGNED16", "UNSIGNED32")
}

Finding = tuple[tuple[str | int, ...], str]  # where in the profile, and what is wrong


def profile_findings(profile: DriveProfile, folder: Path) -> Iterator[Finding]:
    """Everything in `profile` that its EDS (a path relative to `folder`) contradicts."""
    for kind, pdos in (("tpdo", transmit_pdos), ("rpdo", receive_pdos)):
        try:
            pdos(profile, 1)
        except ConfigurationError as error:
            yield (kind,), str(error)
            return
    try:
        dictionary = load_data_sheet(folder / profile.eds)
    except ConfigurationError as error:
        yield ("eds",), str(error)
        return
    for name in QUANTITIES:
        if getattr(profile, name) is not None:
            yield from _quantity(profile, name, dictionary)
    for position, extra in enumerate(profile.write):
        if _find(dictionary, extra.object, extra.subindex) is None:
            yield (
                ("write", position),
                f"object {_spell(extra.object, extra.subindex)} is not in {profile.eds}",
            )
    for kind, pdos in (("tpdo", transmit_pdos), ("rpdo", receive_pdos)):
        for pdo in pdos(profile, 1):
            for field in pdo.fields:
                yield from _mappable(profile, (kind, str(pdo.number)), field, dictionary)


def _quantity(profile: DriveProfile, name: str, dictionary: Any) -> Iterator[Finding]:
    where = getattr(profile, name)
    found = _find(dictionary, where.object, where.subindex)
    spelled = _spell(where.object, where.subindex)
    if found is None:
        yield (name, "object"), f"object {spelled} is not in {profile.eds}"
    elif (told := TYPE_NAMES.get(found.data_type)) != where.type:
        yield (name, "type"), f"{where.type}, but {profile.eds} says {spelled} is {told}"


def _mappable(
    profile: DriveProfile, where: tuple[str, ...], field: PdoField, dictionary: Any
) -> Iterator[Finding]:
    found = _find(dictionary, field.index, field.subindex)
    spelled = _spell(field.index, field.subindex)
    if found is None:
        if field.entry in WORDS:  # of a quantity, `_quantity` tells
            yield where, f"{field.entry} ({spelled}) is not in {profile.eds}"
    elif not found.pdo_mappable:
        yield where, f"{field.entry} ({spelled}) cannot be mapped, says {profile.eds}"


def _find(dictionary: Any, index: int, subindex: int) -> Any:
    """The variable at index:subindex, or None."""
    entry = dictionary.get(index)
    if entry is None:
        return None
    if isinstance(entry, canopen.objectdictionary.ODVariable):
        return entry if subindex == 0 else None
    return entry.get(subindex)


def _spell(index: int, subindex: int) -> str:
    return f"0x{index:04X}:{subindex:02X}"
