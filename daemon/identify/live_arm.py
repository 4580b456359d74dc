"""Measurements from a live arm: its motions and the person's part in each step."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from arrays import Matrix, Vector
from daemon.config.dynamics import model_of
from daemon.config.identified import residuals_alike, samples_alike
from daemon.config.load import Robot
from daemon.config.motion import row
from daemon.faults.table import Condition
from daemon.identify.live_strokes import StrokesOfJoint, UnobservableError, searched
from daemon.identify.measured import Measured, read_measured, refuse_incompatible
from daemon.identify.motions import (
    HAND_S,
    REPEATS_S,
    SLOWEST_S,
    TURNS_S,
    WIDEST_GUESS,
    WIRING_TRAVEL,
    bounds_of,
    excitation,
    slow,
    stand,
    wiring_motion,
)
from daemon.identify.session import (
    ApartError,
    InterruptedStepError,
    Session,
    discarded,
    load_felt,
    other_joint_touched,
    wiring_spoiled,
)
from daemon.identify.show import histogram
from daemon.identify.soft_loop import REMEMBERED, why_not_followed
from daemon.identify.swinging import SwingWatch
from daemon.identify.zero import resting_samples, stands
from daemon.modes.table import Mode
from daemon.protocol.messages import State
from errors import ConfigurationError, ContactdError, ControlError, ShortLogError
from estimator.identification.excitation import point_to_point
from estimator.identification.gap import identify_gap
from estimator.identification.gap_result import CROSSINGS, GapResult
from estimator.identification.gap_search import Strokes
from estimator.identification.motion_log import PAUSE_S, MotionLog
from estimator.identification.wiring import OTHER_WAY, follows_both_ways, goes_against

MOVED = 0.05
"""From where it stood, before an arm that is to be switched off goes back there [rad]."""
REFRESH_S = 0.2
JUDGE_S = 2.0
LEAST_ROWS = 200
ENOUGH = CROSSINGS + 5
"""Crossings after which a clear gap ends the step."""
TO_READ_ANEW = "`contactctl disable` (after a fault `contactctl reset`)"
_TOO_FAR = "its gap is larger than half_gap says, or a scale is wrong"
_HEAVY = 1.0  # [Nm]: a hand lifts less than this softly


class LiveArm:
    """Arm behind a running daemon, as a source of measurements.

    Raises ConfigurationError if the daemon runs with another configuration than `robot`.
    """

    def __init__(self, robot: Robot, session: Session, console: Console) -> None:
        self._session, self._console = session, console
        self._c, self._names = robot.configuration, robot.configuration.joint_names
        self._model = model_of(self._c, robot.urdf)
        self._half_gap = row(self._c, lambda j: j.half_gap)
        self._far = False  # it was moved by its links, and not by its motors a little
        if not samples_alike(session.configuration(), self._c):
            raise ConfigurationError(
                f"drives, wiring or period in {robot.path} were changed since the daemon read it: "
                f"{TO_READ_ANEW}, then this again"
            )

    def serials(self) -> dict[str, int | None]:
        """Serial numbers of the drives, by joint."""
        status = self._session.client.ask_status()
        return dict(zip(status.joints, status.serials, strict=False))

    def close(self, *, well: bool, written: bool) -> None:
        """Close the connection. Drives that were enabled for the step are off then, with the arm
        where it stood, and what was written is taken up; of a step that did not end `well` the arm
        stays as it is. Raises ContactdError."""
        try:
            if self._session.here is None:
                if written and well and self._mode == Mode.OFF:
                    self._session.reload()
                    self._tell("taken up")
                elif written:
                    self._tell("taken up before the drives are enabled the next time")
            elif well:
                if self._mode != Mode.OFF:
                    if self._far:
                        self._go_back(self._session.here)
                    self._session.disable()
                if written:
                    self._session.reload()
                self._tell(f"the drives are off{', and it is taken up' if written else ''}")
            elif self._mode == Mode.HOLDING:
                self._tell("the drives stay on, and the arm holds; `contactctl disable` ends that")
        finally:
            self._session.close()

    @property
    def _mode(self) -> Mode:
        return self._session.client.ask_status().mode

    def _go_back(self, there: Vector) -> None:
        here, bounds = np.array(self._session.hold().link_position), bounds_of(self._c)
        there = np.clip(there, bounds.lower, bounds.upper)
        if float(np.abs(there - here).max()) > MOVED:
            way = point_to_point(here, there, slow(bounds), self._c.period_s)
            text = "all joints go back to where they stood"
            self._move("way-back", text, way, warning=discarded, touch_ends=True, to_go_on="")
            self._forget("way-back")

    def recover(self, *, on: bool) -> bool:
        """After a fault of a step that the drives were enabled for: enable them again, or have them
        off; False where somebody else enabled them, who decides."""
        if self._session.here is None:
            return False
        if on:
            self._session.recover()
        else:
            self._session.reset()
        return True

    def conclude(self, step: str, stamp: str) -> None:
        """Keep the recordings of `step` as evidence."""
        self._session.conclude(step, stamp)

    def wiring(self, joint: str) -> Measured:
        """Move one joint's motor to and fro, through its gap."""
        step = f"wiring-{joint}"
        i, period = self._names.index(joint), self._c.period_s
        half_gap = self._c.joints[i].half_gap
        while True:
            again = f"What passed is kept: to go on, name {joint} and those that are left"
            text = f"{joint} moves a little"
            warning = wiring_spoiled(joint)
            try:
                here = np.array(self._session.hold().link_position)
                self._forget(step)  # so short a motion begins anew
                path = wiring_motion(here, i, half_gap, period)
                self._move(step, text, path, warning=warning, motors_only=True, to_go_on=again)
            except (ControlError, InterruptedStepError) as error:
                if why := self._why_apart(error):
                    words = "".join(f". {name}: {words}" for name, words in why.items())
                    raise ApartError(f"{error}{words}", why) from error
                raise
            measured = self._read(step)
            if follows_both_ways(measured.log, i) or half_gap >= WIDEST_GUESS:
                return measured
            # Its gap is larger than the configuration says.
            half_gap = min(half_gap + 0.5 * WIRING_TRAVEL, WIDEST_GUESS)
            self._tell(
                f"{joint} did not move its link both ways: once more, "
                f"{1e3 * WIRING_TRAVEL:.0f} mrad further"
            )

    def _why_apart(self, error: ContactdError) -> dict[str, str]:
        """What most likely is wrong with joints whose link and motor are too far apart, as the
        recorded motion shows or, where they came apart at rest, for the person to look; else
        empty."""
        if Condition.APART not in str(error):
            return {}
        return {joint: self._apart(joint) for joint in self._names if joint in str(error)}

    def _apart(self, joint: str) -> str:
        with suppress(ContactdError):
            log = self._read(f"wiring-{joint}").log
            return OTHER_WAY if goes_against(log, self._names.index(joint)) else _TOO_FAR
        return f"{OTHER_WAY}; else {_TOO_FAR}"

    def pushed(self, joint: str, ask: Callable[[], bool]) -> tuple[Vector, bool]:
        """Positions (N,) [rad] of a link from its rest on, until `ask`, which has a person push it,
        returns whether it went upward."""
        i, rest = self._names.index(joint), resting_samples(self._c.period_s)

        def positions(states: Sequence[State]) -> Vector:
            return np.array([s.link_position[i] for s in states if all(s.fresh)])

        def settled(states: Sequence[State]) -> bool:
            return stands(positions(states[-rest:]), rest)

        with self._session.watched(settled) as states:
            begun = len(states) - rest
            upward = ask()
        return positions(states[begun:]), upward

    def friction(self, seconds: float) -> Measured:
        """Move all joints along an excitation."""
        return self._excite("friction", seconds, seed=1)

    def masses(self, seconds: float) -> Measured:
        """Move all joints along a third excitation."""
        return self._excite("masses", seconds, seed=3)

    def payload(self, name: str, seconds: float) -> Measured:
        """Move all joints along a short one, with the load in the hand."""
        step = "payload"
        self._forget(step)  # of another load, perhaps
        motion = excitation(bounds_of(self._c), self._model, self._c.period_s, 4, seconds, seconds)
        path = motion.path(np.array(self._session.hold().link_position), seconds)
        text = f"all joints move with {name}, hands off"
        self._move(step, text, path, warning=load_felt, to_go_on="The same command begins anew")
        return self._read(step)

    def encoders(self, seconds: float) -> Measured:
        """Move all joints slowly through most of their range."""
        return self._excite("encoders", seconds, seed=1, turns_s=(TURNS_S, TURNS_S))

    def thresholds(self, seconds: float) -> Measured:
        """Move all joints along another excitation, and take the residuals, too."""
        if not residuals_alike(self._session.configuration(), self._c):
            raise ConfigurationError(
                "values of the joints were written since the daemon read its files, and its "
                f"residuals use older ones: {TO_READ_ANEW}, then this again"
            )
        return self._excite("thresholds", seconds, seed=2, residuals=True)

    def gap(self, joint: str, *, by_hand: bool) -> Measured:
        """Turn the motor of one joint to and fro, or hold it while a person moves its link. Raises
        UnobservableError where that needs a hand."""
        return self._hand(joint) if by_hand else self._strokes(joint)

    def _strokes(self, joint: str) -> Measured:
        step, i = f"strokes-{joint}", self._names.index(joint)
        here = np.array(self._session.hold().link_position)
        own = StrokesOfJoint.of(self._c, self._model, i, here)
        self._tell(own.announcement())
        how: dict[str, Any] = {
            "warning": wiring_spoiled(joint),
            "touch_ends": True,
            "to_go_on": "The same command begins anew",
        }

        def record(asked: Strokes) -> MotionLog:
            here = np.array(self._session.hold().link_position)
            if (way := own.way_to(here, asked)) is not None:
                self._move(f"way-{joint}", f"{joint} goes to {asked.about:.2f} rad", way, **how)
                self._forget(f"way-{joint}")
            self._forget(step)
            here = np.array(self._session.hold().link_position)
            text = f"{joint} moves by {1e3 * asked.way:.0f} mrad"
            self._move(step, text, own.path(here, asked), motors_only=True, **how)
            return self._read(step, gap_of=joint).log

        searched(own.begin(), record)
        return self._read(step, gap_of=joint)

    def _forget(self, step: str) -> None:
        for part in self._session.parts(step):
            part.unlink()

    def _hand(self, joint: str) -> Measured:
        step, i = f"gap-{joint}", self._names.index(joint)
        before = self._before(step)
        self._hang(joint, i)
        here = np.array(self._session.hold().link_position)
        self._tell(
            f"The motor of {joint} stands still. Move its link softly by hand from side to side: "
            "lean on one border, rest a moment, lean on the other, both alike."
        )
        load = float(self._model.gravity(here)[i])
        if abs(load) > _HEAVY:
            self._tell(
                f"In this pose {abs(load):.1f} Nm of gravity hold it at one border: carry it, or "
                "begin from a pose in which the joint hangs."
            )
        hand = Hand(i, self._c.joints[i].torque_constant, joint, before)
        with Live(console=self._console, auto_refresh=False) as live:

            def each(state: State) -> bool:
                if hand.saw(state):
                    live.update(histogram(hand.phi, hand.gap), refresh=True)
                return hand.done

            path, warning = stand(here), other_joint_touched(joint)
            self._session.run(step, path, HAND_S, each, warning=warning, motors_only=True)
        if not self._console.is_terminal:
            self._console.line()  # which `Live` owes a file
        return self._read(step, gap_of=joint)

    def _hang(self, joint: str, i: int) -> None:
        """Go to where a hand has no weight to carry, if there is such a pose: not where a person
        enabled the arm, who has chosen this one."""
        here = np.array(self._session.hold().link_position)
        if self._session.here is None:
            return
        with suppress(UnobservableError):
            own = StrokesOfJoint.of(self._c, self._model, i, here)
            if own.weighs:
                text = f"{joint} goes to where it hangs"
                how: dict[str, Any] = {"warning": wiring_spoiled(joint), "touch_ends": True}
                self._move(f"way-{joint}", text, own.way_to_pose(), to_go_on="", **how)
                self._forget(f"way-{joint}")

    def _excite(
        self,
        step: str,
        seconds: float,
        seed: int,
        *,
        residuals: bool = False,
        turns_s: tuple[float, float] = (REPEATS_S, SLOWEST_S),
    ) -> Measured:
        bounds, period_s = bounds_of(self._c), self._c.period_s
        motion = excitation(bounds, self._model, period_s, seed, *turns_s)
        already = 0.0
        if (before := self._before(step, residuals=residuals)) is not None:
            # Each began with the way to the excitation, which teaches little and does not count.
            for rows in before.stretches(PAUSE_S):
                here, t = before.link_position[rows.start], before.time_s[rows]
                already += max(float(t[-1] - t[0]) - motion.approach_s(here), 0.0)
            self._tell(f"{already:.0f} s of {seconds:.0f} s are measured already")
        if seconds - already > 1.0:
            path = motion.path(np.array(self._session.hold().link_position), seconds - already)
            watch = SwingWatch(self._names, self._c.control.position_gain, self._half_gap)
            self._move(step, "all joints move, hands off", path, watch.saw, warning=discarded)
        return self._read(step)

    def _before(self, step: str, *, residuals: bool = False) -> MotionLog | None:
        """Log of a step that was stopped, or None. Raises LogError, before anything moves, if the
        step cannot go on with it."""
        parts = self._session.parts(step)
        if not parts:
            return None
        refuse_incompatible(parts, self._c, residuals=residuals)
        files = ", ".join(str(part) for part in parts)
        self._tell(f"going on with what was measured before; to begin anew, delete {files}")
        try:
            return self._read(step).log
        except ShortLogError:
            return None

    def _move(
        self,
        step: str,
        text: str,
        path: Matrix,
        remark: Callable[[State], str] = lambda _: "",
        **how: Any,
    ) -> None:
        """Run a path with a bar for its progress; what `remark` says of a State is shown."""
        period = self._c.period_s
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        progress = Progress(*columns, console=self._console)
        task = progress.add_task(text, total=len(path) * period)
        last = deque[State](maxlen=REMEMBERED)

        def each(state: State) -> bool:
            last.append(state)
            progress.start()  # not before the arm moves, which may be refused
            progress.advance(task, state.interval_s)
            if said := remark(state):
                self._session.say(said)
            return False

        self._far = self._far or not how.get("motors_only")
        try:
            self._session.run(step, path, period, each, **how)
            progress.update(task, completed=len(path) * period)
        except InterruptedStepError as error:
            if helps := why_not_followed(str(error), tuple(last), self._c):
                raise InterruptedStepError(f"{error}{helps}") from error
            raise
        finally:
            progress.stop()

    def _read(self, step: str, *, gap_of: str = "") -> Measured:
        return read_measured(self._session.parts(step), self._c, gap_of=gap_of)

    def _tell(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False)


