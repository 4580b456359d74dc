"""Object values that a drive must hold before NMT operational, as data, checked against its EDS."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import canopen

from common.errors import ConfigurationError
from drivers.canopen.boot.data_sheet import find_object, makers_numbers, type_name, value_range
from drivers.canopen.boot.mandatory_objects import FOLLOWS, MUST_BE_READ
from drivers.canopen.codec import WORDS, Pdo, receive_pdos, transmit_pdos
from drivers.canopen.ids import EMERGENCY, SYNC
from drivers.canopen.settings import CanopenDrive, CanopenProfile, ObjectValue, Quantity

CYCLIC_SYNCHRONOUS_VELOCITY: Final = 9
#: Some drives display a mode only in operation, and 0 until then.
MODES_SHOWN: Final = (0, CYCLIC_SYNCHRONOUS_VELOCITY)
#: 0x1029:1: a drive that has missed its master leaves operational, so that an outdated setpoint and
#: SYNC, delivered when the bus recovers, do not move it again.
LEAVE_OPERATIONAL: Final = 0
STOP_ON_SILENCE: Final = 3  # 0x6007: quick stop; with 0 a drive keeps moving without a master
RAMP_THEN_HOLD: Final = 6  # 0x605A: decelerate by 0x6085, stay in quick stop active
#: Speed limit of the drive over the highest commanded speed: its loop overshoots slightly.
SPEED_MARGIN: Final = 1.1
BRAKING: Final = "deceleration of the quick stop"
#: Communication and mapping parameters of PDOs (CiA 301).
PDO_OBJECTS: Final = range(0x1400, 0x1C00)

_REQUIRED: Final = ", and contactd requires it: configure an object that the EDS has"
_INTERPOLATION: Final = "its interpolation of setpoints is the factory default"

ProfileKeys = tuple[str | int, ...]
"""Keys within a profile: `("tpdo", "1")`."""
Group = Literal["communication", "stopping", "mode", "limits", "own objects", "PDO mapping"]


@dataclass(frozen=True, slots=True)
class DriveSetup:
    """One drive with its EDS."""

    drive: CanopenDrive
    data_sheet: canopen.ObjectDictionary

    def __str__(self) -> str:
        return str(self.drive)


@dataclass(frozen=True, slots=True)
class RequiredValue:
    """Required value of an object. An object that the EDS declares read-only is only compared.

    without: consequence if a drive lacks the object; if empty, the drive is refused.
    mask: bits that are compared; the others are left to the drive.
    setting: location in the profile of the setting that determines the value.
    """

    group: Group
    index: int
    subindex: int
    value: int
    meaning: str
    without: str = ""
    mask: int = -1
    setting: ProfileKeys = ("eds",)

    @property
    def where(self) -> str:
        """Object as text: `object 0x6007:00 (quick stop when the master falls silent)`."""
        return f"object 0x{self.index:04X}:{self.subindex:02X} ({self.meaning})"

    def holds(self, held: int) -> bool:
        """True if the value `held` by a drive meets the requirement."""
        return held & self.mask == self.value

    def shown(self, held: int) -> str:
        """Value as text, in hexadecimal for PDO parameters."""
        return f"0x{held:08X}" if self.group == "PDO mapping" else str(held)


def required_values(setup: DriveSetup, period_ms: int, master_node: int) -> list[RequiredValue]:
    """Required objects except PDO parameters, in order of writing; `period_ms` is that of SYNC."""
    profile, wiring = setup.drive.profile, setup.drive.wiring
    braking, fastest = profile.quick_stop_deceleration, profile.max_motor_speed
    deceleration = round(setup.drive.quick_stop * wiring.gear / braking.scale)
    most_permille = round(1000.0 * wiring.max_current_A / wiring.rated_current_A)
    node, watched = wiring.node, master_node << 16 | profile.master_timeout_ms
    table = [
        RequiredValue("communication", 0x1005, 0, SYNC, "SYNC on 0x080, not produced by the drive",
            "SYNC is assumed on 0x080"),
        RequiredValue("communication", 0x1014, 0, EMERGENCY + node, "emergencies on 0x080 + node",
            "emergencies are assumed on 0x080 + node"),
        RequiredValue("communication", 0x1016, 1, watched, "watch the master's heartbeat",
            setting=("master_timeout_ms",)),
        RequiredValue("communication", 0x1017, 0, profile.heartbeat_ms, "heartbeat",
            setting=("heartbeat_ms",)),
        RequiredValue("communication", 0x1029, 1, LEAVE_OPERATIONAL,
            "no setpoints without a master",
            "its handling of setpoints after the loss of its master is the factory default"),
        RequiredValue("stopping", 0x6007, 0, STOP_ON_SILENCE,
            "quick stop when the master falls silent"),
        RequiredValue("stopping", 0x605A, 0, RAMP_THEN_HOLD, "quick stop: ramp, then hold"),
        RequiredValue("stopping", 0x605E, 0, profile.fault_reaction, "reaction to a fault",
            "its reaction to faults is the factory default", setting=("fault_reaction",)),
        RequiredValue("stopping", braking.object, braking.subindex, deceleration, BRAKING,
            setting=("quick_stop_deceleration",)),
        RequiredValue("mode", 0x6060, 0, CYCLIC_SYNCHRONOUS_VELOCITY,
            "cyclic synchronous velocity"),
        RequiredValue("mode", 0x60C2, 1, period_ms, "interpolation over the SYNC period",
            _INTERPOLATION),
        RequiredValue("mode", 0x60C2, 2, -3, "interpolation in ms", _INTERPOLATION),
        RequiredValue("limits", 0x6072, 0, most_permille, "torque limit, per mille of rated",
            "it has no torque limit of its own"),
        RequiredValue("limits", 0x6073, 0, most_permille, "current limit, per mille of rated",
            "it has no current limit of its own"),
    ]  # fmt: skip
    if fastest is not None:
        counts = math.ceil(SPEED_MARGIN * setup.drive.velocity * wiring.gear / fastest.scale)
        table.append(
            RequiredValue("limits", fastest.object, fastest.subindex, counts, "speed limit",
                setting=("max_motor_speed",))
        )  # fmt: skip
    return table + [
        RequiredValue("own objects", own.object, own.subindex, own.value, "from the configuration",
            setting=("write", i))
        for i, own in enumerate(profile.write)
    ]  # fmt: skip


def lacks(setup: DriveSetup, period_ms: int, master_node: int) -> list[str]:
    """Objects that the drive lacks according to its EDS, and the consequences, as text."""
    sheet = setup.data_sheet
    rows = {row.without: row for row in reversed(required_values(setup, period_ms, master_node))}
    found = [
        f"without {row.where}: {row.without}"
        for row in reversed(rows.values())
        if row.without and find_object(sheet, row.index, row.subindex) is None
    ]
    for index, subindex, follows in (
        (0x6061, 0, "its mode is not confirmed"),
        (0x6502, 0, "support of the mode is unknown"),
        (rated_object(setup.drive.profile), 0, "its rated value is not compared"),
    ):
        if find_object(sheet, index, subindex) is None:
            found.append(f"without object 0x{index:04X}:{subindex:02X}: {follows}")
    modes = find_object(sheet, 0x6502)
    if modes is not None and modes.default is None:
        found.append(
            "its EDS has no value for 0x6502: see the manual for mode 9 (cyclic synchronous "
            "velocity); a drive without it is refused at the start"
        )
    given = makers_numbers(sheet)
    if find_object(sheet, 0x1018, 2) is None:
        given["ProductNumber"] = 0
        found.append("without object 0x1018:02: its product is not compared")
    found += [
        f"its EDS has no {name}: {what} is not compared"
        for name, what in (("VendorNumber", "its vendor"),
                           ("ProductNumber", "its product"))
        if name not in given
    ]  # fmt: skip
    return found


def rated_object(profile: CanopenProfile) -> int:
    """Object that scales the reported current or torque: 0x6075 [mA] or 0x6076 [mNm]."""
    return 0x6075 if profile.effort == "current" else 0x6076


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Contradiction between configuration and EDS; `at` is the location in the profile that causes
    it."""

    at: ProfileKeys
    what: str


