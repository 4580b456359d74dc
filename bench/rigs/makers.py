"""Drives of ten makers, each with the facts of its EDS that drafting and simulating look at, and an
EDS written from them in the maker's style.

Tables lie in `makes/`: index, subindex, type, access, PDO mapping, default and limits of an object,
and its name, as the file of the named public repository has them. What stands between them there
is left out.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from common.errors import ConfigurationError
from drivers.canopen.boot.data_sheet import load_data_sheet
from programs.contactd.drafts.drive import choices_of, drafted_drive

FOLDER = Path(__file__).parent / "makes"
_CODES = {"I8": 2, "I16": 3, "I32": 4, "U8": 5, "U16": 6, "U32": 7, "TEXT": 9}
_PDO_ID = {0x1400: 0x200, 0x1800: 0x180}
_FIRST_MAPPED = {0x1400: 0x60400010, 0x1800: 0x60410010}
_COUNT = ("U8", "const", "0")

Object = tuple[int, int]
ASK = (0, 0)
"""Object of which only the manual or a turn of the motor by hand shows whether it is right."""
_SET: dict[str, Object | None] = {
    "target_velocity": (0x60FF, 0), "quick_stop_deceleration": (0x6085, 0),
    "max_motor_speed": (0x6080, 0),
}  # fmt: skip
_CIA: dict[str, Object | None] = {"motor_velocity": (0x606C, 0), "link_position": ASK, **_SET}
_TORQUE: dict[str, Object | None] = {"torque": (0x6077, 0), **_CIA}
_CURRENT: dict[str, Object | None] = {"current": (0x6078, 0), **_CIA}
RIGHT: dict[str, dict[str, Object | None]] = {
    "maxon_epos4": {**_CURRENT, "current": (0x30D1, 2), "motor_position": ASK},
    "nanotec_cl4e": {**_TORQUE, "motor_position": ASK},
    "elmo_gold": {**_CURRENT, "motor_position": None},
    "zeroerr_edriver": {**_CURRENT, "motor_position": (0x2240, 0)},
    "technosoft_ipos": {**_TORQUE, "motor_position": (0x2088, 0), "max_motor_speed": None},
    "schunk": {**_TORQUE, "motor_position": None, **dict.fromkeys(_SET)},
    "trinamic_tmcm1270": {**_CURRENT, "current": None, "motor_position": None,
                          "max_motor_speed": None},
    "faulhaber_mcdc": {**dict.fromkeys(_CURRENT), "motor_position": None,
                       "quick_stop_deceleration": (0x6085, 0), "max_motor_speed": (0x607F, 0)},
    "infranor_easy": {**_CURRENT, "motor_position": None},
    "yiyou_servo": {**_TORQUE, "motor_position": ASK, "max_motor_speed": (0x607F, 0)},
}  # fmt: skip
"""Objects of each make by quantity, as the makers' manuals have them; None: it has none."""
USABLE = ("maxon_epos4", "nanotec_cl4e", "elmo_gold")


@dataclass(frozen=True, slots=True)
class Row:
    """One object as its maker's EDS has it."""

    index: int
    subindex: int
    type: str
    access: str
    mapped: str
    default: str
    limits: str
    name: str


@dataclass(frozen=True, slots=True)
class Maker:
    """One make: its rows, and its file's head and style by key."""

    name: str
    rows: tuple[Row, ...]
    about: dict[str, str]

    def eds(self) -> str:
        """The EDS, as text."""
        return "\n".join(_eds(self)) + "\n"

    def without(self, *indices: int) -> "Maker":
        """The same drive with another firmware, whose EDS lacks some objects."""
        rows = tuple(row for row in self.rows if row.index not in indices)
        return replace(self, name=f"{self.name}, other firmware", rows=rows)


@cache
def makers() -> dict[str, Maker]:
    """All makers by the names of their files."""
    return {path.stem: _read(path) for path in sorted(FOLDER.glob("*.csv"))}


def _read(path: Path) -> Maker:
    lines = path.read_text(encoding="utf-8").splitlines()
    about = dict(
        line.removeprefix("# ").split(":", maxsplit=1) for line in lines if line.startswith("#")
    )
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    return Maker(
        path.stem,
        tuple(
            Row(int(row["index"], 16), int(row["sub"], 16), row["type"], row["access"], row["pdo"],
                row["default"], row["limits"], row["name"])
            for row in rows
        ),
        {key: value.strip() for key, value in about.items()},
    )  # fmt: skip


# --- the file -------------------------------------------------------------------------------------


