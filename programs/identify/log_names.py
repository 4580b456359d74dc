"""Names file of another program's CSV or MCAP: columns and units, in a YAML of the same name.

    # ramps.yaml, beside ramps.csv
    time: {column: TIME, unit: s}
    rows: {column: test_nr, least: 100}            # other rows are left out
    joints:
      elbow:
        link_position: {value: 0}                  # clamped: the same in every row
        motor_position: {column: POSITION, unit: turn, scale: 0.02}
        torque: {column: TORQUE, unit: Nm}
    payload: 0.4                                   # kg; or {mass: 0.4, com: [0, 0, 0.05]}

For an MCAP it also has a `topic`, and columns are fields of its messages: `effort[2]`. A number in
the log is converted to number * unit * scale + offset, in SI at the link side. Without such a file,
columns must have the names of `csv_log`, in SI.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec

from common.errors import ConfigurationError, LogError
from common.yaml_source import read_yaml
from daemon.config.convert import convert
from daemon.config.schema import PayloadEntry
from drivers.settings import Settings
from estimator.payload import Mass

UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "link_position": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "turn": 2.0 * math.pi},
    "motor_velocity": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180.0,
        "turn/s": 2.0 * math.pi,
        "rpm": 2.0 * math.pi / 60.0,
    },
    "current": {"A": 1.0, "mA": 1e-3},
    "torque": {"Nm": 1.0, "mNm": 1e-3},
}
"""Units of each quantity with their factors to SI; the first is the default."""
_ALIKE = {"motor_position": "link_position", "setpoint": "motor_velocity"}


class QuantitySource(Settings, frozen=True, kw_only=True):
    """Source of a quantity: a column of the log, or one value for all rows."""

    column: str = ""
    value: float | None = None
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


class Rows(Settings, frozen=True, kw_only=True):
    """Rows that count: those in which a column is within bounds."""

    column: str
    least: float = -math.inf
    most: float = math.inf


Quantity = Literal[
    "link_position", "motor_position", "motor_velocity", "current", "torque", "setpoint"
]


class LogNames(Settings, frozen=True, kw_only=True):
    """Content of the names file; `topic` is only for an MCAP."""

    topic: str = ""
    joints: dict[str, dict[Quantity, QuantitySource]]
    time: QuantitySource = QuantitySource(column="time")
    rows: Rows | None = None
    payload: Mass | PayloadEntry | None = None


class Conversion(msgspec.Struct, frozen=True):
    """Column, or a constant if `column` is empty, with the factor and offset to SI."""

    column: str
    factor: float = 1.0
    offset: float = 0.0


class NamedLog(msgspec.Struct, frozen=True):
    """Conversions of `time` and each `QUANTITY.JOINT`, rows that count, and an MCAP's topic."""

    conversions: dict[str, Conversion]
    rows: Rows | None
    topic: str
    payload: PayloadEntry | None
    """Payload in the hand throughout the log."""


def beside(log: Path) -> Path:
    """Path of a log's names file."""
    return log.with_suffix(".yaml")


def is_foreign(path: Path) -> bool:
    """True for a log of another program: a CSV, or an MCAP with a names file."""
    return path.suffix == ".csv" or (path.suffix == ".mcap" and beside(path).exists())


def read_names(log: Path) -> NamedLog | None:
    """Content of a log's names file; None if there is none. Raises LogError that names file, field,
    value and what is allowed."""
    path = beside(log)
    if not path.exists():
        return None
    try:
        names = convert(read_yaml(path), LogNames)
    except ConfigurationError as error:
        raise LogError(str(error)) from error
    conversions = {"time": _conversion(path, "time", "time", names.time)}
    for joint, quantities in names.joints.items():
        for quantity, named in quantities.items():
            where = f"joints.{joint}.{quantity}"
            conversions[f"{quantity}.{joint}"] = _conversion(path, where, quantity, named)
    of_mcap = log.suffix == ".mcap"
    if of_mcap is not bool(names.topic):
        about = "required for an MCAP" if of_mcap else "allowed only for an MCAP"
        raise LogError(f"{path}: topic: {names.topic!r}, {about}")
    load = PayloadEntry(mass=names.payload) if isinstance(names.payload, float) else names.payload
    return NamedLog(conversions, names.rows, names.topic, load)


def _conversion(path: Path, where: str, quantity: str, named: QuantitySource) -> Conversion:
    if bool(named.column) == (named.value is not None):
        raise LogError(f"{path}: {where}: give either a column or a value")
    units = UNITS[_ALIKE.get(quantity, quantity)]
    unit = named.unit or next(iter(units))
    if unit not in units:
        raise LogError(f"{path}: {where}: unit {unit!r}, allowed are {', '.join(units)}")
    factor = units[unit] * named.scale
    if not (math.isfinite(factor) and factor != 0.0 and math.isfinite(named.offset)):
        raise LogError(f"{path}: {where}: scale {named.scale}, offset {named.offset}: both must be "
                       "numbers, and scale not 0")  # fmt: skip
    if named.value is None:
        return Conversion(named.column, factor, named.offset)
    return Conversion("", 0.0, named.value * factor + named.offset)
