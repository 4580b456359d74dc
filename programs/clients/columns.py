"""Columns: consecutive States, or estimates, as arrays with one row per tick.

A replay runs the estimator over the samples of a whole batch and compares its results with the
recorded ones, array by array. Words of a State are encoded as integers. Missing values, and vectors
of another length, become NaN or a code that no estimate has, so that they compare unequal.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix
from daemon.protocol.state import State
from daemon.tick.telemetry import ESTIMATED, FLAG_NAMES, SIDE_NAMES, wrench_of
from estimator.estimate import EstimateRows, Flag, SampleRows
from estimator.wrench import UNSEEN, WIDTH

SIDES: Final = {name: side for side, name in SIDE_NAMES.items()}
NO_LINK: Final = -1  # code of no touched link
STRANGE: Final = -2  # code of unknown words
Columns = dict[str, NDArray[Any]]
"""Estimated fields by name, (ticks, n) or (ticks,). "beside" encodes whether the names of the
residual variants match; each variant has a column "beside NAME"."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Joints, and names of the residual variants, which determine the columns' shapes and codes."""

    joints: tuple[str, ...]
    beside: tuple[str, ...]

    def samples(self, states: Sequence[State]) -> SampleRows:
        """Samples contained in these States."""

        def column(name: str) -> Matrix:
            return self._matrix([getattr(state, name) for state in states])

        return SampleRows(
            current=column("current"),
            link_position=column("link_position"),
            motor_velocity=column("motor_velocity"),
            motor_position=self._matrix([state.motor_position or () for state in states]),
            fresh=np.array([state.fresh for state in states], dtype=np.bool_),
            interval_s=np.array([state.interval_s for state in states]),
        )

    def recorded(self, states: Sequence[State]) -> Columns:
        """Estimated fields of these States."""
        columns: Columns = {
            field: self._matrix([getattr(state, field) or () for state in states])
            for field in ESTIMATED
            if getattr(states[0], field) is not None  # older recordings lack some fields
        }
        links = {name: link for link, name in enumerate(self.joints)} | {"": NO_LINK}
        variants = set(self.beside)
        return {
            **columns,
            "side": self._sides(states),
            "touched_link": _codes(links.get(state.touched_link, STRANGE) for state in states),
            "beside": _codes(0 if state.beside.keys() == variants else STRANGE for state in states),
            **{
                f"beside {name}": self._matrix([state.beside.get(name, ()) for state in states])
                for name in self.beside
            },
            "flags": _codes(_flags_code(tuple(state.flags)) for state in states),
            **({} if states[0].wrench is None else {"wrench": _wrenches(states)}),
        }

    def _sides(self, states: Sequence[State]) -> NDArray[np.int8]:
        codes = map(SIDES.__getitem__, chain.from_iterable(state.side for state in states))
        shape = len(states), len(self.joints)
        return np.fromiter(codes, np.int8, shape[0] * shape[1]).reshape(shape)

    def replayed(self, made: EstimateRows) -> Columns:
        """Columns of the same fields from estimates."""
        return {
            **{field: getattr(made, name) for field, name in ESTIMATED.items()},
            "side": made.side,
            "touched_link": made.touched_link,
            "beside": np.zeros(len(made.flags), dtype=np.int64),
            **{f"beside {name}": made.beside[name] for name in self.beside},
            "flags": made.flags,
            "wrench": made.wrench,
        }

    def in_words(self, columns: Columns, field: str, row: int) -> object:
        """Value of a field in one row, converted back to its form in State."""
        if field == "beside":
            return {name: columns[f"beside {name}"][row].tolist() for name in self.beside}
        values = columns[field][row]
        if field == "side":
            return [SIDE_NAMES[side] for side in values.tolist()]
        if field == "wrench":
            return wrench_of(values)
        if field == "touched_link":
            return "" if values == NO_LINK else self.joints[values]
        if field == "flags":
            return [FLAG_NAMES[flag] for flag in Flag(int(values))]
        return values.tolist()

    def _matrix(self, rows: Sequence[Sequence[float]]) -> Matrix:
        """Rows (ticks, n); NaN for rows of another length."""
        n = len(self.joints)
        nothing = [np.nan] * n
        checked = [row if len(row) == n else nothing for row in rows]
        flat = np.fromiter(chain.from_iterable(checked), np.float64, n * len(rows))
        return flat.reshape(len(rows), n)


def first_difference(recorded: Columns, replayed: Columns) -> tuple[int, str] | None:
    """Row and name of the first field that differs, within a row the first in the columns' order;
    None if all are bit-identical."""
    first: tuple[int, str] | None = None
    for name, column in recorded.items():
        other = column != replayed[name]
        rows = np.flatnonzero(other.any(axis=1) if other.ndim > 1 else other)
        if rows.size and (first is None or rows[0] < first[0]):
            first = int(rows[0]), "beside" if name.startswith("beside ") else name
    return first


def _wrenches(states: Sequence[State]) -> Matrix:
    """Rows (ticks, WIDTH) of the numbers in a Wrench; NaN if there is none or it is malformed."""
    rows = np.zeros((len(states), WIDTH))
    for row, state in zip(rows, states, strict=True):
        one = state.wrench
        if one is None or len(one.force) != 3 or len(one.covariance) != 6:
            row[:] = np.nan
            continue
        row[:UNSEEN] = *one.force, *one.covariance, one.strength, one.misfit
        ways = [way for way in one.unseen if len(way) == 3][:3]
        row[UNSEEN : UNSEEN + 3 * len(ways)] = [part for way in ways for part in way]
    return rows


def _codes(codes: Iterator[int]) -> NDArray[np.int64]:
    return np.array(list(codes), dtype=np.int64)


def _flags_code(names: tuple[str, ...]) -> int:
    """Code of the flags with these names in their fixed order; STRANGE for others."""
    if names not in _FLAGS:
        return STRANGE
    return _FLAGS[names]


def _every_flag() -> Iterator[Flag]:
    return (Flag(code) for code in range(2 * max(FLAG_NAMES)))


_FLAGS: Final = {tuple(FLAG_NAMES[one] for one in flags): int(flags) for flags in _every_flag()}