def _eds(maker: Maker) -> Iterator[str]:
    style = dict(part.partition("=")[::2] for part in maker.about.get("style", "").split())
    yield from ("[FileInfo]", "EDSVersion=4.0", "", "[DeviceInfo]")
    for pair in maker.about["device"].replace(" ", "\n").splitlines():
        if "=" in pair:
            yield pair
    if "repeat" in style:
        yield from ("", "[ManufacturerObjects]", "SupportedObjects=2", "12=0x3078", "12=0x3079")
    yield ""
    rows = [*maker.rows, *_pdos(maker.about["pdos"], style.get("node", "$NODEID"))]
    for index in sorted({row.index for row in rows}):
        members = [row for row in rows if row.index == index]
        if [row.subindex for row in members] == [0]:
            yield from _section(f"{index:X}", members[0], style)
            continue
        kind = style.get("kind", "0x%X") % (9 if index < 0x6000 else 8)
        yield from (f"[{index:X}]", f"ParameterName=Object {index:X}", f"ObjectType={kind}",
                    f"SubNumber={len(members)}", "")  # fmt: skip
        if all(row.subindex for row in members):
            highest = str(max(row.subindex for row in members))
            count = Row(index, 0, *_COUNT, highest, "", "Number of entries")
            yield from _section(f"{index:X}sub0", count, style)
        for row in members:
            yield from _section(f"{index:X}sub{row.subindex:X}", row, style)
    if "compact" in style:
        where, _, alike = style["compact"].partition(":")
        yield from (f"[{where}]", "ParameterName=Consumer heartbeat time", "ObjectType=0x8",
                    "DataType=0x0007", "AccessType=rw", "DefaultValue=0x0", "PDOMapping=0",
                    f"CompactSubObj={alike}", "")  # fmt: skip


def _section(name: str, row: Row, style: dict[str, str]) -> Iterator[str]:
    access = row.access.upper() if "upper" in style else row.access
    yield from (
        f"[{name}]", f"ParameterName={row.name}", f"ObjectType={style.get('kind', '0x%X') % 7}",
        f"DataType={style.get('number', '0x%04X') % _CODES[row.type]}", f"AccessType={access}",
        f"PDOMapping={row.mapped}",
    )  # fmt: skip
    if row.default or "empty" in style:
        yield f"DefaultValue={row.default.replace('$NODEID', style.get('node', '$NODEID'))}"
    if row.limits:
        low, _, high = row.limits.partition("..")
        yield from (f"LowLimit={low}", f"HighLimit={high}")
    yield ""


def _pdos(shape: str, node: str) -> Iterator[Row]:
    """Parameters and mappings of PDOs: `4x8 rw kind=9 count=1` is four of eight objects each."""
    size, access, *_, count = shape.split()
    pdos, room = (int(number) for number in size.split("x"))
    given = count.partition("=")[2]
    for base, first in _PDO_ID.items():
        for n in range(pdos):
            cob_id = f"{node}+0x{first + 0x100 * n:08X}" if n < 4 else "0x80000000"
            yield Row(base + n, 1, "U32", "rw", "0", cob_id, "", "COB-ID")
            yield Row(base + n, 2, "U8", "rw", "0", "255", "", "Transmission type")
            mapped = f"0x{_FIRST_MAPPED[base]:08X}"
            number = "1" if given and n == 0 else "0" if given else ""
            yield Row(base + 0x200 + n, 0, "U8", access, "0", number, "", "Number of entries")
            for sub in range(1, room + 1):
                value = mapped if sub == 1 and n == 0 else "0"
                yield Row(base + 0x200 + n, sub, "U32", access, "0", value, "", "Mapping")


# --- what is drafted ------------------------------------------------------------------------------


def wrong(maker: Maker, folder: Path) -> dict[str, str]:
    """Quantities of which the draft has another object than `RIGHT`, and does not ask."""
    (folder / "drive.eds").write_text(maker.eds())
    choices = choices_of(load_data_sheet(folder / "drive.eds"), {})
    found = {}
    for quantity, right in RIGHT[maker.name].items():
        chosen = choices[quantity].chosen if quantity in choices else None
        asked = chosen is not None and bool(chosen.doubt)
        if not asked and (None if chosen is None else chosen.where) != right:
            found[quantity] = str(chosen)
    return found


def verdict(maker: Maker, folder: Path) -> str:
    """Sentence that `contactd new` says of the drive."""
    path = folder / "drive.eds"
    path.write_text(maker.eds())
    try:
        return drafted_drive(load_data_sheet(path), maker.name).verdict()
    except ConfigurationError as error:
        return str(error).removeprefix(f"{maker.name}: ")
