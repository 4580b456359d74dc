"""Draft of a drive profile from its EDS: objects found by index, types, scales with their reasons,
a PDO mapping that fits, and required features that the drive lacks.

Values that an EDS does not contain, above all the size of a count, are guessed from common practice
and marked `# CHECK`: they are in the manual only.
"""

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from common.errors import ConfigurationError
from common.yaml_source import quoted
from drivers.canopen.boot.data_sheet import DataSheet, counts_per_motor_turn, find_object, type_name
from drivers.canopen.codec import STRUCT_CODES, WORDS

TURN = 2.0 * math.pi
RPM = TURN / 60.0

Object = tuple[int, int]

CANDIDATES: dict[str, tuple[Object, ...]] = {
    "current": ((0x6078, 0),),
    "torque": ((0x6077, 0),),
    "link_position": ((0x60E4, 1), (0x60E4, 2), (0x60E4, 3), (0x6064, 0)),
    "motor_velocity": ((0x606C, 0), (0x6069, 0)),
    "motor_position": ((0x6064, 0), (0x6063, 0)),
    "target_velocity": ((0x60FF, 0),),
    "quick_stop_deceleration": ((0x6085, 0),),
    "max_motor_speed": ((0x6080, 0), (0x607F, 0)),
}
"""Objects of CiA 402 that may hold each quantity, the likeliest first."""
OPTIONAL = ("current", "torque", "motor_position", "max_motor_speed")
MEASURED = ("current", "torque", "motor_velocity", "link_position", "motor_position")
_MAKERS_OWN = range(0x2000, 0x6000)
_NOT_MEASURED = re.compile(
    r"\b(demand\w*|target|command\w*|set ?point|reference|limit\w*|max\w*|rated|nominal|gain)\b"
)
"""Words in the names of objects that denote a setpoint or a limit, not a measurement."""


@dataclass(frozen=True, slots=True)
class Drafted:
    """One quantity: its object, its scale, and the reason for both."""

    name: str
    index: int
    subindex: int
    type: str
    scale: float
    reason: str
    sure: bool

    @property
    def bits(self) -> int:
        """Size of its object."""
        return 8 if self.type.endswith("8") else 16 if self.type.endswith("16") else 32

    def line(self) -> str:
        """Line of `config.yaml`, with the reason."""
        sub = f", subindex: {self.subindex}" if self.subindex else ""
        check = "" if self.sure else "CHECK: "
        return (
            f"    {self.name}: {{object: 0x{self.index:04X}{sub}, type: {self.type}, "
            f"scale: {self.scale!r}}}   # {check}{self.reason}"
        )


@dataclass(frozen=True, slots=True)
class DraftedDrive:
    """Drafted profile: its quantities, its PDOs, and remarks on the drive."""

    quantities: dict[str, Drafted]
    tpdo: dict[str, list[str]]
    rpdo: dict[str, list[str]]
    fixed: bool
    remarks: list[str]

    def text(self, name: str, eds: str) -> str:
        """Entry of `config.yaml` under `drives`."""
        why = "as the EDS fixes them" if self.fixed else "laid out by contactd"
        pdos = [
            f"    {kind}:   # {why}\n"
            + "\n".join(f'      "{n}": [{", ".join(entries)}]' for n, entries in layout.items())
            for kind, layout in (("tpdo", self.tpdo), ("rpdo", self.rpdo))
        ]
        lines = [f"  {quoted(name)}:", f"    eds: {quoted(eds)}"]
        lines += [quantity.line() for quantity in self.quantities.values()]
        return "\n".join([*lines, *pdos]) + "\n"


def drafted_drive(sheet: DataSheet, eds: str) -> DraftedDrive:
    """Profile of the drive of an EDS. Raises ConfigurationError if the drive lacks a quantity that
    contactd needs, or room in its PDOs."""
    counts = counts_per_motor_turn(sheet)
    quantities: dict[str, Drafted] = {}
    for name, places in CANDIDATES.items():
        if name == "torque" and "current" in quantities:
            continue
        found = _found(sheet, name, places, quantities)
        if found is not None:
            quantities[name] = _drafted(name, found, type_of(sheet, found), counts)
        elif name not in OPTIONAL:
            where = ", ".join(f"0x{i:04X}:{s:02X}" for i, s in places)
            raise ConfigurationError(f"{eds}: no object for {name} ({where}), nor one of that name")
    if "current" not in quantities and "torque" not in quantities:
        raise ConfigurationError(f"{eds}: neither current (0x6078) nor torque (0x6077)")
    tpdo, rpdo, fixed = _pdos(sheet, eds, quantities)
    listed = {entry for entries in tpdo.values() for entry in entries}
    if "motor_position" not in listed:
        quantities.pop("motor_position", None)
    return DraftedDrive(quantities, tpdo, rpdo, fixed, list(_remarks(sheet)))


def type_of(sheet: DataSheet, where: Object) -> str:
    """Type of an object that exists."""
    variable = find_object(sheet, *where)
    assert variable is not None
    return type_name(variable)


