"""EDS of a drive: reading it, and looking up its objects (CiA 306)."""

from pathlib import Path
from typing import Final

import canopen
from canopen.objectdictionary import ODArray, ODVariable

from common.errors import ConfigurationError
from common.regular_file import open_text
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


DataSheet = canopen.ObjectDictionary
"""An EDS, read."""


def load_data_sheet(path: Path) -> canopen.ObjectDictionary:
    """Read an EDS; raises ConfigurationError naming the file."""
    try:
        # CiA 306 asks for ASCII. Makers write degrees of some code page, in names and comments.
        with open_text(path, "utf-8-sig", "replace") as file:
            sheet = canopen.import_od(file)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from error
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
    # canopen gives a variable whatever subindex it is asked for.
    if isinstance(entry, ODVariable) and subindex:
        return None
    # canopen makes up every member of an array from its first; the EDS gives their number.
    if isinstance(entry, ODArray) and subindex and 0 in entry.subindices:
        highest = entry[0].default
        if highest is not None and subindex > highest:
            return None
    return sheet.get_variable(index, subindex)


def makers_numbers(sheet: canopen.ObjectDictionary) -> dict[str, int]:
    """VendorNumber and ProductNumber of an EDS, as far as it gives them: 0 counts as absent."""
    about = sheet.device_information
    numbers = {"VendorNumber": about.vendor_number, "ProductNumber": about.product_number}
    return {name: number for name, number in numbers.items() if number}


def counts_per_motor_turn(sheet: canopen.ObjectDictionary) -> float:
    """Counts per turn of the motor that the EDS gives in 0x608F; 0 where it gives none."""
    counts, turns = (
        None if variable is None else variable.default
        for variable in (find_object(sheet, 0x608F, sub) for sub in (1, 2))
    )
    if not isinstance(counts, int) or not isinstance(turns, int) or counts < 1 or turns < 1:
        return 0.0
    return counts / turns


def type_name(variable: ODVariable) -> str:
    """Name of a type as the configuration spells it; other types by their number."""
    return _TYPES.get(variable.data_type, f"type {variable.data_type}")


def value_range(variable: ODVariable) -> tuple[int, int]:
    """Range of an integer object: its limits in the EDS, else those of its type."""
    kind = type_name(variable)
    lowest, highest = type_limits(kind) if kind in STRUCT_CODES else (0, -1)
    return (
        lowest if variable.min is None else variable.min,
        highest if variable.max is None else variable.max,
    )
