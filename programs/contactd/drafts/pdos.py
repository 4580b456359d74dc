"""Layout of a drive's PDOs: as fixed by its EDS, or packed into as few PDOs as possible."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

from common.errors import ConfigurationError
from drivers.canopen.boot.data_sheet import DataSheet, find_object
from drivers.canopen.codec import WORDS
from programs.contactd.drafts.choice import MEASURED, Candidate


@dataclass(frozen=True, slots=True)
class Layout:
    """Entries of each PDO by its number; fixed: the EDS prescribes them."""

    tpdo: dict[str, list[str]]
    rpdo: dict[str, list[str]]
    fixed: bool


def pdo_layout(sheet: DataSheet, objects: Mapping[str, Candidate]) -> Layout:
    """Layout of the PDOs of a drive. Raises ConfigurationError if the entries do not fit."""
    effort = "current" if "current" in objects else "torque"
    first = ["statusword", effort, "motor_velocity", "link_position", "motor_position"]
    wanted = [entry for entry in first if entry in WORDS or entry in objects]
    fixed_t, fixed_r = (_fixed(sheet, base, objects) for base in (0x1800, 0x1400))
    tpdo = fixed_t or _packed(sheet, 0x1800, wanted, objects)
    rpdo = fixed_r or _packed(sheet, 0x1400, ["controlword", "target_velocity"], objects)
    return Layout(tpdo, rpdo, fixed=bool(fixed_t or fixed_r))


def _fixed(sheet: DataSheet, base: int, objects: Mapping[str, Candidate]) -> dict[str, list[str]]:
    """PDOs whose mapping is fixed by the EDS and contains only known entries."""
    there = {name: one.where for name, one in objects.items()}
    there |= {word: (index, 0) for word, index in WORDS.items()}
    carried = ("statusword", *MEASURED) if base == 0x1800 else ("controlword", "target_velocity")
    entries = {there[name]: name for name in carried if name in there}
    found: dict[str, list[str]] = {}
    for number in range(4):
        first = find_object(sheet, base + number + 0x200, 1)
        count = find_object(sheet, base + number + 0x200, 0)
        if first is None or count is None or first.writable or not count.default:
            continue
        mapped = [
            find_object(sheet, base + number + 0x200, sub) for sub in range(1, count.default + 1)
        ]
        values = [int(one.default or 0) for one in mapped if one is not None]
        names = [entries.get((value >> 16, value >> 8 & 0xFF)) for value in values]
        if names and all(names):
            found[str(number + 1)] = [name for name in names if name]
    return _without_repeats(found)


def _without_repeats(found: dict[str, list[str]]) -> dict[str, list[str]]:
    """Smallest set of PDOs that carries the most entries, none of them twice."""
    choices = (
        choice
        for size in range(len(found), -1, -1)
        for choice in itertools.combinations(found, size)
        if len(entries := [name for n in choice for name in found[n]]) == len(set(entries))
    )
    best = max(choices, key=lambda choice: (sum(len(found[n]) for n in choice), -len(choice)))
    return {number: found[number] for number in best}


def _packed(
    sheet: DataSheet, base: int, wanted: list[str], objects: Mapping[str, Candidate]
) -> dict[str, list[str]]:
    """Entries packed into as few PDOs as possible, eight bytes each."""
    found: dict[str, list[str]] = {}
    left = list(wanted)
    for number in range(4):
        if not left or base + number not in sheet or base + number + 0x200 not in sheet:
            break
        bits = 0
        entries: list[str] = []
        mapping = sheet[base + number + 0x200]
        room = max(len(mapping.subindices) - 1, 1) if hasattr(mapping, "subindices") else 8
        for entry in list(left):
            size = 16 if entry in WORDS else _bits(objects[entry])
            if bits + size <= 64 and len(entries) < room:
                bits += size
                entries.append(entry)
                left.remove(entry)
        found[str(number + 1)] = entries
    if "motor_position" in left:  # optional: it can be integrated from the velocity
        left.remove("motor_position")
    if left:
        raise ConfigurationError(f"no room in its PDOs for {', '.join(left)}")
    return found


def _bits(one: Candidate) -> int:
    return 8 if one.type.endswith("8") else 16 if one.type.endswith("16") else 32
