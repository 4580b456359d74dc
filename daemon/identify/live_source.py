"""Measurements from a live arm: what a person does and sees at each step."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from daemon.config.load import Robot
from daemon.identify.live import Session
from daemon.identify.logs import Measured, from_states, read_measured
from daemon.identify.motions import HAND_S, bounds_of, excitation, stand, wiring_motion
from daemon.identify.show import histogram
from daemon.messages import State
from errors import LogError
from estimator.identification.gap import CROSSINGS, Gap, identify_gap
from estimator.model import Model
from estimator.types import Matrix

REFRESH_S = 0.2
JUDGE_S = 2.0
ENOUGH = CROSSINGS + 5
"""Crossings after which a clear gap ends the step."""
_HEAVY = 1.0  # [Nm]: a hand lifts less than this softly


class LiveArm:
    """The arm behind a running daemon."""

    def __init__(self, robot: Robot, session: Session, console: Console) -> None:
        self._session, self._console = session, console
        self._c, self._names = robot.configuration, robot.configuration.joint_names
        self._model = Model(robot.urdf, self._names)

    def serials(self) -> dict[str, int | None]:
        """Of the drives, by joint."""
        status = self._session.status()
        return dict(zip(status.joints, status.serials, strict=False))

    def conclude(self, step: str, stamp: str) -> None:
        """Keep the recordings of `step` as evidence."""
        self._session.conclude(step, stamp)

    def wiring(self, joint: str) -> Measured:
        """Move one joint's motor to and fro, through its gap."""
        step = f"wiring-{joint}"
        for part in self._session.parts(step):
            part.unlink()  # so short a motion is begun anew
        i = self._names.index(joint)
        here = np.array(self._session.hold().position)
        path = wiring_motion(here, i, self._c.joints[i].half_gap, self._c.period_s)
        self._move(step, f"{joint} moves a little", path, motors_only=True)
        return self._read(step)

    def friction(self, seconds: float) -> Measured:
        """Move all joints along an excitation."""
        return self._excite("friction", seconds, seed=1)

    def thresholds(self, seconds: float) -> Measured:
        """Likewise, along another."""
        return self._excite("thresholds", seconds, seed=2)

    def gap(self, joint: str) -> Measured:
        """Hold the motors while a person moves one link."""
        step, i = f"gap-{joint}", self._names.index(joint)
        here = np.array(self._session.hold().position)
        self._tell(
            f"The motor of {joint} stands still. Move its link softly by hand from side to side: "
            "touch one border, rest a moment, touch the other."
        )
        load = float(self._model.gravity(here)[i])
        if abs(load) > _HEAVY:
            self._tell(
                f"In this pose {abs(load):.1f} Nm of gravity hold it at one border: carry it, or "
                "begin from a pose in which the joint hangs."
            )
        hand = Hand(i, self._c.joints[i].torque_constant, self._names)
        with Live(console=self._console, auto_refresh=False) as live:

            def each(state: State) -> bool:
                if hand.saw(state):
                    live.update(histogram(hand.phi, hand.gap), refresh=True)
                return hand.done

            path = stand(here, HAND_S, self._c.period_s)
            self._session.run(step, path, self._c.period_s, each, motors_only=True)
        return self._read(step)

    def _excite(self, step: str, seconds: float, seed: int) -> Measured:
        try:
            already = self._read(step).log.measured_s if self._session.parts(step) else 0.0
        except LogError:
            already = 0.0
        if already > 0.0:
            self._tell(f"going on: {already:.0f} s of {seconds:.0f} s are measured already")
        if seconds - already > 1.0:
            here = np.array(self._session.hold().position)
            path = excitation(
                bounds_of(self._c), self._model, here, seconds - already, self._c.period_s, seed
            )
            self._move(step, "all joints move, hands off", path, motors_only=False)
        return self._read(step)

    def _move(self, step: str, text: str, path: Matrix, *, motors_only: bool) -> None:
        period = self._c.period_s
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        with Progress(*columns, console=self._console) as progress:
            task = progress.add_task(text, total=len(path) * period)

            def each(state: State) -> bool:
                progress.advance(task, state.interval_s)
                return False

            self._session.run(step, path, period, each, motors_only=motors_only)
            progress.update(task, completed=len(path) * period)

    def _read(self, step: str) -> Measured:
        return read_measured(self._session.parts(step), self._names)

    def _tell(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False)


class Hand:
    """phi of one joint as a hand moves it, and whether that is enough."""

    def __init__(self, joint: int, torque_constant: float, names: list[str]) -> None:
        self._joint, self._constant, self._names = joint, torque_constant, names
        self._states: list[State] = []
        self._shown_s = self._judged_s = -1.0
        self.phi: list[float] = []
        self.gap: Gap | None = None
        self.done = False

    def saw(self, state: State) -> bool:
        """Take one State; whether it is time to draw."""
        if not state.updated:
            return False
        self._states.append(state)
        motor = state.motor if state.motor_position is None else state.motor_position
        self.phi.append(state.link_position[self._joint] - motor[self._joint])
        now = state.time_s
        if now - self._judged_s > JUDGE_S and len(self._states) > 200:
            self._judged_s = now
            log = from_states(self._states, self._names).log
            self.gap = identify_gap(log, self._joint, self._constant)
            self.done = self.gap.usable and self.gap.crossings >= ENOUGH
        if now - self._shown_s < REFRESH_S and not self.done:
            return False
        self._shown_s = now
        return True


def open_session(socket: Path | None, console: Console) -> Session:
    """A session that tells the person in yellow. Raises UnreachableError."""

    def say(text: str) -> None:
        console.print(text, style="yellow", markup=False, highlight=False)

    return Session(socket, Path(), say)
