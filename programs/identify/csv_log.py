"""Reader of logs of other programs, CSV or MCAP: the columns of a step at even times."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import LogError, ShortLogError
from common.regular_file import open_text
from daemon.protocol.text import printable
from identification.log_checks import too_far
from identification.motion_log import SHORTEST, MotionLog
from programs.identify.log_names import Conversion, NamedLog, Rows, beside, read_names
from programs.identify.log_times import once, rastered, spread_evenly, unheld
from programs.identify.mcap_log import of_one_sender, read_rows

COLUMNS = ("current", "link_position", "motor_velocity", "motor_position", "setpoint")
_SIDES = COLUMNS[2:4]
_ALSO = "torque"
Lines = NDArray[np.int64]


def read_csv(
    path: Path, joints: Sequence[str], constants: Mapping[str, float], *, of_gap: bool = False
) -> tuple[MotionLog, tuple[str, ...]]:
    """Log of these joints, and notes on its columns and times.

    Columns are `time` [s] and for each joint `current.JOINT` [A], or `torque.JOINT` [Nm at the
    link], which is divided by the torque constant, and `link_position.JOINT` [rad]. Optional are
    `motor_velocity.JOINT` [rad/s at the link], by default the derivative of a position,
    `motor_position.JOINT` [rad at the link] and `setpoint.JOINT` [rad/s at the link]; for a gap
    (`of_gap`) one of the motor's two is required. Other columns are ignored; a names file beside
    the log (`log_names`) maps columns of other names and units.

    Equal rounded times are spread evenly, rows that are logged twice or repeat an earlier
    measurement are left out, and samples at uneven times are resampled. Raises LogError.
    """
    table, twice = once(_table(path, joints))
    table, held = unheld(table)
    if len(table["time"]) == 0:
        raise LogError(f"{path}: it contains no samples")
    missing: list[str] = []
    for joint in joints:
        torque = table.get(f"{_ALSO}.{joint}")
        if torque is not None and joint in constants:
            table.setdefault(f"current.{joint}", torque / constants[joint])
        missing += [f"{name}.{joint}" for name in COLUMNS[:2] if f"{name}.{joint}" not in table]
        sides = [f"{name}.{joint}" for name in _SIDES]
        if of_gap and not any(side in table for side in sides):
            missing.append(" or ".join(sides))
    if missing:
        instead = [
            f"; {lacks.replace('current', _ALSO)} [Nm] suffices with a `torque_constant`"
            for lacks in missing[:1]
            if lacks.startswith("current.")
        ]
        raise LogError(f"{path}: no column {', '.join(missing)}{''.join(instead)}; to use other "
                       f"columns, name them in {beside(path).name} (docs/logs.md)")  # fmt: skip
    time_s, notes = spread_evenly(table["time"])
    derived = [joint for joint in joints if f"{_SIDES[0]}.{joint}" not in table]
    grows = bool((np.diff(time_s) > 0.0).all())  # otherwise MotionLog refuses it below
    for joint in derived:
        of = table.get(f"{_SIDES[1]}.{joint}", table[f"{COLUMNS[1]}.{joint}"])
        table[f"{_SIDES[0]}.{joint}"] = np.gradient(of, time_s) if grows else np.zeros_like(of)
    if derived and not of_gap:
        notes += (f"no {_SIDES[0]} of {', '.join(derived)}: derived from the position",)
    columns: dict[str, Matrix] = {}
    for name in COLUMNS:
        found = [table[f"{name}.{j}"] for j in joints if f"{name}.{j}" in table]
        if len(found) == len(joints):
            columns[name] = np.stack(found, axis=1)
    try:  # checks the samples before they are interpolated
        log = MotionLog(tuple(joints), time_s, **columns)
    except LogError as error:
        raise type(error)(f"{path}: {error}") from error
    for name, span in zip(joints, np.ptp(log.link_position, axis=0).tolist(), strict=True):
        if about := too_far(name, span):
            raise LogError(f"{path}: {about}")
    return rastered(log, twice + held + notes + _assumed(path, joints))


def _assumed(path: Path, joints: Sequence[str]) -> tuple[str, ...]:
    """Note on constant motor positions that the names file states, or none."""
    named = read_names(path)
    given = named.conversions if named else {}
    stated = [f"{name} {given[name].offset:g} rad" for name in (f"{_SIDES[1]}.{j}" for j in joints)
              if name in given and not given[name].column]  # fmt: skip
    return (f"assumed in {beside(path).name}, not measured: {', '.join(stated)}; gap and contacts "
            "are only right if the motor stood there",) if stated else ()  # fmt: skip


def _table(path: Path, joints: Sequence[str]) -> dict[str, Vector]:
    """Columns of the log by name, in SI, in the rows that count."""
    named = read_names(path)
    header, rows = _rows(path, named.topic if named else "")
    conversions, which = _conversions(path, joints, header, named)
    columns = sorted({one.column for one in conversions.values() if one.column})
    columns += [which.column] if which else []
    if twice := [name for name in columns if header.count(name) > 1]:
        raise LogError(f"{path}: duplicate columns {printable(', '.join(twice)[:100])}")
    time = conversions["time"].column if "time" in conversions else ""
    table, lines = _values(path, header, rows, columns, time)
    if which is not None:
        counts = (table[:, -1] >= which.least) & (table[:, -1] <= which.most)
        table, lines = table[counts], lines[counts]
    _refuse_rows(path, table, lines, columns, time)
    return {
        name: one.offset + one.factor * table[:, columns.index(one.column)]
        if one.column
        else np.full(len(table), one.offset)
        for name, one in conversions.items()
    }


def there_are(header: Sequence[str]) -> str:
    """Column names, as part of a message."""
    there = printable(", ".join(header)[:200])
    return f"there are {there}, separated by commas" if there else "it is empty"


def header_of(path: Path) -> list[str]:
    """Column names of a CSV. Raises LogError."""
    return _rows(path, "")[0]


def numbers_of(path: Path, columns: Sequence[str], time: str, topic: str = "") -> dict[str, Vector]:
    """Columns of a log without conversion; `time` names the one that may contain times of day.
    Raises LogError, also for too few rows or a value that is no number."""
    table, lines = _values(path, *_rows(path, topic), columns, time)
    if len(table) < SHORTEST:
        raise ShortLogError(f"{path}: the log is too short: {len(table)} samples, at least "
                            f"{SHORTEST} are needed")  # fmt: skip
    _refuse_rows(path, table, lines, columns, time)
    return dict(zip(columns, table.T, strict=True))


def _values(
    path: Path,
    header: list[str],
    rows: Iterable[tuple[int, Sequence[str | float]]],
    columns: Sequence[str],
    time: str,
) -> tuple[Matrix, Lines]:
    """Values (N, k) of these columns, and the line or message number of each row (N,)."""
    at = [header.index(name) for name in columns]
    stamp = columns.index(time) if time in columns else -1
    values, lines = list[list[float]](), list[int]()
    for line, row in rows:
        values.append(_numbers(path, line, [row[k] for k in at], columns, stamp))
        lines.append(line)
    table, numbers = np.array(values, dtype=np.float64).reshape(-1, len(at)), np.array(lines)
    if is_mcap(path):
        ours = of_one_sender(path, table, columns, stamp)
        return table[ours], numbers[ours]
    return table, numbers


def _refuse_rows(
    path: Path, table: Matrix, lines: Lines, columns: Sequence[str], time: str
) -> None:
    """Raise LogError, naming the row, for a value that is not finite or a time that decreases."""
    place = f"{path}: message " if is_mcap(path) else f"{path}:"
    if len(bad := np.argwhere(~np.isfinite(table))):
        k, i = bad[0]
        raise LogError(f"{place}{lines[k]}: {printable(columns[i])} is {table[k, i]}, not a "
                       f"number ({len(bad)} such in the log)")  # fmt: skip
    if time in columns:
        back = np.diff(table[:, columns.index(time)], prepend=-np.inf) < 0.0
        if back.any():
            raise LogError(f"{place}{lines[np.argmax(back)]}: time is before that of the row above")


def is_mcap(path: Path) -> bool:
    """True for an MCAP log, whose rows are the messages of a topic."""
    return path.suffix == ".mcap"


def _rows(path: Path, topic: str) -> tuple[list[str], Iterable[tuple[int, Sequence[str | float]]]]:
    """Column names of a CSV or topic, and an iterator of its rows with line or message number.
    Raises LogError, also while rows are read."""
    if is_mcap(path):
        return read_rows(path, topic)

    def lines() -> Iterator[tuple[int, list[str]]]:
        rows = None
        try:
            with open_text(path, encoding="utf-8-sig", newline="") as stream:
                rows = csv.reader(stream)
                yield from enumerate(rows, start=1)
        except csv.Error as error:
            at = rows.line_num if rows else 1
            raise LogError(f"{path}:{at}: is not CSV: {error}") from error
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise LogError(f"cannot read {path}: {why}") from error

    def whole() -> Iterator[tuple[int, list[str]]]:
        blank = 0  # first blank line, allowed only at the end of the file
        for line, row in rest:
            if not row or not (row[0].strip() or row[1:]):
                blank = blank or line
            elif blank:
                raise LogError(f"{path}:{blank}: blank line between rows")
            elif len(row) != len(header):
                why = ("is a decimal written with a comma?" if len(row) > len(header)
                       else "is the file cut off?")  # fmt: skip
                raise LogError(f"{path}:{line}: {len(row)} fields, the header has "
                               f"{len(header)}: {why}")  # fmt: skip
            else:
                yield line, row

    rest = lines()
    header = [name.strip() for name in next(rest, (1, []))[1]]
    if len(header) == 1 and (other := next((c for c in ";\t|" if c in header[0]), "")):
        raise LogError(f"{path}:1: fields are separated by {other!r}, allowed are commas; decimals "
                       "need a point")  # fmt: skip
    return header, whole()


def _conversions(
    path: Path, joints: Sequence[str], header: list[str], named: NamedLog | None
) -> tuple[dict[str, Conversion], Rows | None]:
    """Conversions of these joints' quantities, and the rows that count, from the names file or the
    columns' own names."""
    known = {"time", *(f"{c}.{j}" for c in (*COLUMNS, _ALSO) for j in joints)}
    if named is None:
        if "time" not in header:
            raise LogError(f"{path}: no column time; {there_are(header)}")
        return {name: Conversion(name) for name in known if name in header}, None
    conversions = {name: one for name, one in named.conversions.items() if name in known}
    which = named.rows
    wanted = {
        name: conversion.column for name, conversion in conversions.items() if conversion.column
    }
    if which is not None:
        wanted["rows"] = which.column
    for name, column in wanted.items():
        if column not in header:
            raise LogError(f"{beside(path)}: {name}: no column {printable(column)} in {path}; "
                           f"{there_are(header)}")  # fmt: skip
    return conversions, which


def _numbers(
    path: Path, line: int, row: Sequence[str | float], columns: Sequence[str], stamp: int
) -> list[float]:
    """Numbers of a row; `stamp`: index of the column that may hold times by ISO 8601."""
    numbers: list[float] = []
    for k, field in enumerate(row):
        try:
            of_day = k == stamp and isinstance(field, str) and ":" in field
            numbers.append(_time_of_day(str(field)) if of_day else _number(field))
        except ValueError as error:
            about = f"{printable(columns[k])[:60]} is {printable(repr(field))[:60]}"
            neither = "neither a number nor a time by ISO 8601" if k == stamp else "not a number"
            raise LogError(f"{path}:{line}: {about}: {neither}") from error
    return numbers


def _time_of_day(field: str) -> float:
    """Unix time [s] of a date and time by ISO 8601, UTC if it has no time zone."""
    at = datetime.fromisoformat(field.strip())
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _number(field: str | float) -> float:
    if isinstance(field, str) and "_" in field:  # digit separators, which only Python accepts
        raise ValueError(f"could not convert string to float: {field!r}")
    return float(field)
