"""What a drive shall hold before it may be operational, as data; checked against its EDS."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import canopen
from canopen.objectdictionary import ODArray, ODVariable

from drivers.codec import STRUCT_CODES, Pdo, receive_pdos, transmit_pdos, type_limits
from drivers.settings import DriveProfile, JointWiring, ObjectValue
from errors import ConfigurationError

# Data types of CiA 301 by their code in an EDS.
_TYPES: Final = {
    2: "INTEGER8",
    3: "INTEGER16",
    4: "INTEGER32",
    5: "UNSIGNED8",
    6: "UNSIGNED16",
    7: "UNSIGNED32",
}

CYCLIC_SYNCHRONOUS_VELOCITY: Final = 9
STAY_OPERATIONAL: Final = 1  # 0x1029:1, so that PDOs tell what the drive does after our silence
STOP_ON_SILENCE: Final = 3  # 0x6007: quick stop; at 0 a drive moves on when its master has died
RAMP_THEN_HOLD: Final = 6  # 0x605A: decelerate by 0x6085, stay in quick stop active
READ_AT_BOOT_UP: Final = ((0x1000, 0), (0x1018, 1), (0x6075, 0), (0x6502, 0), (0x6061, 0))


@dataclass(frozen=True, slots=True)
class DriveSetup:
    """One drive: its place, its kind, its EDS, and how hard it brakes.

    quick_stop: deceleration of a quick stop [rad/s2 at the link], > 0.
    """

    name: str
    wiring: JointWiring
    profile: DriveProfile
    data_sheet: canopen.ObjectDictionary
    quick_stop: float

    def __str__(self) -> str:
        return f"node {self.wiring.node} ({self.name})"


def load_data_sheet(path: Path) -> canopen.ObjectDictionary:
    """Read an EDS; raises ConfigurationError naming the file."""
    try:
        sheet = canopen.import_od(str(path))
    except Exception as error:  # configparser's and canopen's own, and whatever int() meets
        raise ConfigurationError(f"{path}: not a readable EDS: {error}") from error
    if 0x1000 not in sheet:
        raise ConfigurationError(f"{path}: not an EDS: object 0x1000 (device type) is missing")
    return sheet


def find_object(
    sheet: canopen.ObjectDictionary, index: int, subindex: int = 0
) -> ODVariable | None:
    """The object in the EDS, or None."""
    entry = sheet.get(index)
    # canopen makes up every member of an array from its first; the EDS says how many there are.
    if isinstance(entry, ODArray) and subindex and 0 in entry.subindices:
        highest = entry[0].default
        if highest is not None and subindex > highest:
            return None
    return sheet.get_variable(index, subindex)


def objects_to_write(setup: DriveSetup, period_ms: int, master_node: int) -> list[ObjectValue]:
    """Everything but the PDOs, in order; `period_ms` is that of SYNC."""
    profile, wiring = setup.profile, setup.wiring
    braking = profile.quick_stop_deceleration
    deceleration = round(setup.quick_stop * wiring.gear / braking.scale)
    max_current_permille = round(1000.0 * wiring.max_current_A / wiring.rated_current_A)
    table = (
        (0x1016, 1, master_node << 16 | profile.master_timeout_ms),
        (0x1017, 0, profile.heartbeat_ms),
        (0x1029, 1, STAY_OPERATIONAL),
        (0x6007, 0, STOP_ON_SILENCE),
        (0x605A, 0, RAMP_THEN_HOLD),
        (0x605E, 0, profile.fault_reaction),
        (0x6060, 0, CYCLIC_SYNCHRONOUS_VELOCITY),
        (0x60C2, 1, period_ms),
        (0x60C2, 2, -3),
        (braking.object, braking.subindex, deceleration),
        (0x6073, 0, max_current_permille),
    )
    fixed = [ObjectValue(object=i, subindex=sub, value=value) for i, sub, value in table]
    return fixed + profile.write


def check_drive(setup: DriveSetup, period_ms: int, master_node: int) -> None:
    """Raise ConfigurationError if the EDS does not have what the configuration counts on."""
    for problem in problems(setup, period_ms, master_node):
        raise ConfigurationError(f"{setup}, {setup.profile.eds}: {problem}")


def problems(setup: DriveSetup, period_ms: int, master_node: int) -> Iterator[str]:
    """Everything that the configuration counts on and the EDS does not have."""
    sheet, profile = setup.data_sheet, setup.profile
    for index, subindex in READ_AT_BOOT_UP:
        if find_object(sheet, index, subindex) is None:
            yield f"object 0x{index:04X}:{subindex:02X} is missing"
    for wanted in objects_to_write(setup, period_ms, master_node):
        where = f"object 0x{wanted.object:04X}:{wanted.subindex:02X}"
        variable = find_object(sheet, wanted.object, wanted.subindex)
        if variable is None:
            yield f"{where} is missing, and {wanted.value} cannot be written to it"
            continue
        lowest, highest = value_range(variable)
        if not variable.writable:
            yield f"{where} cannot be written (access {variable.access_type})"
        if not lowest <= wanted.value <= highest:
            yield f"{where}: {wanted.value} is outside {lowest} ... {highest}"
    node = setup.wiring.node
    for communication, pdos in (
        (0x1800, transmit_pdos(profile, node)),
        (0x1400, receive_pdos(profile, node)),
    ):
        for pdo in pdos:
            yield from _pdo_problems(sheet, pdo, communication + pdo.number - 1)


def _pdo_problems(sheet: canopen.ObjectDictionary, pdo: Pdo, communication: int) -> Iterator[str]:
    if communication not in sheet or communication + 0x200 not in sheet:
        yield f"has no PDO with parameters at 0x{communication:04X}"
    for field in pdo.fields:
        where = f"{field.entry}, object 0x{field.index:04X}:{field.subindex:02X},"
        variable = find_object(sheet, field.index, field.subindex)
        if variable is None:
            yield f"{where} is missing"
        elif _TYPES.get(variable.data_type) != field.type:
            kind = _TYPES.get(variable.data_type, f"type {variable.data_type}")
            yield f"{where} is {kind}, not {field.type}"
        elif not variable.pdo_mappable:
            yield f"{where} cannot be mapped to a PDO"


def value_range(variable: ODVariable) -> tuple[int, int]:
    """What may be written to an integer object: its limits in the EDS, else those of its type."""
    kind = _TYPES.get(variable.data_type)
    lowest, highest = type_limits(kind) if kind in STRUCT_CODES else (0, -1)
    return (
        lowest if variable.min is None else variable.min,
        highest if variable.max is None else variable.max,
    )
