"""Replay of a recording: the estimator on its samples again, compared with it bit by bit.

In batches of consecutive States: decoded, turned into arrays, stepped through, compared as arrays.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from daemon.assembly import build_estimator
from daemon.clients.columns import Columns, Layout, first_difference
from daemon.clients.recorder import read_log
from daemon.config.load import parse_configuration
from daemon.modes.table import Mode
from daemon.protocol.messages import Snapshot, State
from errors import LogError
from estimator.estimator import Estimator

SAME_ESTIMATOR = 4
"""Format from which on the estimator computes what it does now: those before believed something
else of friction near rest, and did not learn."""

BATCH: Final = 32  # States at once; of more, the decoded ones leave the processor's cache


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

    @property
    def identical(self) -> bool:
        """Every state was compared and came out the same, bit by bit."""
        return self.difference is None and self.states > 0


def replay(path: Path) -> Replay:
    """Compare every State of `path` with what the present estimator makes of its samples.

    Raises LogError if there is nothing to read; a recording that breaks off is compared up to
    there.
    """
    run = _Run(path)
    broken = ""
    try:
        for batch in batches(path):
            if isinstance(batch, Snapshot):
                run.restart(batch)
            else:
                run.compare(batch)
    except LogError as error:
        if not run.states:
            raise
        broken = str(error)
    return Replay(run.states, run.skipped, run.stretches, run.difference, broken)


def batches(path: Path) -> Iterator[Snapshot | list[State]]:
    """Snapshots of a recording, and what lies between them in batches.

    Raises LogError like `read_log`, after all that came whole.
    """
    states: list[State] = []
    broken: LogError | None = None
    try:
        for message in read_log(path):
            if isinstance(message, State):
                states.append(message)
            if states and (message is not states[-1] or len(states) == BATCH):
                yield states
                states = []
            if isinstance(message, Snapshot):
                yield message
    except LogError as error:
        broken = error
    if states:
        yield states
    if broken is not None:
        raise broken


class _Run:
    def __init__(self, path: Path) -> None:
        self._path = path
        self.states = self.skipped = self.stretches = 0
        self.difference: Difference | None = None
        self._estimator: Estimator | None = None
        self._layout = Layout((), ())
        self._tick = -1
        self._mode = ""

    def restart(self, snapshot: Snapshot) -> None:
        if snapshot.format < SAME_ESTIMATOR:
            raise LogError(
                f"{self._path} is of format {snapshot.format}, by {snapshot.program}, whose "
                "estimator computed something else: replay it with that version"
            )
        configuration = parse_configuration(
            snapshot.configuration, "the recorded configuration", snapshot.identified
        )
        joints = tuple(configuration.joint_names)
        if len(joints) != len(snapshot.joints):
            raise LogError(
                f"the snapshot after tick {snapshot.tick} is damaged: {len(snapshot.joints)} "
                f"joints, {len(joints)} in its configuration"
            )
        self._estimator = build_estimator(configuration, snapshot.urdf)
        try:
            self._estimator.restore(snapshot.memory)
        except (LookupError, TypeError, ValueError, OverflowError, AttributeError) as error:
            raise LogError(
                f"the estimator's memory after tick {snapshot.tick} is damaged: {error}"
            ) from error
        beside = tuple(variant.name for variant in configuration.estimator.beside)
        self._layout = Layout(joints, beside)
        self._tick, self._mode = snapshot.tick, ""
        self.stretches += 1

    def compare(self, states: list[State]) -> None:
        whole = self._without_gap(states)
        self.skipped += len(states) - len(whole)
        if self._estimator is not None and whole:
            samples = self._layout.samples(whole)
            made = self._estimator.run(samples, self._resets(whole))
            self.states += len(whole)
            self._tick, self._mode = whole[-1].tick, whole[-1].mode
            if self.difference is None:
                self.difference = self._first_difference(whole, self._layout.replayed(made))
        if len(whole) < len(states):
            # The estimator's memory of the gap is lost until the next snapshot.
            self._estimator = None

    def _without_gap(self, states: list[State]) -> list[State]:
        """The States that follow on the last one, up to the first gap."""
        if self._estimator is None:
            return []
        steps = zip(states, range(self._tick + 1, self._tick + 1 + len(states)), strict=True)
        gap = next((k for k, (state, tick) in enumerate(steps) if state.tick != tick), len(states))
        return states[:gap]

    def _resets(self, states: list[State]) -> frozenset[int]:
        """Rows at which the arm begins to hold: the tick resets its estimator then."""
        modes = [self._mode, *(state.mode for state in states)]
        changes = enumerate(pairwise(modes))
        return frozenset(k for k, of in changes if of == (Mode.ENABLING, Mode.HOLDING))

    def _first_difference(self, states: list[State], replayed: Columns) -> Difference | None:
        found = first_difference(self._layout.recorded(states), replayed)
        if found is None:
            return None
        row, field = found
        recorded = getattr(states[row], field)
        return Difference(
            states[row].tick, field, recorded, self._layout.in_words(replayed, field, row)
        )
