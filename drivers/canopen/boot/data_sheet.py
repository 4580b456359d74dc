"""EDS of a drive (CiA 306): loading, and look-up of its objects."""

from pathlib import Path
from typing import Final, TypeAlias

import canopen
from canopen.objectdictionary import ODRecord, ODVariable

from common.eds import EdsObject, read_eds
from common.errors import ConfigurationError
from drivers.canopen.codec import STRUCT_CODES, type_limits

# Data types of CiA 301 by their code in an EDS.
_TYPES: Final = {
    2: "INTEGER8",
    3: "INTEGER16",
    4: "INTEGER32",
    5: "UNSIGNED8",
    6: "UNSIGNED16",
    7: "UNSIGNED32",
}
_HEARTBEATS: Final = 0x1016


DataSheet: TypeAlias = canopen.ObjectDictionary
"""Object dictionary of a loaded EDS."""
Variable: TypeAlias = ODVariable
"""One object of an EDS."""


def load_data_sheet(path: Path) -> DataSheet:
    """Read an EDS. Raises ConfigurationError that names file, section, value and allowed values."""
    eds = read_eds(path)
    if (0x1000, 0) not in eds.objects:
        raise ConfigurationError(f"{path}: not an EDS: object 0x1000 (device type) is missing")
    sheet = canopen.ObjectDictionary()
    sheet.device_information.vendor_number = eds.number("VendorNumber")
    sheet.device_information.product_number = eds.number("ProductNumber")
    for index, name in eds.groups.items():
        sheet.add_object(ODRecord(name, index))
    for (index, _), one in sorted(eds.objects.items()):
        if index in eds.groups:
            sheet[index].add_member(_variable(one))
        else:
            sheet.add_object(_variable(one))
    return sheet


def _variable(one: EdsObject) -> ODVariable:
    variable = ODVariable(one.name, one.index, one.subindex)
    variable.data_type, variable.access_type = one.type, one.access
    variable.pdo_mappable, variable.relative = one.mappable, one.relative
    variable.default = None if one.relative else one.default
    # Each entry holds a node ID and a time, but some EDS limit it as if it were a time only.
    if one.index != _HEARTBEATS:
        variable.min, variable.max = one.low, one.high
    return variable


def find_object(sheet: DataSheet, index: int, subindex: int = 0) -> ODVariable | None:
    """Object in the EDS, or None."""
    entry = sheet.get(index)
    # canopen returns a variable for any subindex.
    if isinstance(entry, ODVariable) and subindex:
        return None
    return sheet.get_variable(index, subindex)


def makers_numbers(sheet: DataSheet) -> dict[str, int]:
    """VendorNumber and ProductNumber of an EDS, if given: 0 counts as absent."""
    about = sheet.device_information
    numbers = {"VendorNumber": about.vendor_number, "ProductNumber": about.product_number}
    return {name: number for name, number in numbers.items() if number}


def counts_per_motor_turn(sheet: DataSheet) -> float:
    """Counts per motor turn from 0x608F of the EDS; 0 if it gives none, or one per turn, a factory
    value of drives that hold their own."""
    counts, turns = (
        None if variable is None else variable.default
        for variable in (find_object(sheet, 0x608F, sub) for sub in (1, 2))
    )
    if not isinstance(counts, int) or not isinstance(turns, int) or counts < 1 or turns < 1:
        return 0.0
    return counts / turns if counts > turns else 0.0


def type_name(variable: ODVariable) -> str:
    """Type name as in the configuration; the number for other types."""
    return _TYPES.get(variable.data_type, f"type {variable.data_type}")


def value_range(variable: ODVariable) -> tuple[int, int]:
    """Range of an integer object: its limits in the EDS, else those of its type."""
    kind = type_name(variable)
    lowest, highest = type_limits(kind) if kind in STRUCT_CODES else (0, -1)
    return (
        lowest if variable.min is None else variable.min,
        highest if variable.max is None else variable.max,
    )
