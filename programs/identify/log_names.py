"""Names and units of another program's CSV or MCAP: a YAML of the same name beside it.

    # ramps.yaml, beside ramps.csv
    time: {column: TIME, unit: s}
    rows: {column: test_nr, least: 100}            # leave out others
    joints:
      elbow:
        link_position: {value: 0}                  # clamped: the same in every row
        motor_position: {column: POSITION, unit: turn, scale: 0.02}
        torque: {column: TORQUE, unit: Nm}
    payload: 0.4                                   # kg; or {mass: 0.4, com: [0, 0, 0.05]}

Beside an MCAP it has a `topic`, too, and columns are fields of its messages: `effort[2]`.
A number in the log becomes number * unit * scale + offset, in SI and at the link. Without such a
file columns have the names of `csv_log`, in SI.
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
"""Units of each quantity, the first of them is the default; in SI."""
_ALIKE = {"motor_position": "link_position", "setpoint": "motor_velocity"}


class Named(Settings, frozen=True, kw_only=True):
    """Place of a quantity in the log: a column, or one value for all rows."""

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
    """Content of the file; `topic` for an MCAP alone, whose columns are fields of its messages."""

    topic: str = ""
    joints: dict[str, dict[Quantity, Named]]
    time: Named = Named(column="time")
    rows: Rows | None = None
    payload: Mass | PayloadEntry | None = None


class Conversion(msgspec.Struct, frozen=True):
    """Column of a CSV, or one value if there is none, and what makes SI of it."""

    column: str
    factor: float = 1.0
    offset: float = 0.0


class NamedLog(msgspec.Struct, frozen=True):
    """Places of `time` and of each `QUANTITY.JOINT`, which rows count, and the topic of an MCAP."""

    conversions: dict[str, Conversion]
    rows: Rows | None
    topic: str
    payload: PayloadEntry | None
    """in the hand throughout"""


def beside(log: Path) -> Path:
    """Path of the names of a log."""
    return log.with_suffix(".yaml")


def is_foreign(path: Path) -> bool:
    """True for a log of another program: a CSV, or an MCAP with a file of names beside it."""
    return path.suffix == ".csv" or (path.suffix == ".mcap" and beside(path).exists())


def read_names(log: Path) -> NamedLog | None:
    """Names of a log; None where no file is beside it. Raises LogError naming file, field, value
    and what is allowed."""
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
        about = "needed beside an MCAP" if of_mcap else "only an MCAP has any"
        raise LogError(f"{path}: topic: {names.topic!r}, {about}")
    load = PayloadEntry(mass=names.payload) if isinstance(names.payload, float) else names.payload
    return NamedLog(conversions, names.rows, names.topic, load)


def _conversion(path: Path, where: str, quantity: str, named: Named) -> Conversion:
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