def check_drive(setup: DriveSetup, period_ms: int, master_node: int) -> None:
    """Raise ConfigurationError for the first contradiction between configuration and EDS."""
    for problem in problems(setup, period_ms, master_node):
        raise ConfigurationError(f"{setup}, {setup.drive.profile.eds}: {problem.what}")


def problems(setup: DriveSetup, period_ms: int, master_node: int) -> Iterator[Contradiction]:
    """Contradictions between configuration and EDS. Raises LayoutError for invalid PDO layouts."""
    sheet, profile = setup.data_sheet, setup.drive.profile
    for index, subindex in MUST_BE_READ:
        if find_object(sheet, index, subindex) is None:
            follows = FOLLOWS[index, subindex]
            what = f"object 0x{index:04X}:{subindex:02X} is missing: {follows}"
            yield Contradiction(("eds",), what)
    rows = required_values(setup, period_ms, master_node)
    for row in rows:
        for what in _object_problems(sheet, row):
            yield Contradiction(row.setting, what)
    for i, own in enumerate(profile.write):
        for what in _forbidden(own, profile, rows):
            yield Contradiction(("write", i), what)
    for name in ("quick_stop_deceleration", "max_motor_speed"):
        where: Quantity | None = getattr(profile, name)
        found = where and find_object(sheet, where.object, where.subindex)
        if where and found and type_name(found) != where.type:
            yield Contradiction(
                (name, "type"),
                f"object 0x{where.object:04X}:{where.subindex:02X} is {type_name(found)}, not "
                f"{where.type}",
            )
    for kind, communication, pdos in (
        ("tpdo", 0x1800, transmit_pdos(setup.drive)),
        ("rpdo", 0x1400, receive_pdos(setup.drive)),
    ):
        for pdo in pdos:
            yield from _pdo_problems(sheet, kind, pdo, communication + pdo.number - 1)


