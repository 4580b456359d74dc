"""Replay of a recording: the estimator on its samples again, compared with it bit by bit.

Recordings of format 2 are of an estimator that did the same arithmetic in another order: they are
compared to a tolerance, which the result says.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daemon.assembly import build_estimator
from daemon.clients.recorder import read_log
from daemon.config.load import parse_configuration
from daemon.modes.table import Mode
from daemon.protocol.messages import Snapshot, State
from daemon.tick.telemetry import estimated
from errors import LogError
from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.memory import of_format_2

BEFORE_THE_KERNEL = 2
"""Format of which the estimator was not the kernel yet."""
TOLERANCE = 1e-9
"""[Nm, rad, rad/s]; by which numbers of that one may differ"""


@dataclass(frozen=True, slots=True)
class Difference:
    """First field that came out different."""

    tick: int
    field: str
    recorded: object
    replayed: object


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay: states compared, stretches without a gap, and the first difference."""

    states: int
    skipped: int  # after a gap, before the next snapshot
    stretches: int
    difference: Difference | None
    broken: str  # reason why the recording ends early; empty if it is whole
    tolerance: float = 0.0  # by which numbers might differ; 0: every bit was compared

    @property
    def equal(self) -> bool:
        """Every state was compared and came out the same, to the tolerance."""
        return self.difference is None and self.states > 0

    @property
    def identical(self) -> bool:
        """Every state was compared and came out the same, bit by bit."""
        return self.equal and self.tolerance == 0.0


def replay(path: Path) -> Replay:
    """Compare every State of `path` with what the present estimator makes of its samples.

    Raises LogError if there is nothing to read; a recording that breaks off is compared up to
    there.
    """
    run = _Run(path)
    broken = ""
    try:
        for message in read_log(path):
            if isinstance(message, Snapshot):
                run.restart(message)
            else:
                run.compare(message)
    except LogError as error:
        if not run.states:
            raise
        broken = str(error)
    return Replay(run.states, run.skipped, run.stretches, run.difference, broken, run.tolerance)


class _Run:
    def __init__(self, path: Path) -> None:
        self._path = path
        self.states = self.skipped = self.stretches = 0
        self.difference: Difference | None = None
        self.tolerance = 0.0
        self._estimator: Estimator | None = None
        self._tick = -1
        self._mode = ""

    def restart(self, snapshot: Snapshot) -> None:
        if snapshot.format < BEFORE_THE_KERNEL:
            raise LogError(
                f"{self._path} is of format {snapshot.format}, by {snapshot.program}, whose "
                "estimator remembered other things: replay it with that version"
            )
        configuration = parse_configuration(
            snapshot.configuration, "the recorded configuration", snapshot.identified
        )
        self._estimator = build_estimator(configuration, snapshot.urdf)
        try:
            if snapshot.format == BEFORE_THE_KERNEL:
                self.tolerance = TOLERANCE
                self._estimator.restore(of_format_2(snapshot.memory))
            else:
                self._estimator.restore(snapshot.memory)
        except (LookupError, TypeError, ValueError, OverflowError, AttributeError) as error:
            raise LogError(
                f"the estimator's memory after tick {snapshot.tick} is damaged: {error}"
            ) from error
        self._tick, self._mode = snapshot.tick, ""
        self.stretches += 1

    def compare(self, state: State) -> None:
        if self._estimator is None or state.tick != self._tick + 1:
            # The estimator's memory of the gap is lost until the next snapshot.
            self._estimator = None
            self.skipped += 1
            return
        self._tick = state.tick
        motor = state.motor_position
        # What makes no finite number of them is flagged in the estimate.
        with np.errstate(all="ignore"):
            estimate = self._estimator.step(
                np.array(state.current),
                np.array(state.link_position),
                np.array(state.motor_velocity),
                None if motor is None else np.array(motor),
                state.interval_s,
                time_s=state.time_s,
                fresh=np.array(state.fresh),
            )
        # As the tick does when the arm begins to hold.
        if self._mode == Mode.ENABLING and state.mode == Mode.HOLDING:
            self._estimator.reset()
        self._mode = state.mode
        self.states += 1
        self.difference = self.difference or _difference(state, estimate, self.tolerance)


def _difference(state: State, estimate: Estimate, tolerance: float) -> Difference | None:
    for field, value in estimated(estimate).items():
        recorded = getattr(state, field)
        if not _same(recorded, value, tolerance):
            return Difference(state.tick, field, recorded, value)
    return None


def _same(recorded: Any, replayed: Any, tolerance: float) -> bool:
    """True for values, or lists or tables of them, that are equal, numbers to the tolerance."""
    if recorded == replayed:
        return True
    if isinstance(recorded, list) and isinstance(replayed, list):
        pairs = zip(recorded, replayed, strict=False)
        return len(recorded) == len(replayed) and all(_same(*pair, tolerance) for pair in pairs)
    if isinstance(recorded, dict) and isinstance(replayed, dict):
        return recorded.keys() == replayed.keys() and all(
            _same(recorded[key], replayed[key], tolerance) for key in recorded
        )
    if isinstance(recorded, float) and isinstance(replayed, float):
        return abs(recorded - replayed) <= tolerance
    return False
