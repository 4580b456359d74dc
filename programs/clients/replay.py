"""Replay of a recording: runs the estimator over its samples and compares the results bit by bit.

Batches of consecutive States are decoded, converted to arrays, stepped through, and compared.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Final

from common.errors import ContactdError, LogError
from daemon.config.load import parse_configuration
from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State
from estimator.estimator import Estimator
from programs.clients.columns import Columns, Layout, first_difference
from programs.clients.log_reader import read_batches

SAME_ESTIMATOR = 7
"""First format whose estimator computes the same as the present one; earlier ones differed in
friction near rest, or in learning."""

_UNKNOWN: Final = object()  # payload before the first State


def same_estimator(snapshot: Snapshot) -> bool:
    """True if the present estimator can continue from memory of the snapshot's format."""
    return snapshot.format >= SAME_ESTIMATOR


def incomparable(snapshot: Snapshot) -> str:
    """Reason, to follow the file's name, why States after this snapshot cannot be compared."""
    if not snapshot.memory:
        return "was made from frames of a black box: there is no estimate to compare with"
    return (
        f"is of format {snapshot.format}, by {snapshot.program}, whose estimator was a different "
        "one: replay it with that version"
    )


@dataclass(frozen=True, slots=True)
class Difference:
    """First field that differs."""

    tick: int
    field: str
    recorded: object
    replayed: object


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay: states compared, stretches without a gap, and the first difference."""

    states: int
    skipped: int  # States after a gap, before the next snapshot
    stretches: int
    difference: Difference | None
    broken: str  # why the recording ends early, or empty
    older: str = ""  # why nothing can be compared, or empty

    @property
    def identical(self) -> bool:
        """True if States were compared and all were bit-identical."""
        return self.difference is None and self.states > 0


def replay(
    path: Path,
    on_batch: Callable[[Snapshot | list[State]], None] = lambda batch: None,
    progress: Callable[[float], None] = lambda share: None,
) -> Replay:
    """Compare the States of `path` with the present estimator's results on their samples.

    `on_batch` is called with all that is read. Nothing is compared if another version of the
    estimator made the recording. Raises LogError if there is nothing to read; a truncated
    recording is compared as far as it is intact.
    """
    run = _Run(path)

    def take(batch: Snapshot | list[State]) -> None:
        on_batch(batch)
        if isinstance(batch, Snapshot):
            run.restart(batch)
        else:
            run.compare(batch)

    broken = read_batches(path, take, progress)
    older = f"{path} {run.older}" if run.older else ""
    return Replay(run.states, run.skipped, run.stretches, run.difference, broken, older)


def alike(states: list[State]) -> Iterator[list[State]]:
    """Runs of States with one payload, and with learning either on or suspended."""
    for _, same in groupby(states, lambda state: (state.payload, state.recognised is None)):
        yield list(same)


def resets(mode: str, states: list[State]) -> frozenset[int]:
    """Rows at which the mode changes from enabling to holding, when the daemon resets its
    estimator; `mode`: that before the first row."""
    modes = [mode, *(state.mode for state in states)]
    changes = enumerate(pairwise(modes))
    return frozenset(k for k, of in changes if of == (Mode.ENABLING, Mode.HOLDING))


class _Run:
    def __init__(self, path: Path) -> None:
        self._path = path
        self.older = ""
        self.states = self.skipped = self.stretches = 0
        self.difference: Difference | None = None
        self._estimator: Estimator | None = None
        self._layout = Layout((), ())
        self._tick = -1
        self._mode = ""
        self._payload: object = _UNKNOWN

    def restart(self, snapshot: Snapshot) -> None:
        self._estimator = None
        if self.older or not same_estimator(snapshot) or not snapshot.memory:
            self.older = self.older or incomparable(snapshot)
            return
        # These imports load pinocchio.
        from daemon.assembly import build_estimator  # noqa: PLC0415
        from daemon.config.dynamics import model_of  # noqa: PLC0415

        where = f"the snapshot after tick {snapshot.tick}"
        try:
            configuration = parse_configuration(
                snapshot.configuration, "the recorded configuration", snapshot.identified
            )
            joints = tuple(configuration.joint_names)
            if len(joints) != len(snapshot.joints):
                raise LogError(f"{len(snapshot.joints)} joints, {len(joints)} in its configuration")
            model = model_of(configuration, snapshot.urdf)
            self._estimator = build_estimator(configuration, model)
            where = f"the estimator's memory after tick {snapshot.tick}"
            self._estimator.restore(snapshot.memory)
        except (
            ContactdError, LookupError, TypeError, ValueError, OverflowError, AttributeError
        ) as error:  # fmt: skip
            raise LogError(f"{self._path}: {where} is damaged: {error}") from error
        beside = tuple(variant.name for variant in configuration.estimator.beside)
        self._layout = Layout(joints, beside)
        self._payload = _UNKNOWN
        self._tick, self._mode = snapshot.tick, ""
        self.stretches += 1

    def compare(self, states: list[State]) -> None:
        gapless = self._without_gap(states)
        self.skipped += len(states) - len(gapless)
        if self._estimator is not None and gapless:
            for same in alike(gapless):
                self._step(self._estimator, same)
        if len(gapless) < len(states):
            # After a gap the estimator's memory is unknown until the next snapshot.
            self._estimator = None

    def _step(self, estimator: Estimator, states: list[State]) -> None:
        """Compare States that are `alike`."""
        if (payload := states[0].payload) != self._payload:
            estimator.carry(payload)
            self._payload = payload
        estimator.freeze_learning(states[0].recognised is not None)
        samples = self._layout.samples(states)
        made = estimator.run(samples, resets(self._mode, states))
        self.states += len(states)
        self._tick, self._mode = states[-1].tick, states[-1].mode
        if self.difference is None:
            self.difference = self._first_difference(states, self._layout.replayed(made))

    def _without_gap(self, states: list[State]) -> list[State]:
        """States that follow the last one, up to the first gap."""
        if self._estimator is None:
            return []
        steps = zip(states, range(self._tick + 1, self._tick + 1 + len(states)), strict=True)
        gap = next((k for k, (state, tick) in enumerate(steps) if state.tick != tick), len(states))
        return states[:gap]

    def _first_difference(self, states: list[State], replayed: Columns) -> Difference | None:
        found = first_difference(self._layout.recorded(states), replayed)
        if found is None:
            return None
        row, field = found
        recorded = getattr(states[row], field)
        return Difference(
            states[row].tick, field, recorded, self._layout.in_words(replayed, field, row)
        )
