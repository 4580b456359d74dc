"""Rows of a recording, recomputed from its samples with other settings.

The estimator continues from the recorded memory, which includes all that was learned, or starts
afresh, as after switching on. The motion, with the arm's reactions, stays as recorded.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from common.errors import LogError, ModelError
from daemon.assembly import build_estimator
from daemon.config.dynamics import model_of
from daemon.config.schema import Configuration
from daemon.protocol.state import Snapshot, State
from estimator.estimator import Estimator
from programs.clients.columns import Layout
from programs.clients.log_reader import batches
from programs.clients.replay import alike, resets, same_estimator
from programs.recordings.replayed_payload import ReplayedPayload
from programs.recordings.rows import Rows, RowsHeader, chosen_residual, times_and_reports
from programs.recordings.settings import Change, changed_configuration


@dataclass(slots=True)
class ReplayedRows:
    """Rows of a recording with changed settings. Raises ContactdError if these do not fit."""

    path: Path
    changes: Sequence[Change]
    fresh: bool
    skipped: int = 0
    """Number of States left out, as the estimator's memory at their start is unknown."""
    _configuration: Configuration | None = None
    _estimator: Estimator | None = None
    _payload: ReplayedPayload | None = None
    _layout: Layout = field(default_factory=lambda: Layout((), ()))
    _begun_s: float | None = None
    _tick: int = -1
    _mode: str = ""

    def header(self, recorded: RowsHeader) -> RowsHeader:
        """Header of the recorded rows, with the changed settings."""
        c = self._settings()
        return replace(
            recorded,
            contact=[joint.thresholds.contact for joint in c.joints],
            debounce=c.estimator.debounce,
            learned=c.estimator.learning,
            shares_known=True,
            residual=c.estimator.residual.name,
            beside=[variant.name for variant in c.estimator.beside],
        )

    def parts(
        self, residual: str = "", progress: Callable[[float], None] = lambda share: None
    ) -> Iterator[Rows]:
        """Rows of all batches, with the named residual, by default the one that decides. States
        after a gap are left out until the next snapshot. A recording that breaks off ends
        there. Raises LogError if there are no rows."""
        rows = 0
        try:
            for batch in batches(self.path, progress):
                if isinstance(batch, Snapshot):
                    self._restart(batch)
                    continue
                if self._begun_s is None:
                    self._begun_s = batch[0].time_s
                for states in _stretches(batch):
                    for same in alike(states):
                        if part := self._step(same, residual):
                            rows += len(same)
                            yield part
                        else:
                            self.skipped += len(same)
        except LogError:
            if not rows:
                raise
        if not rows:
            raise LogError("has no state that follows a snapshot; --fresh begins without")

    def _settings(self) -> Configuration:
        if self._configuration is None:
            for batch in batches(self.path):
                if isinstance(batch, Snapshot):
                    self._configuration = changed_configuration(batch, self.changes)
                    break
        assert self._configuration is not None
        return self._configuration

    def _restart(self, snapshot: Snapshot) -> None:
        c = self._configuration = changed_configuration(snapshot, self.changes)
        self._estimator = build_estimator(c, model_of(c, snapshot.urdf))
        self._payload = ReplayedPayload(self.changes, c, self._estimator.model)
        self._layout = Layout(
            tuple(c.joint_names), tuple(variant.name for variant in c.estimator.beside)
        )
        if not self.fresh:
            self._restore(self._estimator, snapshot)
        self._tick, self._mode = snapshot.tick, ""

    def _restore(self, estimator: Estimator, snapshot: Snapshot) -> None:
        if not snapshot.memory:
            raise LogError(
                "was made from frames, without the estimator's memory; --fresh begins without"
            )
        if not same_estimator(snapshot):
            raise LogError(
                f"is of format {snapshot.format}, by {snapshot.program}: its estimator's memory is "
                "that of another version; --fresh begins without it"
            )
        try:
            estimator.restore(snapshot.memory)
        except (ModelError, LookupError, TypeError, ValueError, OverflowError) as error:
            raise LogError(
                f"has an estimator memory that does not fit these settings ({error}): "
                "--fresh begins without"
            ) from error

    def _step(self, states: list[State], residual: str) -> Rows | None:
        """Rows of States with equal settings, without a gap; None if the estimator's memory at
        their start is unknown."""
        follows = states[0].tick == self._tick + 1
        if not follows and not self.fresh:
            self._estimator = None
        if self._estimator is None or self._payload is None:
            return None
        if not follows:
            self._estimator.restart()
        self._payload.apply(self._estimator, states[0])
        made = self._estimator.run(self._layout.samples(states), resets(self._mode, states))
        begun = self._mode != ""
        self._tick, self._mode = states[-1].tick, str(states[-1].mode)
        c = self._configuration
        assert c is not None
        number = chosen_residual(residual, c.estimator.residual.name, [*made.beside])
        assert self._begun_s is not None
        time_s, reports = times_and_reports(states, self._begun_s, len(self._layout.joints))
        return Rows(
            time_s=time_s,
            follows=follows and begun,
            reports=reports,
            force_N=np.linalg.norm(made.wrench[:, :3], axis=1),
            residual=made.residual if number is None else made.beside[residual],
            threshold=made.threshold,
            level_share=made.level_share,
        )


def _stretches(states: list[State]) -> Iterator[list[State]]:
    """Runs of consecutive States, split where ticks are missing."""
    begin = 0
    for k in range(1, len(states) + 1):
        if k == len(states) or states[k].tick != states[k - 1].tick + 1:
            yield states[begin:k]
            begin = k