def _found(
    sheet: DataSheet, name: str, places: tuple[Object, ...], taken: dict[str, Drafted]
) -> Object | None:
    """First object that exists, is mappable if it must be, and is not taken; otherwise an object of
    the maker's own, found by its name."""
    used = {(one.index, one.subindex) for one in taken.values()}
    by_name = _by_name(sheet, name)
    # 0x6064 is the motor's wherever the link has an object of its own.
    if name == "link_position" and by_name and find_object(sheet, 0x60E4, 1) is None:
        places = (*places[:-1], *by_name, *places[-1:])
    for where in (*places, *by_name):
        variable = find_object(sheet, *where)
        if variable is None or where in used or type_name(variable) not in STRUCT_CODES:
            continue
        if name in MEASURED and not variable.pdo_mappable:
            continue
        return where
    return None


def _by_name(sheet: DataSheet, name: str) -> tuple[Object, ...]:
    words = name.split("_")
    return tuple(
        (index, sub)
        for index in sheet
        if index in _MAKERS_OWN
        for sub in getattr(sheet[index], "subindices", (0,))
        if (variable := find_object(sheet, index, sub)) is not None
        and all(word in variable.name.lower() for word in words)
        and not (name in MEASURED and _NOT_MEASURED.search(variable.name.lower()))
    )


def _drafted(name: str, where: Object, kind: str, counts: float) -> Drafted:
    scale, reason, sure = _scale(name, where, counts)
    return Drafted(name, *where, kind, scale, reason, sure)


def _scale(name: str, where: Object, counts: float) -> tuple[float, str, bool]:
    """Scale, its reason, and whether it is certain rather than a guess."""
    if name in ("current", "torque"):
        sure = where in CANDIDATES[name]
        own = " is a guess, as the maker's own object is"
        own += "; mA are 0.001 / rated_current_A" if name == "current" else ""
        why = ", by CiA 402" if sure else own
        return 0.001, f"per mille of the rated value{why}", sure
    if name == "link_position":
        return (
            TURN / 131072,
            "2 pi / counts per turn of the link's encoder: 131072 is a guess",
            False,
        )
    if name == "motor_position" and counts:
        return TURN / counts, f"2 pi / {counts:g} counts per turn, by 0x608F", True
    if name == "motor_position":
        return TURN / 4096, "2 pi / counts per turn of the motor's encoder: 4096 is a guess", False
    if where == (0x6080, 0):
        return RPM, "rpm, by CiA 402", True
    rpm = "rpm/s" if name == "quick_stop_deceleration" else "rpm"
    reason = f"0.1 {rpm} is a guess: 1 {rpm} is 0.10471975511965977, see docs/porting.md"
    return 0.1 * RPM, reason, False


# --- PDOs -----------------------------------------------------------------------------------------


def _pdos(
    sheet: DataSheet, eds: str, quantities: dict[str, Drafted]
) -> tuple[dict[str, list[str]], dict[str, list[str]], bool]:
    effort = "current" if "current" in quantities else "torque"
    first = ["statusword", effort, "motor_velocity", "link_position", "motor_position"]
    wanted = [entry for entry in first if entry in WORDS or entry in quantities]
    fixed_t, fixed_r = (_fixed(sheet, base, quantities) for base in (0x1800, 0x1400))
    tpdo = fixed_t or _packed(sheet, eds, 0x1800, wanted, quantities)
    rpdo = fixed_r or _packed(sheet, eds, 0x1400, ["controlword", "target_velocity"], quantities)
    return tpdo, rpdo, bool(fixed_t or fixed_r)


def _fixed(sheet: DataSheet, base: int, quantities: dict[str, Drafted]) -> dict[str, list[str]]:
    """PDOs whose mapping the EDS fixes, if they carry nothing but quantities."""
    there = {name: (one.index, one.subindex) for name, one in quantities.items()}
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
    """Smallest set of PDOs that covers the most entries, none of them twice."""
    choices = (
        choice
        for size in range(len(found), -1, -1)
        for choice in itertools.combinations(found, size)
        if len(entries := [name for n in choice for name in found[n]]) == len(set(entries))
    )
    best = max(choices, key=lambda choice: (sum(len(found[n]) for n in choice), -len(choice)))
    return {number: found[number] for number in best}


def _packed(
    sheet: DataSheet, eds: str, base: int, wanted: list[str], quantities: dict[str, Drafted]
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
            size = 16 if entry in WORDS else quantities[entry].bits
            if bits + size <= 64 and len(entries) < room:
                bits += size
                entries.append(entry)
                left.remove(entry)
        found[str(number + 1)] = entries
    if "motor_position" in left:  # it can be integrated
        left.remove("motor_position")
    if left:
        raise ConfigurationError(f"{eds}: no room in its PDOs for {', '.join(left)}")
    return found


def _remarks(sheet: DataSheet) -> Iterator[str]:
    """Features that contactd requires of every drive and this EDS lacks."""
    for index, subindex, what in (
        (
            0x1016,
            1,
            "it cannot watch the master's heartbeat, and would move on when the daemon dies",
        ),
        (0x1017, 0, "it sends no heartbeat"),
        (0x6007, 0, "it cannot be configured to stop when the master falls silent"),
        (0x605A, 0, "it cannot be configured to hold after a quick stop"),
        (0x6060, 0, "its mode cannot be chosen"),
    ):
        if find_object(sheet, index, subindex) is None:
            yield f"without 0x{index:04X}:{subindex:02X}: {what}. contactd refuses it"
