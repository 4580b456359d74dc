"""Hypothetical contacts of one recording: at other levels, by another residual, or with other
settings.

Residual, threshold and its lowering by learning are recorded, so that other levels do not need the
estimator. For other settings the samples are replayed. An answer depends only on the recording and
the question, both of which can be sent to another process or machine.
"""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import ContactdError, LogError
from estimator.alarms import critical_collision, critical_level
from estimator.level_sweep import Debounce, Sweep, Window, levels_passed
from programs.recordings.labels import ANY, Label
from programs.recordings.question import ARM, COLLISION, Answer, Curve, FoundContact, Question
from programs.recordings.row_cache import CachedRows, content_digest
from programs.recordings.rows import MATRICES, Rows, RowsHeader

MOST_CONTACTS: Final = 500  # listed for one recording


@dataclass(slots=True)
class _Joint:
    """Sweep of one joint."""

    column: int
    levels: Vector
    sweep: Sweep


class _Levels:
    """Sweeps of the joints in question over their contact or collision levels."""

    def __init__(
        self, critical: Callable[..., Matrix], joints: list[_Joint], header: RowsHeader
    ) -> None:
        self.joints = joints
        self._critical, self._contact = critical, np.array(header.contact)
        self._debounce = Debounce(len(header.joints), header.debounce)

    def forget(self) -> None:
        """Start afresh after a gap."""
        self._debounce.forget()
        for joint in self.joints:
            joint.sweep.forget()

    def add(self, rows: Rows) -> NDArray[np.int64]:
        """Add rows; returns the largest number of levels that a joint exceeds (ticks,)."""
        most = np.zeros(len(rows.time_s), dtype=np.int64)
        if not self.joints:
            return most
        critical = self._critical(rows.residual, rows.threshold, self._contact, rows.level_share)
        critical[~rows.reports] = 0.0
        passed = self._debounce.add(critical, rows.residual)
        for joint in self.joints:
            k = levels_passed(passed[:, joint.column], joint.levels)
            joint.sweep.add(rows.time_s, k)
            most = np.maximum(most, np.abs(k))
        return most


