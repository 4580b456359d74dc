"""Generated makes of drives: six that no configuration has, each with an EDS and a data sheet of
its own, as an owner gets them from a maker."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import pi
from typing import Any

TURN = 2.0 * pi
RPM = TURN / 60.0
VENDOR = 0x00C0DAC8

_CODES = {
    "INTEGER8": 2, "INTEGER16": 3, "INTEGER32": 4, "UNSIGNED8": 5, "UNSIGNED16": 6, "UNSIGNED32": 7,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Quantity:
    """Data sheet's entry of a quantity: object, type, unit of a count, sign and offset."""

    index: int
    type: str
    scale: float
    subindex: int = 0
    sign: int = 1
    offset: float = 0.0

    def entry(self) -> dict[str, Any]:
        """As `config.yaml` has it."""
        row: dict[str, Any] = {"object": self.index, "type": self.type, "scale": self.scale}
        if self.subindex:
            row["subindex"] = self.subindex
        if self.sign != 1:
            row["sign"] = self.sign
        if self.offset:
            row["offset"] = self.offset
        return row

    def encoder(self) -> dict[str, Any]:
        """As `simulation.yaml` has an encoder."""
        counts = self.sign * round(TURN / self.scale)
        zero = round(-self.offset / self.scale)
        return {"object": self.index, "subindex": self.subindex, "counts": counts, "zero": zero}

    def unit(self) -> dict[str, Any]:
        """As `simulation.yaml` has a quantity with a unit."""
        place = {"object": self.index, "subindex": self.subindex}
        return {**place, "unit": self.scale, "sign": self.sign}


@dataclass(frozen=True, slots=True)
class Make:
    """One make of drive: its quantities by their name in a profile, its PDOs, and its quirks."""

    name: str
    product: int
    quantities: Mapping[str, Quantity]
    tpdo: Mapping[str, tuple[str, ...]]
    rpdo: Mapping[str, tuple[str, ...]]
    fixed_pdos: bool = False
    quirks: Mapping[str, Any] = field(default_factory=dict)

    def profile(self, eds: str) -> dict[str, Any]:
        """As `config.yaml` has it under `drives`."""
        return {
            "eds": eds,
            **{name: quantity.entry() for name, quantity in self.quantities.items()},
            "tpdo": {number: list(entries) for number, entries in self.tpdo.items()},
            "rpdo": {number: list(entries) for number, entries in self.rpdo.items()},
        }

    def truth(self, eds: str) -> dict[str, Any]:
        """As `simulation.yaml` has it under `drives`."""
        of = self.quantities
        effort = of["current" if "current" in of else "torque"]
        drive = {
            "eds": eds,
            "link_position": of["link_position"].encoder(),
            "motor_velocity": of["motor_velocity"].unit(),
            "effort": effort.unit(),
            "target_velocity_unit": of["target_velocity"].scale,
            "deceleration_unit": of["quick_stop_deceleration"].scale,
            "quirks": dict(self.quirks),
        }
        if "motor_position" in of:
            drive["motor_position"] = of["motor_position"].encoder()
        if "max_motor_speed" in of:
            drive["speed_limit"] = of["max_motor_speed"].unit()
        return drive

    def eds(self) -> str:
        """The EDS, as text."""
        return "\n".join(_eds(self)) + "\n"


def _encoder(index: int, counts: int, subindex: int = 0, **more: Any) -> Quantity:
    return Quantity(index, "INTEGER32", TURN / counts, subindex, **more)


def _velocities(unit: float, acceleration: float | None = None) -> dict[str, Quantity]:
    return {
        "motor_velocity": Quantity(0x606C, "INTEGER32", unit),
        "target_velocity": Quantity(0x60FF, "INTEGER32", unit),
        "quick_stop_deceleration": Quantity(0x6085, "UNSIGNED32", acceleration or unit),
    }


_CURRENT = {"current": Quantity(0x6078, "INTEGER16", 0.001)}
_TORQUE = {"torque": Quantity(0x6077, "INTEGER16", 0.001)}
_ONE_RPDO = {"1": ("controlword", "target_velocity")}

