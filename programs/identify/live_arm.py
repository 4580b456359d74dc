"""Live arm: moves it with a progress bar, reads the recordings back as measurements, and restores
its state after a step.

A step that was interrupted reuses its recordings: the rest of an excitation is shorter accordingly.
"""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from common.arrays import Matrix, Vector
from common.errors import ConfigurationError, ShortLogError, UnreachableError
from daemon.config.identified import same_samples
from daemon.config.load import Robot
from daemon.config.vectors import row
from daemon.modes.table import Mode
from daemon.protocol.state import State
from identification.excitation import point_to_point
from identification.motion_log import PAUSE_S, MotionLog
from programs.identify.contact_warnings import discarded
from programs.identify.limit_cycle_watch import LimitCycleWatch
from programs.identify.measured import Measured, read_measured, refuse_incompatible
from programs.identify.motions import REPEATS_S, SLOWEST_S, bounds_of, excitation, slow
from programs.identify.session import InterruptedStepError, Session
from programs.identify.velocity_loop import REMEMBERED, advice_on_following

MOVED = 0.05
"""Displacement beyond which an arm returns to where it stood before it is switched off [rad]."""
TO_READ_ANEW = "`contactctl disable` (after a fault `contactctl reset`)"


class LiveArm:
    """Arm behind a running daemon, as a source of measurements.

    Raises ConfigurationError if the daemon runs with another configuration than `robot`.
    """

    def __init__(self, robot: Robot, session: Session, console: Console) -> None:
        self.session, self.console = session, console
        self.configuration = robot.configuration
        self.model = robot.model
        self._far = False  # True once more than single motors, within their gaps, has moved
        if not same_samples(session.configuration(), self.configuration):
            raise ConfigurationError(
                f"drives, wiring or period in {robot.path} were changed since the daemon read it: "
                f"{TO_READ_ANEW}, then this again"
            )

    def link_position(self, *, motors_only: bool = False) -> Vector:
        """Link positions (n,) [rad], once the arm holds. Raises as `Session.hold` does."""
        return np.array(self.session.hold(motors_only=motors_only).link_position)

    def excite(
        self,
        step: str,
        seconds: float,
        seed: int,
        *,
        residuals: bool = False,
        turns_s: tuple[float, float] = (REPEATS_S, SLOWEST_S),
    ) -> Measured:
        """Move all joints along an excitation, hands off; turns_s: its repetition period, and the
        period of its slowest harmonic. Raises as `before` and `Session.run` do."""
        c = self.configuration
        bounds, period_s = bounds_of(c), c.period_s
        motion = excitation(bounds, self.model, period_s, seed, *turns_s)
        already = 0.0
        if (before := self.before(step, residuals=residuals)) is not None:
            # The approach to the excitation yields little information and does not count.
            for rows in before.stretches(PAUSE_S):
                here, t = before.link_position[rows.start], before.time_s[rows]
                already += max(float(t[-1] - t[0]) - motion.approach_s(here), 0.0)
            self.show(f"{already:.0f} s of {seconds:.0f} s were measured before")
        if seconds - already > 1.0:
            path = motion.path(self.link_position(), seconds - already)
            half_gap = row(c, lambda j: j.half_gap)
            watch = LimitCycleWatch(c.joint_names, c.control.position_gain, half_gap)
            self.move(step, "all joints move, hands off", path, watch.add, warning=discarded)
        return self.read(step)

    def before(self, step: str, *, residuals: bool = False) -> MotionLog | None:
        """Log of an interrupted step, or None. Raises LogError, before anything moves, if the step
        cannot continue it."""
        parts = self.session.parts(step)
        if not parts:
            return None
        refuse_incompatible(parts, self.configuration, residuals=residuals)
        files = ", ".join(str(part) for part in parts)
        self.show(f"continuing earlier measurements; to start afresh, delete {files}")
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
        """Run a path (N, n) [rad] with a progress bar, showing the texts that `remark` returns for
        States; how: keywords of `Session.run`. Raises as `Session.run` does."""
        period = self.configuration.period_s
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        progress = Progress(*columns, console=self.console)
        task = progress.add_task(text, total=len(path) * period)
        last = deque[State](maxlen=REMEMBERED)

        def each(state: State) -> bool:
            last.append(state)
            progress.start()  # only once the arm moves, as the motion may be refused
            progress.advance(task, state.interval_s)
            if text := remark(state):
                self.session.say(text)
            return False

        self._far = self._far or not how.get("motors_only")
        try:
            self.session.run(step, path, period, each, **how)
            progress.update(task, completed=len(path) * period)
        except InterruptedStepError as error:
            if helps := advice_on_following(str(error), tuple(last), self.configuration):
                raise InterruptedStepError(f"{error}{helps}") from error
            raise
        finally:
            progress.stop()

    def read(self, step: str, *, gap_of: str = "") -> Measured:
        """Measurements of a step. Raises LogError."""
        return read_measured(self.session.parts(step), self.configuration, gap_of=gap_of)

    def forget(self, step: str) -> None:
        """Delete the recordings of a step."""
        for part in self.session.parts(step):
            part.unlink()

    def show(self, text: str) -> None:
        """Show a text to the user."""
        self.console.print(text, markup=False, highlight=False)

    def close(self, *, well: bool, written: bool) -> None:
        """Close the connection. After a step that ended `well`, drives that it enabled are switched
        off, with the arm back in its pose, and the daemon loads what was written; otherwise the arm
        stays as it is. Raises ContactdError."""
        try:
            if self.session.here is None:
                if written and well and self._mode == Mode.OFF:
                    self.session.reload()
                    self.show("taken up")
                elif written:
                    self.show("taken up before the drives are next enabled")
            elif well:
                if self._mode != Mode.OFF:
                    if self._far:
                        self._go_back(self.session.here)
                    self.session.disable()
                if written:
                    self.session.reload()
                self.show(f"the drives are off{', and it is taken up' if written else ''}")
            elif self._mode == Mode.HOLDING:
                self.show("the drives stay on and the arm holds; `contactctl disable` ends this")
        except UnreachableError:
            if well:  # otherwise the step's own error reports it
                raise
        finally:
            self.session.close()

    @property
    def _mode(self) -> Mode:
        return self.session.client.ask_status().mode

    def _go_back(self, there: Vector) -> None:
        here, bounds = self.link_position(), bounds_of(self.configuration)
        there = np.clip(there, bounds.lower, bounds.upper)
        if float(np.abs(there - here).max()) > MOVED:
            way = point_to_point(here, there, slow(bounds), self.configuration.period_s)
            text = "all joints return to where they stood"
            how: dict[str, Any] = {"warning": lambda event: event.text, "touch_ends": True}
            self.move("return", text, way, to_go_on="", **how)
            self.forget("return")

    def recover(self, *, on: bool) -> bool:
        """Recover from a fault during a step that enabled the drives: enable them again if `on`,
        else only reset. False, with no action, if another client had enabled them."""
        if self.session.here is None:
            return False
        if on:
            self.session.recover()
        else:
            self.session.reset()
        return True

    def serials(self) -> dict[str, int | None]:
        """Serial numbers of the drives, by joint."""
        status = self.session.client.ask_status()
        return dict(zip(status.joints, status.serials, strict=False))

    def conclude(self, step: str, stamp: str) -> None:
        """Keep the recordings of `step` as evidence."""
        self.session.conclude(step, stamp)


def open_session(socket: Path | None, console: Console, ask: Callable[[bool], bool]) -> Session:
    """Session that prints warnings in yellow. Raises UnreachableError."""

    def say(text: str) -> None:
        console.print(text, style="yellow", markup=False, highlight=False)

    return Session(socket, Path(), say, ask)