def ask(
    file: Path,
    question: Question,
    labels: tuple[Label, ...] = (),
    cache: Path | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Answer:
    """Answer of a recording. Does not raise ContactdError: `failed` has the reason instead."""
    try:
        with (
            contextlib.closing(CachedRows(file, content_digest(file), cache, progress)) as recorded,
            np.errstate(over="ignore", invalid="ignore"),  # implausible values may overflow
        ):
            return _Asked(file, question, labels, recorded).answer(progress)
    except ContactdError as error:
        return Answer(file=str(file), failed=naming(file, error))
    except OSError as error:
        return Answer(file=str(file), failed=f"{file}: its columns in the cache: {error}")


class _Asked:
    """Evaluation of a question for one recording."""

    def __init__(
        self, file: Path, question: Question, labels: tuple[Label, ...], recorded: CachedRows
    ) -> None:
        self.file, self.question, self.recorded = file, question, recorded
        header = recorded.header
        self.labels = labels
        for label in labels:
            _refuse_unknown(label.joint, header, but=ANY)
            if label.start_s > header.duration_s:
                raise LogError(
                    f"has a label from {label.start_s:g} s on, but lasts only "
                    f"{header.duration_s:.2f} s: times count from its first state"
                )
        for joint in (*question.levels, *question.collisions):
            _refuse_unknown(joint, header)
        self.end_s = np.inf
        if question.until_reaction and header.reaction_s is not None:
            self.end_s = header.reaction_s
        self.touches = [Window(label.start_s, label.end_s) for label in labels]

    def answer(self, progress: Callable[[float], None]) -> Answer:
        """Complete answer."""
        header, question = self.recorded.header, self.question
        answer = Answer(
            file=str(self.file),
            broken=header.broken,
            duration_s=header.duration_s,
            reaction_s=header.reaction_s,
            shares_known=header.shares_known or not header.learned,
        )
        parts = self.recorded.parts(question.residual)
        replayed = None
        if question.changes or question.fresh:
            from programs.recordings.replayed import ReplayedRows  # noqa: PLC0415 - pinocchio

            answer.recorded, answer.recorded_N = _contacts(self._cut(self.recorded.parts()), header)
            replayed = ReplayedRows(self.file, question.changes, fresh=question.fresh)
            parts = replayed.parts(question.residual, progress)
            header = replayed.header(header)
            answer.shares_known = True
        elif question.residual:
            answer.recorded, answer.recorded_N = _contacts(self._cut(self.recorded.parts()), header)
        self._count(answer, parts, header)
        if replayed is not None:
            answer.skipped_s = header.period_s * replayed.skipped
        if not (question.changes or question.fresh or question.residual):
            answer.recorded, answer.recorded_N = answer.contacts, answer.force_N
        return answer

    def _cut(self, parts: Iterator[Rows]) -> Iterator[Rows]:
        """Rows up to the end in question."""
        for rows in parts:
            count = int(np.searchsorted(rows.time_s, self.end_s, side="right"))
            if count:
                yield _first(rows, count)
            if count < len(rows.time_s):
                return

    def _count(self, answer: Answer, parts: Iterator[Rows], header: RowsHeader) -> None:
        """Add, in one pass over the rows, contacts at the levels in force, and all curves."""
        levels = _Levels(critical_level, self._joints(header, self.question.levels), header)
        hard = _Levels(critical_collision, self._joints(header, self.question.collisions), header)
        count = {len(joint.levels) for joint in levels.joints}
        arm = Sweep(count.pop(), self.touches) if len(count) == 1 else None
        others = self._others(levels.joints, len(header.joints))
        in_force, found = Debounce(len(header.joints), header.debounce), _Contacts(header)
        for rows in self._cut(parts):
            if not rows.follows:
                for one in (levels, hard, in_force, found, arm):
                    if one is not None:
                        one.forget()
            beyond = in_force.add(_beyond(rows), rows.residual)
            found.add(rows, beyond)
            self._watch(answer, rows, header.period_s)
            hard.add(rows)
            most = levels.add(rows)
            if arm is not None:
                now = (beyond != 0.0).any(axis=1, where=others)
                arm.add(rows.time_s, np.maximum(most, np.where(now, arm.count, 0)))
        answer.contacts, answer.force_N = found.found, found.most_N
        for kind, name in ((levels, ""), (hard, COLLISION)):
            answer.curves |= {
                header.joints[j.column] + name: _curve(j.sweep, j.levels.tolist(), header.period_s)
                for j in kind.joints
            }
        if arm is not None:
            steps = np.arange(1.0, arm.count + 1).tolist()
            answer.curves[ARM] = _curve(arm, steps, header.period_s)

    def _watch(self, answer: Answer, rows: Rows, period_s: float) -> None:
        """Add the time in which contacts are reported, and its part outside of all labels."""
        watched = rows.reports.any(axis=1)
        answer.watched_s += period_s * int(np.count_nonzero(watched))
        for window in self.touches:
            watched &= (rows.time_s < window.begin_s) | (rows.time_s > window.end_s)
        answer.outside_s += period_s * int(np.count_nonzero(watched))

    def _joints(self, header: RowsHeader, asked: dict[str, tuple[float, ...]]) -> list[_Joint]:
        """Sweeps of the joints of `asked`, each over its levels."""
        joints = []
        for name, levels in asked.items():
            windows = [
                window
                for window, label in zip(self.touches, self.labels, strict=True)
                if label.joint in (name, ANY)
            ]
            sweep = Sweep(len(levels), windows, self.touches)
            joints.append(_Joint(header.joints.index(name), np.array(levels), sweep))
        return joints

    @staticmethod
    def _others(joints: list[_Joint], n: int) -> NDArray[np.bool_]:
        """Joints (n,) whose level is not swept."""
        others = np.ones(n, dtype=np.bool_)
        others[[joint.column for joint in joints]] = False
        return others


def _beyond(rows: Rows) -> Matrix:
    """Excess of |r| over the threshold in force (ticks, n) [Nm], at least 0."""
    beyond: Matrix = np.where(rows.reports, np.abs(rows.residual) - rows.threshold, 0.0)
    return np.maximum(beyond, 0.0)


class _Contacts:
    """List of contacts at the levels in force, and the largest force."""

    def __init__(self, header: RowsHeader) -> None:
        self._joints = header.joints
        self._before = np.zeros(len(header.joints))
        self.found: list[FoundContact] = []
        self.most_N = 0.0  # at the tool

    def forget(self) -> None:
        """Start afresh after a gap."""
        self._before[:] = 0.0

    def add(self, rows: Rows, beyond: Matrix) -> None:
        """Add rows, with their debounced, signed excess over the thresholds."""
        before = np.vstack([self._before, beyond[:-1]])
        self._before = beyond[-1]
        self.most_N = max(self.most_N, float(np.max(rows.force_N * rows.reports.any(axis=1))))
        for k, i in np.argwhere((beyond != 0.0) & (beyond * before <= 0.0)).tolist():
            if len(self.found) < MOST_CONTACTS:
                self.found.append(
                    FoundContact(
                        float(rows.time_s[k]),
                        self._joints[i],
                        float(rows.residual[k, i]),
                        float(rows.threshold[k, i]),
                    )
                )


def _contacts(parts: Iterator[Rows], header: RowsHeader) -> tuple[list[FoundContact], float]:
    """Contacts of all rows at the levels in force, and the largest force at the tool [N]."""
    debounce, found = Debounce(len(header.joints), header.debounce), _Contacts(header)
    for rows in parts:
        if not rows.follows:
            debounce.forget()
            found.forget()
        found.add(rows, debounce.add(_beyond(rows), rows.residual))
    return found.found, found.most_N


def _first(rows: Rows, count: int) -> Rows:
    if count == len(rows.time_s):
        return rows
    names = ("time_s", "reports", "force_N", *MATRICES)
    return replace(rows, **{name: getattr(rows, name)[:count] for name in names})


def _curve(sweep: Sweep, levels: list[float], period_s: float) -> Curve:
    known = np.isfinite(sweep.delays_s)
    return Curve(
        levels=levels,
        contacts=sweep.contacts.tolist(),
        false=sweep.false.tolist(),
        beyond_s=(period_s * sweep.beyond).tolist(),
        labels=len(sweep.windows),
        found=np.count_nonzero(known, axis=0).tolist(),
        delays_s=[sweep.delays_s[known[:, k], k].tolist() for k in range(sweep.count)],
    )


def naming(file: Path, error: ContactdError) -> str:
    """Text of an error, prefixed by the file unless it contains its name."""
    text = str(error)
    if str(file) in text:
        return text
    return f"{file} {text}" if isinstance(error, LogError) else f"{file}: {text}"


def _refuse_unknown(joint: str, header: RowsHeader, but: str = "") -> None:
    if joint not in header.joints and joint != but:
        raise LogError(f"has no joint {joint!r}; there are: {', '.join(header.joints)}")