MAKES: tuple[Make, ...] = (
    Make(
        "alder", 0x501,
        {"link_position": _encoder(0x60E4, 131072, 1), "motor_position": _encoder(0x6064, 4096),
         **_velocities(0.1 * RPM), **_CURRENT,
         "max_motor_speed": Quantity(0x6080, "UNSIGNED32", RPM)},
        {"1": ("statusword", "current", "motor_velocity"),
         "2": ("link_position", "motor_position")},
        _ONE_RPDO,
    ),
    Make(
        "birch", 0x502,
        {"link_position": _encoder(0x6064, 262144, sign=-1, offset=-0.75),
         "motor_velocity": Quantity(0x6069, "INTEGER32", RPM / 16.0),
         "target_velocity": Quantity(0x60FF, "INTEGER32", 0.001 * TURN),
         "quick_stop_deceleration": Quantity(0x6085, "UNSIGNED32", 0.01 * TURN),
         "torque": Quantity(0x6077, "INTEGER16", 0.001, sign=-1),
         "max_motor_speed": Quantity(0x607F, "UNSIGNED32", 0.001 * TURN)},
        {"1": ("statusword", "torque"), "2": ("link_position", "motor_velocity")},
        {"1": ("controlword",), "2": ("target_velocity",)},
        quirks={"needs_nmt_reset": True},
    ),
    Make(
        "cedar", 0x503,
        {"link_position": _encoder(0x2240, 360000), "motor_position": _encoder(0x6064, 8192),
         **_velocities(TURN / 8192), **_CURRENT},
        {"1": ("statusword", "current"), "2": ("link_position", "motor_velocity"),
         "3": ("motor_position",)},
        _ONE_RPDO,
    ),
    Make(
        "elder", 0x504,
        {"link_position": _encoder(0x60E4, 65536, 1), **_velocities(TURN / 3600), **_TORQUE,
         "max_motor_speed": Quantity(0x6080, "UNSIGNED32", RPM)},
        {"1": ("statusword", "torque", "motor_velocity"), "2": ("link_position",)},
        _ONE_RPDO,
        fixed_pdos=True, quirks={"sdo_delay_ms": 5.0},
    ),
    Make(
        "hazel", 0x505,
        {"link_position": _encoder(0x2310, 1048576, 3), **_velocities(0.001 * TURN), **_CURRENT,
         "motor_position": _encoder(0x6063, 10000),
         "max_motor_speed": Quantity(0x607F, "UNSIGNED32", 0.001 * TURN)},
        {"1": ("statusword", "current"), "2": ("link_position", "motor_position"),
         "3": ("motor_velocity",)},
        _ONE_RPDO,
        quirks={"current_filter_ms": 0.0},
    ),
    Make(
        "rowan", 0x506,
        {"link_position": _encoder(0x60E4, 32768, 2), **_velocities(RPM, RPM), **_TORQUE,
         "motor_position": _encoder(0x6064, 16384),
         "max_motor_speed": Quantity(0x6080, "UNSIGNED32", RPM)},
        {"1": ("statusword", "torque", "motor_velocity"),
         "2": ("link_position", "motor_position")},
        _ONE_RPDO,
    ),
)  # fmt: skip


# --- the EDS --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Variable:
    name: str
    type: str
    access: str = "rw"
    default: str = "0"
    mapped: bool = False
    low: str = ""


_U8, _U16, _U32, _I8, _I16 = "UNSIGNED8", "UNSIGNED16", "UNSIGNED32", "INTEGER8", "INTEGER16"
_Objects = dict[tuple[int, int], _Variable]


def _common(make: Make) -> _Objects:
    return {
        (0x1000, 0): _Variable("Device type", _U32, "const", "0x00020192"),
        (0x1001, 0): _Variable("Error register", _U8, "ro"),
        (0x1005, 0): _Variable("COB-ID SYNC", _U32, default="0x80"),
        (0x1014, 0): _Variable("COB-ID EMCY", _U32, "const", "$NODEID+0x80"),
        (0x1016, 1): _Variable("Consumer heartbeat time", _U32),
        (0x1017, 0): _Variable("Producer heartbeat time", _U16),
        (0x1018, 1): _Variable("Vendor-ID", _U32, "const", f"0x{VENDOR:08X}"),
        (0x1018, 2): _Variable("Product code", _U32, "const", f"0x{make.product:08X}"),
        (0x1018, 3): _Variable("Revision number", _U32, "const", "0x00010000"),
        (0x1018, 4): _Variable("Serial number", _U32, "const", "0"),
        (0x6007, 0): _Variable("Abort connection option code", _I16, low="0"),
        (0x603F, 0): _Variable("Error code", _U16, "ro"),
        (0x6040, 0): _Variable("Controlword", _U16, "rww", mapped=True),
        (0x6041, 0): _Variable("Statusword", _U16, "ro", mapped=True),
        (0x605A, 0): _Variable("Quick stop option code", _I16, default="2"),
        (0x605E, 0): _Variable("Fault reaction option code", _I16, default="2"),
        (0x6060, 0): _Variable("Modes of operation", _I8),
        (0x6061, 0): _Variable("Modes of operation display", _I8, "ro"),
        (0x6072, 0): _Variable("Max torque", _U16, default="1000"),
        (0x6073, 0): _Variable("Max current", _U16, default="1000"),
        (0x6075, 0): _Variable("Motor rated current", _U32, "ro"),
        (0x6076, 0): _Variable("Motor rated torque", _U32, "ro"),
        (0x6502, 0): _Variable("Supported drive modes", _U32, "const", "0x00000100"),
    }