def _object_problems(sheet: canopen.ObjectDictionary, row: RequiredValue) -> Iterator[str]:
    variable = find_object(sheet, row.index, row.subindex)
    if variable is None:
        if not row.without:
            meant = _decimal_hint(sheet, row.index, row.subindex)
            follows = FOLLOWS.get((row.index, row.subindex), "")
            why = f": {follows}, and contactd refuses it" if follows else ""
            yield f"{row.where} is missing, and {row.value} cannot be written to it{why}{meant}"
        return
    lowest, highest = value_range(variable)
    if not variable.writable and row.group == "own objects":
        yield f"{row.where} cannot be written (access {variable.access_type})"
    # A deceleration of 0 is no ramp, whatever the EDS allows.
    lowest = max(lowest, 1) if row.meaning == BRAKING else lowest
    if not lowest <= row.value <= highest:
        yield f"{row.where}: {row.value} is outside {lowest} ... {highest}"


def _forbidden(
    own: ObjectValue, profile: CanopenProfile, rows: Sequence[RequiredValue]
) -> Iterator[str]:
    """Problems of an object that the configuration may not write, for the sake of safe stops."""
    where = f"object 0x{own.object:04X}:{own.subindex:02X} (from the configuration)"
    for row in rows:
        theirs = row.group in ("limits", "own objects")
        if not theirs and (row.index, row.subindex) == (own.object, own.subindex):
            yield f"{where} cannot be {own.value}: contactd writes {row.value} ({row.meaning})"
    if own.object in PDO_OBJECTS:
        yield f"{where} belongs to a PDO: configure PDOs by `tpdo` and `rpdo`"
    if own.object in (WORDS["controlword"], profile.target_velocity.object):
        yield f"{where} would energise or move the drive at boot-up"


def _pdo_problems(
    sheet: canopen.ObjectDictionary, kind: str, pdo: Pdo, communication: int
) -> Iterator[Contradiction]:
    mapping, at = communication + 0x200, (kind, str(pdo.number))
    name = f"{kind.upper()} {pdo.number}"
    if communication not in sheet or mapping not in sheet:
        yield Contradiction(at, f"{name}: no PDO parameters at 0x{communication:04X}")
    # Subindex 0 of a mapping is the number of mapped objects, not its capacity.
    elif find_object(sheet, mapping, len(pdo.fields)) is None:
        yield Contradiction(
            at, f"{name}: the PDO at 0x{communication:04X} cannot map {len(pdo.fields)} objects"
        )
    for number, field in enumerate(pdo.fields, start=1):
        fixed = find_object(sheet, mapping, number)
        ours = field.index << 16 | field.subindex << 8 | field.bits
        if fixed and not fixed.writable and fixed.default not in (None, 0, ours):
            yield Contradiction(
                at,
                f"{name}: object 0x{mapping:04X}:{number:02X} cannot be written, and maps "
                f"0x{fixed.default:08X} where {field.entry} (0x{ours:08X}) is configured",
            )
        where = f"{field.entry}, object 0x{field.index:04X}:{field.subindex:02X},"
        # Statusword and controlword have no entry in the profile.
        place: ProfileKeys = at if field.entry in WORDS else (field.entry,)
        variable = find_object(sheet, field.index, field.subindex)
        if variable is None:
            meant = _decimal_hint(sheet, field.index, field.subindex) or _REQUIRED
            yield Contradiction(place, f"{where} is missing{meant}")
        elif type_name(variable) != field.type:
            yield Contradiction(
                (*place, "type"), f"{where} is {type_name(variable)}, not {field.type}"
            )
        elif kind == "rpdo" and not variable.writable:
            yield Contradiction(place, f"{where} cannot be written (access {variable.access_type})")
        elif not variable.pdo_mappable:
            yield Contradiction(place, f"{where} cannot be mapped to a PDO")


def _decimal_hint(sheet: canopen.ObjectDictionary, index: int, subindex: int) -> str:
    """Hint, if the digits of a missing index exist as a hexadecimal index."""
    meant = int(str(index), 16)
    if find_object(sheet, meant, subindex) is None:
        return ""
    return f"; 0x{meant:04X} exists: {index} without 0x is decimal"
