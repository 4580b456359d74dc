"""Rows of a recording: the values that decide on contacts, as arrays with one row per tick.

They are gathered in batches, cached by `row_cache`, and read in parts, so that memory does not grow
with the recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import LogError
from daemon.config.load import parse_configuration
from daemon.modes.table import SENSING, YIELDING
from daemon.protocol.state import Snapshot, State

#: Columns of Rows with one number per joint.
MATRICES: Final = ("residual", "threshold", "level_share")
_LEARNS_SINCE: Final = 4  # first format with learning


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Consecutive ticks, (ticks,) or (ticks, n); torques [Nm]."""

    time_s: Vector
    """Time from the first State of the recording."""
    follows: bool
    """True if no tick is missing before the first row."""
    reports: NDArray[np.bool_]
    """Joints whose contacts were reported: the arm was energised and the joint sensed contact."""
    force_N: Vector
    """Norm of the estimated force at the tool; 0 if there was none, or it was not recorded."""
    residual: Matrix
    threshold: Matrix
    """Threshold in force."""
    level_share: Matrix
    """Share of the configured level in force; 1 if it was not recorded."""


class RowsHeader(msgspec.Struct, frozen=True, kw_only=True):
    """Values common to all rows of a recording."""

    joints: list[str]
    contact: list[float]  # configured levels [Nm]
    debounce: int  # [ticks]
    learned: bool  # learning was on
    shares_known: bool  # level_share was recorded
    residual: str  # name of the residual that decided
    beside: list[str]
    rows: int
    period_s: float  # duration of a row
    stretches: list[int]  # rows before which ticks are missing
    duration_s: float
    reaction_s: float | None  # time of the arm's first reaction to a contact
    broken: str = ""  # why the recording ends early, without its name


def times_and_reports(
    states: Sequence[State], begun_s: float, n: int
) -> tuple[Vector, NDArray[np.bool_]]:
    """Columns Rows.time_s and Rows.reports for States of `n` joints."""
    always, never = [True] * n, [False] * n
    time_s = np.array([state.time_s for state in states]) - begun_s
    reports = [(state.sensing or always) if state.mode in SENSING else never for state in states]
    return time_s, np.array(reports, dtype=np.bool_)


def chosen_residual(asked: str, decided: str, beside: Sequence[str]) -> int | None:
    """Index of the residual `asked` for in `beside`; None for the one that decided, or an empty
    name. Raises LogError if there is no such residual."""
    if asked in ("", decided):
        return None
    if asked not in beside:
        known = ", ".join([decided, *beside])
        raise LogError(f"has no residual {asked!r}; there are: {known}")
    return beside.index(asked)


def beside_column(number: int) -> str:
    """File name of the column of a residual in `beside`, whose own name may contain a path."""
    return f"beside_{number}"


class RowsGatherer:
    """Builder of the columns of one recording, batch by batch."""

    def __init__(self, snapshot: Snapshot) -> None:
        c = parse_configuration(
            snapshot.configuration, "the recorded configuration", snapshot.identified
        )
        self._joints, self._configuration = tuple(snapshot.joints), c
        self._n, self._format = len(self._joints), snapshot.format
        self._beside: tuple[str, ...] | None = None
        self.rows = 0
        self._stretches: list[int] = []
        self._begun_s = self._ended_s = 0.0
        self._tick = -1
        self._reaction_s: float | None = None
        self._mode = ""
        self._shares_known = True

    def refuse_other_arm(self, path: Path, snapshot: Snapshot) -> None:
        """Raise LogError for the snapshot of another arm."""
        if tuple(snapshot.joints) != self._joints:
            raise LogError(f"{path} contains recordings of two arms")

    def columns(self, states: Sequence[State]) -> dict[str, NDArray[Any]]:
        """Columns of the next States, by file name."""
        if self._beside is None:
            self._beside, self._begun_s = tuple(states[0].beside), states[0].time_s
        elif states[0].tick != self._tick + 1:
            self._stretches.append(self.rows)
        for k, state in enumerate(states):
            if k and state.tick != states[k - 1].tick + 1:
                self._stretches.append(self.rows + k)
            self._process_state(state)
        self._tick, self._ended_s = states[-1].tick, states[-1].time_s
        self.rows += len(states)
        if states[0].level_share is None:
            self._shares_known = False
        ones = [1.0] * self._n
        time_s, reports = times_and_reports(states, self._begun_s, self._n)
        return {
            "time_s": time_s,
            "reports": reports,
            "force_N": np.array([hypot(*s.wrench.force) if s.wrench else 0.0 for s in states]),
            "residual": np.array([state.residual for state in states]),
            "threshold": np.array([state.threshold for state in states]),
            "level_share": np.array([state.level_share or ones for state in states]),
            **{
                beside_column(k): self._of_variant(states, name)
                for k, name in enumerate(self._beside)
            },
        }

    def _of_variant(self, states: Sequence[State], name: str) -> Matrix:
        nothing = [0.0] * self._n
        found = [state.beside.get(name, nothing) for state in states]
        return np.array([row if len(row) == self._n else nothing for row in found])

    def _process_state(self, state: State) -> None:
        if self._reaction_s is None:
            changed = any(notice.kind == "mode" for notice in state.notices)
            touched = any(notice.contact is not None for notice in state.notices)
            if state.mode in YIELDING or (changed and touched):
                self._reaction_s = state.time_s - self._begun_s

    def header(self, broken: str) -> RowsHeader:
        """Header of the rows gathered so far."""
        c = self._configuration
        return RowsHeader(
            joints=list(self._joints),
            contact=[joint.thresholds.contact for joint in c.joints],
            debounce=c.estimator.debounce,
            learned=c.estimator.learning and self._format >= _LEARNS_SINCE,
            shares_known=self._shares_known,
            residual=c.estimator.residual.name,
            beside=list(self._beside or ()),
            rows=self.rows,
            period_s=c.period_s,
            stretches=self._stretches,
            duration_s=self._ended_s - self._begun_s,
            reaction_s=self._reaction_s,
            broken=broken,
        )