def _own(make: Make) -> _Objects:
    objects: _Objects = {}
    for name, quantity in make.quantities.items():
        setting = name in ("target_velocity", "quick_stop_deceleration", "max_motor_speed")
        objects[quantity.index, quantity.subindex] = _Variable(
            name.replace("_", " ").capitalize(),
            quantity.type,
            "rww" if name == "target_velocity" else "rw" if setting else "ro",
            "0" if not setting or name == "target_velocity" else "100000",
            mapped=not setting or name == "target_velocity",
        )
    if "motor_position" in make.quantities:
        counts = round(TURN / make.quantities["motor_position"].scale)
        objects[0x608F, 1] = _Variable("Encoder increments", _U32, "ro", str(counts))
        objects[0x608F, 2] = _Variable("Motor revolutions", _U32, "ro", "1")
    return objects


def _pdos(make: Make) -> _Objects:
    objects: _Objects = {}
    access = "const" if make.fixed_pdos else "rw"
    for kind, layouts, base, first in (
        ("RPDO", make.rpdo, 0x1400, 0x200),
        ("TPDO", make.tpdo, 0x1800, 0x180),
    ):
        for number, entries in layouts.items():
            index = base + int(number) - 1
            cob_id = 0x80000000 + first + 0x100 * (int(number) - 1)
            parameter = f"{kind}{number} "
            objects[index, 1] = _Variable(
                f"{parameter}COB-ID", _U32, default=f"$NODEID+{cob_id:#x}"
            )
            objects[index, 2] = _Variable(f"{parameter}transmission type", _U8, default="255")
            mapped = [_mapped(make, entry) for entry in entries]
            room = len(mapped) if make.fixed_pdos else 4
            objects[index + 0x200, 0] = _Variable(
                f"{parameter}mapped objects", _U8, access, str(len(mapped))
            )
            for sub in range(1, room + 1):
                value = mapped[sub - 1] if sub <= len(mapped) else 0
                objects[index + 0x200, sub] = _Variable(
                    f"{parameter}mapping {sub}", _U32, access, f"0x{value:08X}"
                )
    return objects


def _mapped(make: Make, entry: str) -> int:
    words = {"statusword": 0x60410010, "controlword": 0x60400010}
    if entry in words:
        return words[entry]
    quantity = make.quantities[entry]
    bits = int(re.sub(r"\D", "", quantity.type))
    return quantity.index << 16 | quantity.subindex << 8 | bits


def _eds(make: Make) -> Iterator[str]:
    objects = dict(sorted({**_common(make), **_own(make), **_pdos(make)}.items()))
    indices = sorted({index for index, _ in objects})
    yield from (
        "[FileInfo]", f"FileName={make.name}.eds", "FileVersion=1", "FileRevision=0",
        "EDSVersion=4.0", f"Description=Servo drive {make.name}", "",
        "[DeviceInfo]", "VendorName=no maker", f"VendorNumber=0x{VENDOR:08X}",
        f"ProductName={make.name}", f"ProductNumber=0x{make.product:08X}",
        "RevisionNumber=0x00010000", "BaudRate_500=1", "BaudRate_1000=1", "Granularity=8",
        f"NrOfRXPDO={len(make.rpdo)}", f"NrOfTXPDO={len(make.tpdo)}", "",
    )  # fmt: skip
    groups = (
        ("MandatoryObjects", [i for i in indices if i in (0x1000, 0x1001, 0x1018)]),
        ("OptionalObjects", [i for i in indices if i not in (0x1000, 0x1001, 0x1018)
                             and not 0x2000 <= i < 0x6000]),
        ("ManufacturerObjects", [i for i in indices if 0x2000 <= i < 0x6000]),
    )  # fmt: skip
    for group, members in groups:
        yield from (f"[{group}]", f"SupportedObjects={len(members)}")
        yield from (f"{n}=0x{index:04X}" for n, index in enumerate(members, start=1))
        yield ""
    for index in indices:
        subs = {sub: v for (i, sub), v in objects.items() if i == index}
        if set(subs) == {0}:
            yield from _section(f"{index:X}", subs[0])
            continue
        subs.setdefault(0, _Variable("Highest sub-index", _U8, "const", str(max(subs))))
        yield from (f"[{index:X}]", f"ParameterName=Object {index:X}", "ObjectType=0x9",
                    f"SubNumber={len(subs)}", "")  # fmt: skip
        for sub, variable in sorted(subs.items()):
            yield from _section(f"{index:X}sub{sub:X}", variable)


def _section(name: str, variable: _Variable) -> Iterator[str]:
    yield from (
        f"[{name}]", f"ParameterName={variable.name}", "ObjectType=0x7",
        f"DataType=0x{_CODES[variable.type]:04X}", f"AccessType={variable.access}",
        f"DefaultValue={variable.default}", f"PDOMapping={int(variable.mapped)}",
    )  # fmt: skip
    if variable.low:
        yield f"LowLimit={variable.low}"
    yield ""
