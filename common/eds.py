"""Electronic data sheets (EDS) of CANopen devices (CiA 306), as makers actually write them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from common.errors import ConfigurationError
from common.regular_file import open_text

Value = int | str | None
Sections = dict[str, dict[str, str]]
"""Values by section and key, both in lower case."""

INTEGER_BITS: Final = {
    0x02: -8, 0x03: -16, 0x04: -32, 0x05: 8, 0x06: 16, 0x07: 32,
    0x10: -24, 0x12: -40, 0x13: -48, 0x14: -56, 0x15: -64,
    0x16: 24, 0x18: 40, 0x19: 48, 0x1A: 56, 0x1B: 64,
}  # fmt: skip
"""Width in bits of the CiA 301 integer types by type code; negative if the type is signed."""
DOMAIN: Final = 0x0F
ACCESS: Final = ("const", "ro", "wo", "rw", "rwr", "rww")

_TYPES: Final = {
    0x02: (0x6060, 0x6061, 0x6098),
    0x03: (0x6007, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x6071, 0x6074, 0x6077, 0x6078),
    0x04: (0x6062, 0x6063, 0x6064, 0x6069, 0x606B, 0x606C, 0x607A, 0x60E4, 0x60F4, 0x60FF),
    0x05: (0x1001,),
    0x06: (0x1017, 0x603F, 0x6040, 0x6041, 0x6072, 0x6073),
    0x07: (0x1000, 0x1005, 0x1014, 0x1016, 0x1018, 0x6075, 0x6076, 0x607F, 0x6080, 0x6085,
           0x608F, 0x60A8, 0x60A9, 0x6502),
}  # fmt: skip
TYPE_OF: Final = {index: code for code, of in _TYPES.items() for index in of}
"""Types fixed by CiA 301 and CiA 402, for an EDS that omits them."""

_SECTION: Final = re.compile(r"(?:0x)?([0-9a-f]{4})(?:sub(?:0x)?([0-9a-f]{1,2}))?")
_INTEGER: Final = re.compile(r"([+-]?)(?:0x([0-9a-f]+)|([0-9]+))[ul]*", re.IGNORECASE)
_NODE_ID: Final = re.compile(r"\+?\$nodeid\+?", re.IGNORECASE)
_GROUPS: Final = (8, 9)  # ObjectType of arrays and records
_VARIABLE: Final = 7
_MOST_SUBINDICES: Final = 254


@dataclass(frozen=True, slots=True)
class EdsObject:
    """One variable. `type` is the CiA 301 type code, DOMAIN if the EDS gives none.

    default, low, high: None if the EDS gives no readable value. relative: the node ID is to be
    added to the default.
    """

    index: int
    subindex: int
    name: str
    type: int
    access: str
    mappable: bool
    default: Value = None
    relative: bool = False
    low: int | None = None
    high: int | None = None

    @property
    def writable(self) -> bool:
        """True if the object can be written by SDO."""
        return "w" in self.access

    def of_node(self, node: int) -> Value:
        """Default value in the drive with this node ID."""
        return self.default + node if self.relative and isinstance(self.default, int) else (
            self.default
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Eds:
    """Objects by index and subindex, names of arrays and records by index, and the [DeviceInfo]
    section with its keys in lower case."""

    objects: Mapping[tuple[int, int], EdsObject]
    groups: Mapping[int, str]
    device: Mapping[str, str]

    def number(self, key: str) -> int:
        """Number in [DeviceInfo]; 0 if it is missing or unreadable."""
        found, _ = as_integer(self.device.get(key.lower(), ""))
        return found or 0


def read_eds(path: Path) -> Eds:
    """Read an EDS file. Raises ConfigurationError with file, section, value and what is allowed."""
    try:
        with open_text(path, "latin-1") as file:
            raw = file.read().encode("latin-1")
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        # CiA 306 asks for ASCII; makers put a degree sign of some code page in names and comments.
        text = raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    try:
        return eds_of(text)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: not a readable EDS: {error}") from error


def eds_of(text: str) -> Eds:
    """Parsed EDS text. Raises ConfigurationError with section, value and what is allowed."""
    sections = _sections(text)
    objects: dict[tuple[int, int], EdsObject] = {}
    groups: dict[int, str] = {}
    for section, values in sections.items():
        found = _SECTION.fullmatch(section.replace(" ", ""))
        if found is None or (index := int(found[1], 16)) < 0x1000:
            continue
        if found[2] is None and _kind(section, values) in _GROUPS:
            groups[index] = values.get("parametername", f"Object {index:04X}")
            for one in _compact(sections, section, index):
                objects.setdefault((index, one.subindex), one)
        elif found[2] is None:
            objects[index, 0] = _variable(sections, section, index, 0)
        else:
            subindex = int(found[2], 16)
            groups.setdefault(index, f"Object {index:04X}")
            objects[index, subindex] = _variable(sections, section, index, subindex)
    for index in groups:
        members = [sub for i, sub in objects if i == index]
        if members and 0 not in members:
            objects[index, 0] = _count(index, max(members))
    return Eds(objects, groups, sections.get("deviceinfo", {}))


def _sections(text: str) -> Sections:
    """Sections of the text; a repeated key replaces the earlier value, a repeated section continues
    it. Malformed lines are accepted outside of sections that describe objects."""
    sections: Sections = {}
    values: dict[str, str] | None = None
    strict = True
    for number, line in enumerate(text.replace("\0", "").split("\n"), start=1):
        content = re.split(r"(?:^|\s);", line, maxsplit=1)[0].strip()
        if not content or content.startswith("#"):
            continue
        key, equals, value = (part.strip() for part in content.partition("="))
        if content.startswith("["):
            name, closed, _ = content[1:].partition("]")
            if not closed:
                raise ConfigurationError(f"line {number}: {_cut(content)}: must end in ]")
            values = sections.setdefault(name.strip().lower(), {})
            strict = _SECTION.fullmatch(name.replace(" ", "").lower()) is not None
        elif values is None or (strict and not equals):
            raise ConfigurationError(
                f"line {number}: {_cut(content)}: must be [section], Key=Value or ; comment"
            )
        else:
            values[key.lower()] = value
    return sections


def _variable(sections: Sections, section: str, index: int, subindex: int) -> EdsObject:
    values = sections[section]
    code = _number(section, values, "datatype", TYPE_OF.get(index, DOMAIN))
    if code > max(INTEGER_BITS):  # CANFestival puts the type in a section of its own
        own = sections.get(f"{code:x}sub1", {}).get("defaultvalue", "")
        code = as_integer(own)[0] or DOMAIN
    access = values.get("accesstype", "").lower() or "ro"
    if access not in ACCESS:
        raise ConfigurationError(
            f"[{section}] AccessType={_cut(access)}: must be one of {', '.join(ACCESS)}"
        )
    written = values.get("defaultvalue", "")
    default: Value = written or None
    relative = False
    if code in INTEGER_BITS:
        default, relative = as_integer(written)
        default = _wrapped(default, INTEGER_BITS[code])
    low, high = (
        _wrapped(as_integer(values.get(key, ""))[0], INTEGER_BITS.get(code, 0))
        for key in ("lowlimit", "highlimit")
    )
    if low is not None and high is not None and low > high:
        low = high = None
    name = values.get("parametername", "") or f"Object {index:04X}"
    mappable = bool(_number(section, values, "pdomapping", 0))
    return EdsObject(index, subindex, name, code, access, mappable, default, relative, low, high)


def _compact(sections: Sections, section: str, index: int) -> Iterator[EdsObject]:
    """Members of an array or record that are given by their number only (CompactSubObj), all
    alike."""
    members = _number(section, sections[section], "compactsubobj", 0)
    if members > _MOST_SUBINDICES:
        raise ConfigurationError(
            f"[{section}] CompactSubObj={members}: must be at most {_MOST_SUBINDICES}"
        )
    if members:
        yield _count(index, members)
    for subindex in range(1, members + 1):
        yield _variable(sections, section, index, subindex)


def _count(index: int, members: int) -> EdsObject:
    return EdsObject(index, 0, "Highest sub-index supported", 0x05, "const", False, members)


def _kind(section: str, values: Mapping[str, str]) -> int:
    if "objecttype" not in values and ("subnumber" in values or "compactsubobj" in values):
        return _GROUPS[-1]
    return _number(section, values, "objecttype", _VARIABLE)


def _number(section: str, values: Mapping[str, str], key: str, default: int) -> int:
    text = values.get(key, "")
    if not text:
        return default
    number, _ = as_integer(text)
    if number is None or number < 0:
        spelt = {"datatype": "DataType", "objecttype": "ObjectType", "pdomapping": "PDOMapping"}
        raise ConfigurationError(
            f"[{section}] {spelt.get(key, 'CompactSubObj')}={_cut(text)}: must be a number such "
            "as 7 or 0x0007"
        )
    return number


def as_integer(text: str) -> tuple[int | None, bool]:
    """Integer that a text denotes, or None, and whether the node ID is to be added."""
    plain = text.replace(" ", "").replace("\t", "")
    formula = _NODE_ID.sub("", plain, count=1)
    relative = formula != plain
    found = _INTEGER.fullmatch(formula)
    if found is None:
        return (0, True) if relative and not formula else (None, False)
    digits = int(found[2], 16) if found[2] else int(found[3])
    return -digits if found[1] == "-" else digits, relative


def _wrapped(value: int | None, bits: int) -> int | None:
    """The value in the range of its type, as makers write -1 as 0xFFFF and 0xFFFF as -1; None if
    the type cannot hold it."""
    size = abs(bits)
    if value is None or not -(1 << size) // 2 <= value < 1 << size:
        return None
    if bits < 0:
        return value - (1 << size) if value >= 1 << (size - 1) else value
    return value % (1 << size)


def _cut(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
