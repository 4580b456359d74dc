"""Trajectory in a CSV file: `time_s` and one column [rad] for each joint that moves.

    time_s,LShoulderPitch,LElbowRoll
    0.00,0.10,-0.50
    0.05,0.11,-0.49

Empty lines and lines that begin with # are ignored. Read without numpy, for clients that must
start quickly; `daemon.motion.sampled_path` checks the rows against the arm's limits.
"""

import bisect
import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import TrajectoryError
from common.regular_file import open_text
from daemon.protocol.bounds import PLAUSIBLE
from daemon.protocol.text import printable

if TYPE_CHECKING:
    from _csv import Reader

TIME = "time_s"
#: Ten minutes at 100 Hz; 7 MB in the daemon for seven joints.
MAX_ROWS = 60_000
SHORTEST_STEP_S = 1e-6


@dataclass(frozen=True, slots=True)
class TrajectoryFile:
    """Content of a file; row i of `times` [s] and `positions` [rad] is from line `lines[i]`."""

    path: Path
    joints: tuple[str, ...]
    times: list[float]
    positions: list[list[float]]
    lines: list[int]

    def rows(self) -> list[list[float]]:
        """Rows for a PathBuilder: [t, q of each joint, q_dot of each joint]."""
        return rows_of(self.times, self.positions, slopes(self.times, self.positions))

    def at(self, time_s: float) -> list[float]:
        """Position of each joint [rad] at a time [s], on straight lines between the rows; the first
        or last row outside."""
        later = bisect.bisect_right(self.times, time_s)
        if later in (0, len(self.times)):
            return self.positions[0 if later == 0 else -1]
        t0, t1 = self.times[later - 1], self.times[later]
        share = (time_s - t0) / (t1 - t0)
        pairs = zip(self.positions[later - 1], self.positions[later], strict=True)
        return [a + share * (b - a) for a, b in pairs]

    def placed(self, error: TrajectoryError) -> TrajectoryError:
        """Error of a row, with file and line in front."""
        line = "" if error.row is None else f":{self.lines[min(error.row, len(self.lines) - 1)]}"
        return TrajectoryError(f"{self.path}{line}: {error}", row=error.row)


def read_trajectory(path: Path, known: Sequence[str]) -> TrajectoryFile:
    """Read a file whose joints must be among `known`.

    Raises TrajectoryError with file, line, column and reason of the first error.
    """
    try:
        # The byte order mark that some spreadsheets write is not part of the header.
        with open_text(path, "utf-8-sig", newline="") as stream:
            return _read(path, csv.reader(stream, strict=True), known)
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: is not UTF-8 text: {error}") from error


def refuse_columns(columns: Sequence[str], joints: Sequence[str]) -> None:
    """Raise TrajectoryError unless `columns` are some of `joints`, each once."""
    for i, column in enumerate(columns):
        if column not in joints:
            raise TrajectoryError(f"no joint `{printable(column)}`; there are: {', '.join(joints)}")
        if column in columns[:i]:
            raise TrajectoryError(f"two columns `{printable(column)}`")
    if not columns:
        raise TrajectoryError("no joint is named: nothing would move")


def refuse_shapes(
    joints: int,
    times: Sequence[float],
    positions: Sequence[Sequence[float]],
    velocities: Sequence[Sequence[float]] | None,
) -> None:
    """Raise TrajectoryError, with the row, unless the times rise, and positions and velocities have
    one row for each time and one plausible number for each joint."""
    for what, table in (("positions", positions), ("velocities", velocities)):
        if table is None:
            continue
        if len(table) != len(times):
            raise TrajectoryError(f"{len(times)} times, but {len(table)} rows of {what}")
        for i, row in enumerate(table):
            if len(row) != joints:
                raise TrajectoryError(f"{len(row)} {what} for {joints} joints", row=i)
    # Before any arithmetic: an integer may be beyond all floating point.
    for i, numbers in enumerate(
        zip(times, positions, positions if velocities is None else velocities, strict=True)
    ):
        if any(abs(x) > PLAUSIBLE for x in (numbers[0], *numbers[1], *numbers[2])):
            raise TrajectoryError(f"a number of more than {PLAUSIBLE:g}", row=i)
    for i in range(1, len(times)):
        if not times[i] - times[i - 1] >= SHORTEST_STEP_S:  # nor NaN
            raise TrajectoryError(
                f"{TIME}: {times[i]:g} does not come after {times[i - 1]:g}", row=i
            )


