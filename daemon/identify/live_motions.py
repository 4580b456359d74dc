"""Motions of a live arm: run, shown by a bar, recorded, and read back as measurements.

A step that was stopped goes on with what it has: an excitation is as much shorter as was measured.
"""

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from arrays import Matrix, Vector
from daemon.config.motion import row
from daemon.config.schema import Configuration
from daemon.identify.measured import Measured, read_measured, refuse_incompatible
from daemon.identify.motions import REPEATS_S, SLOWEST_S, bounds_of, excitation
from daemon.identify.session import InterruptedStepError, Session, discarded
from daemon.identify.soft_loop import REMEMBERED, why_not_followed
from daemon.identify.swinging import SwingWatch
from daemon.protocol.messages import State
from errors import ShortLogError
from estimator.identification.motion_log import PAUSE_S, MotionLog
from estimator.model import Model


class LiveMotions:
    """Motions of the arm of a session; `far` once it was moved by its links, and not by its motors
    a little."""

    def __init__(
        self, session: Session, console: Console, configuration: Configuration, model: Model
    ) -> None:
        self.session, self.console = session, console
        self.configuration, self.model = configuration, model
        self.far = False

    def link_position(self) -> Vector:
        """Of the arm (n,) [rad], once it holds. Raises ControlError."""
        return np.array(self.session.hold().link_position)

    def excite(
        self,
        step: str,
        seconds: float,
        seed: int,
        *,
        residuals: bool = False,
        turns_s: tuple[float, float] = (REPEATS_S, SLOWEST_S),
    ) -> Measured:
        """Move all joints along an excitation, hands off; turns_s: after how long it repeats, and
        the period of its slowest harmonic. Raises as `before` and `Session.run` do."""
        c = self.configuration
        bounds, period_s = bounds_of(c), c.period_s
        motion = excitation(bounds, self.model, period_s, seed, *turns_s)
        already = 0.0
        if (before := self.before(step, residuals=residuals)) is not None:
            # Each began with the way to the excitation, which teaches little and does not count.
            for rows in before.stretches(PAUSE_S):
                here, t = before.link_position[rows.start], before.time_s[rows]
                already += max(float(t[-1] - t[0]) - motion.approach_s(here), 0.0)
            self.tell(f"{already:.0f} s of {seconds:.0f} s are measured already")
        if seconds - already > 1.0:
            path = motion.path(self.link_position(), seconds - already)
            half_gap = row(c, lambda j: j.half_gap)
            watch = SwingWatch(c.joint_names, c.control.position_gain, half_gap)
            self.move(step, "all joints move, hands off", path, watch.saw, warning=discarded)
        return self.read(step)

    def before(self, step: str, *, residuals: bool = False) -> MotionLog | None:
        """Log of a step that was stopped, or None. Raises LogError, before anything moves, if the
        step cannot go on with it."""
        parts = self.session.parts(step)
        if not parts:
            return None
        refuse_incompatible(parts, self.configuration, residuals=residuals)
        files = ", ".join(str(part) for part in parts)
        self.tell(f"going on with what was measured before; to begin anew, delete {files}")
        try:
            return self.read(step).log
        except ShortLogError:
            return None

    def move(
        self,
        step: str,
        text: str,
        path: Matrix,
        remark: Callable[[State], str] = lambda _: "",
        **how: Any,
    ) -> None:
        """Run a path (N, n) [rad] with a bar for its progress; what `remark` says of a State is
        shown; how: as `Session.run` takes it, which says what is raised."""
        period = self.configuration.period_s
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        progress = Progress(*columns, console=self.console)
        task = progress.add_task(text, total=len(path) * period)
        last = deque[State](maxlen=REMEMBERED)

        def each(state: State) -> bool:
            last.append(state)
            progress.start()  # not before the arm moves, which may be refused
            progress.advance(task, state.interval_s)
            if said := remark(state):
                self.session.say(said)
            return False

        self.far = self.far or not how.get("motors_only")
        try:
            self.session.run(step, path, period, each, **how)
            progress.update(task, completed=len(path) * period)
        except InterruptedStepError as error:
            if helps := why_not_followed(str(error), tuple(last), self.configuration):
                raise InterruptedStepError(f"{error}{helps}") from error
            raise
        finally:
            progress.stop()

    def read(self, step: str, *, gap_of: str = "") -> Measured:
        """What was measured in a step. Raises LogError."""
        return read_measured(self.session.parts(step), self.configuration, gap_of=gap_of)

    def forget(self, step: str) -> None:
        """Delete what was measured in a step."""
        for part in self.session.parts(step):
            part.unlink()

    def tell(self, text: str) -> None:
        """Show the person a text."""
        self.console.print(text, markup=False, highlight=False)