class Hand:
    """phi of one joint as a hand moves it, identified until the gap is clear."""

    def __init__(
        self, joint: int, torque_constant: float, name: str, before: MotionLog | None = None
    ) -> None:
        self._joint, self._constant, self._name, self._before = joint, torque_constant, name, before
        self._rows: list[tuple[float, ...]] = []
        self._shown_s = self._judged_s = -1.0
        self.phi: list[float] = []
        self.gap: GapResult | None = None
        self.done = False

    def saw(self, state: State) -> bool:
        """Take one State; True if it is time to draw."""
        if not all(state.fresh):
            return False
        i, measured = self._joint, state.motor_position
        if not self._rows and self._before is not None:
            self._rows = rows_until(self._before, i, state.time_s - 2.0 * PAUSE_S)
        row = (state.time_s, state.current[i], state.link_position[i], state.motor_velocity[i])
        self._rows.append(row if measured is None else (*row, measured[i]))
        motor = state.motor_estimate if measured is None else measured
        self.phi.append(state.link_position[i] - motor[i])
        now = state.time_s
        if now - self._judged_s > JUDGE_S and len(self._rows) > LEAST_ROWS:
            self._judged_s = now
            time_s, *columns = np.array(self._rows).T
            log = MotionLog((self._name,), time_s, *(column[:, None] for column in columns))
            self.gap = identify_gap(log, 0, self._constant)
            self.done = self.gap.usable and self.gap.crossings >= ENOUGH
        if now - self._shown_s < REFRESH_S and not self.done:
            return False
        self._shown_s = now
        return True


def rows_until(log: MotionLog, joint: int, time_s: float) -> list[tuple[float, ...]]:
    """Rows of one joint, as if the log had ended at `time_s`: time, current, link position, motor
    velocity and perhaps motor position."""
    columns = [log.current, log.link_position, log.motor_velocity]
    if log.motor_position is not None:
        columns.append(log.motor_position)
    times = log.time_s - log.time_s[-1] + time_s
    rows = np.column_stack([times, *(column[:, joint] for column in columns)])
    return [tuple(row) for row in rows.tolist()]


def open_session(socket: Path | None, console: Console, may_enable: Callable[[], bool]) -> Session:
    """Session that prints its warnings in yellow. Raises UnreachableError."""

    def say(text: str) -> None:
        console.print(text, style="yellow", markup=False, highlight=False)

    return Session(socket, Path(), say, may_enable)