def slopes(times: Sequence[float], positions: Sequence[Sequence[float]]) -> list[list[float]]:
    """Velocities at samples (m, k) [rad/s]: of the parabola through each and its neighbours, of the
    line at both ends. `times` (m,) [s] rise, `positions` are (m, k) [rad]."""
    if len(times) < 2:
        return [[0.0] * len(row) for row in positions]
    secants = [
        [(b - a) / (t1 - t0) for a, b in zip(q0, q1, strict=True)]
        for t0, t1, q0, q1 in zip(times, times[1:], positions, positions[1:], strict=False)
    ]
    rows = [secants[0]]
    for i in range(1, len(times) - 1):
        behind, ahead = times[i] - times[i - 1], times[i + 1] - times[i]
        share = behind / (ahead + behind)
        pairs = zip(secants[i - 1], secants[i], strict=True)
        rows.append([(1.0 - share) * a + share * b for a, b in pairs])
    return [*rows, secants[-1]]


def rows_of(
    times: Sequence[float],
    positions: Sequence[Sequence[float]],
    velocities: Sequence[Sequence[float]],
) -> list[list[float]]:
    """Rows [t, q..., q_dot...] of plain numbers, one for each sample."""
    return [
        [float(t), *map(float, q), *map(float, v)]
        for t, q, v in zip(times, positions, velocities, strict=True)
    ]


def _read(path: Path, reader: "Reader", known: Sequence[str]) -> TrajectoryFile:
    lines = _lines(path, reader)
    number, header = next(lines, (0, []))
    if not header:
        raise TrajectoryError(f"{path}: is empty; its first line names the columns: {TIME}, joints")
    try:
        joints = _joints(header, known)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}:{number}: {error}") from error
    read = TrajectoryFile(path, joints, [], [], [])
    for number, row in lines:
        if len(row) != len(header):
            raise TrajectoryError(f"{path}:{number}: {len(row)} cells, but {len(header)} columns")
        values = [
            _number(path, number, column, cell) for column, cell in zip(header, row, strict=True)
        ]
        time_s = values.pop(header.index(TIME))
        if read.times and time_s - read.times[-1] < SHORTEST_STEP_S:
            text = f"{TIME}: {time_s:g} does not come after {read.times[-1]:g}"
            raise TrajectoryError(f"{path}:{number}: {text}")
        if len(read.times) == MAX_ROWS:
            raise TrajectoryError(f"{path}:{number}: more than {MAX_ROWS} samples")
        read.times.append(time_s)
        read.positions.append(values)
        read.lines.append(number)
    if len(read.times) < 2:
        raise TrajectoryError(f"{path}: {len(read.times)} samples; a trajectory needs two or more")
    return read


def _lines(path: Path, reader: "Reader") -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each line that is neither empty nor a comment."""
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not cells[0].startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise TrajectoryError(f"{path}:{reader.line_num}: is not CSV: {error}") from error


def _joints(header: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    if header.count(TIME) != 1:
        found = "two columns" if TIME in header else "no column"
        columns = printable(", ".join(header))
        raise TrajectoryError(f"{found} `{TIME}` among: {columns} (separated by commas)")
    joints = tuple(column for column in header if column != TIME)
    refuse_columns(joints, known)
    return joints


def _number(path: Path, line: int, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise TrajectoryError(
            f"{path}:{line}: {column}: `{printable(cell[:40])}` is not a number"
        ) from None
    if not abs(value) <= PLAUSIBLE:  # nor NaN
        raise TrajectoryError(
            f"{path}:{line}: {column}: {cell[:40]} is not a number of at most {PLAUSIBLE:g}"
        )
    return value
