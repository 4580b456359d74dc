"""Measurements from a live arm: its motions and the person's part in each step."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.console import Console

from arrays import Vector
from daemon.config.dynamics import model_of
from daemon.config.identified import residuals_alike, samples_alike
from daemon.config.load import Robot
from daemon.faults.table import Condition
from daemon.identify.live_gap import gap_by_hand, gap_by_strokes
from daemon.identify.live_motions import LiveMotions
from daemon.identify.measured import Measured
from daemon.identify.motions import (
    TURNS_S,
    WIDEST_GUESS,
    WIRING_TRAVEL,
    bounds_of,
    excitation,
    slow,
    wiring_motion,
)
from daemon.identify.session import (
    ApartError,
    InterruptedStepError,
    Session,
    discarded,
    load_felt,
    wiring_spoiled,
)
from daemon.identify.zero import resting_samples, stands
from daemon.modes.table import Mode
from daemon.protocol.messages import State
from errors import ConfigurationError, ContactdError, ControlError
from estimator.identification.excitation import point_to_point
from estimator.identification.wiring import (
    OTHER_WAY,
    follows_both_ways,
    goes_against,
    scale_unsure,
)

MOVED = 0.05
"""From where it stood, before an arm that is to be switched off goes back there [rad]."""
TO_READ_ANEW = "`contactctl disable` (after a fault `contactctl reset`)"
_TOO_FAR = "its gap is larger than half_gap says, or a scale is wrong"


class LiveArm:
    """Arm behind a running daemon, as a source of measurements.

    Raises ConfigurationError if the daemon runs with another configuration than `robot`.
    """

    def __init__(self, robot: Robot, session: Session, console: Console) -> None:
        self._session = session
        self._c, self._names = robot.configuration, robot.configuration.joint_names
        self._model = model_of(self._c, robot.urdf)
        self._motions = LiveMotions(session, console, self._c, self._model)
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
                    self._motions.tell("taken up")
                elif written:
                    self._motions.tell("taken up before the drives are enabled the next time")
            elif well:
                if self._mode != Mode.OFF:
                    if self._motions.far:
                        self._go_back(self._session.here)
                    self._session.disable()
                if written:
                    self._session.reload()
                self._motions.tell(f"the drives are off{', and it is taken up' if written else ''}")
            elif self._mode == Mode.HOLDING:
                self._motions.tell(
                    "the drives stay on, and the arm holds; `contactctl disable` ends that"
                )
        finally:
            self._session.close()

    @property
    def _mode(self) -> Mode:
        return self._session.client.ask_status().mode

    def _go_back(self, there: Vector) -> None:
        here, bounds = self._motions.link_position(), bounds_of(self._c)
        there = np.clip(there, bounds.lower, bounds.upper)
        if float(np.abs(there - here).max()) > MOVED:
            way = point_to_point(here, there, slow(bounds), self._c.period_s)
            text = "all joints go back to where they stood"
            self._motions.move(
                "way-back", text, way, warning=discarded, touch_ends=True, to_go_on=""
            )
            self._motions.forget("way-back")

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

    def wiring(self, joint: str, to_go_on: str) -> Measured:
        """Move one joint's motor to and fro, through its gap; `to_go_on` is said if that is
        stopped."""
        step = f"wiring-{joint}"
        i, period = self._names.index(joint), self._c.period_s
        half_gap = self._c.joints[i].half_gap
        repeated = False
        while True:
            text = f"{joint} moves a little"
            warning = wiring_spoiled(joint)
            try:
                here = self._motions.link_position()
                self._motions.forget(step)  # so short a motion begins anew
                carried = repeated or self._may_float(i, here)
                path = wiring_motion(here, i, half_gap, period, speeding_up=carried)
                self._motions.move(
                    step, text, path, warning=warning, motors_only=True, to_go_on=to_go_on
                )
            except (ControlError, InterruptedStepError) as error:
                if why := self._why_apart(error):
                    words = "".join(f". {name}: {words}" for name, words in why.items())
                    raise ApartError(f"{error}{words}", why) from error
                raise
            measured = self._motions.read(step)
            both = follows_both_ways(measured.log, i)
            if both and not repeated and scale_unsure(measured.log, i):
                repeated, more = True, "once more, speeding up all the way"
                seen = "moved its link by another share than its motor"
            elif both or half_gap >= WIDEST_GUESS:
                return measured
            else:  # Its gap is larger than the configuration says.
                half_gap = min(half_gap + 0.5 * WIRING_TRAVEL, WIDEST_GUESS)
                seen = "did not move its link both ways"
                more = f"once more, {1e3 * WIRING_TRAVEL:.0f} mrad further"
            self._motions.tell(f"{joint} {seen}: {more}")

    def _may_float(self, i: int, here: Vector) -> bool:
        """True where joint i weighs so little that its link may run ahead of its motor."""
        rub = self._c.joints[i].friction
        weight = abs(float(self._model.gravity(here)[i]))
        return weight < rub.motor_coulomb + rub.link_coulomb

    def _why_apart(self, error: ContactdError) -> dict[str, str]:
        """What most likely is wrong with joints whose link and motor are too far apart, as the
        recorded motion shows or, where they came apart at rest, for the person to look; else
        empty."""
        if Condition.APART not in str(error):
            return {}
        return {joint: self._apart(joint) for joint in self._names if joint in str(error)}

    def _apart(self, joint: str) -> str:
        with suppress(ContactdError):
            log = self._motions.read(f"wiring-{joint}").log
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
        return self._motions.excite("friction", seconds, seed=1)

    def masses(self, seconds: float) -> Measured:
        """Move all joints along a third excitation."""
        return self._motions.excite("masses", seconds, seed=3)

    def payload(self, name: str, seconds: float) -> Measured:
        """Move all joints along a short one, with the load in the hand."""
        step = "payload"
        self._motions.forget(step)  # of another load, perhaps
        motion = excitation(bounds_of(self._c), self._model, self._c.period_s, 4, seconds, seconds)
        path = motion.path(self._motions.link_position(), seconds)
        text = f"all joints move with {name}, hands off"
        self._motions.move(
            step, text, path, warning=load_felt, to_go_on="The same command begins anew"
        )
        return self._motions.read(step)

    def encoders(self, seconds: float) -> Measured:
        """Move all joints slowly through most of their range."""
        return self._motions.excite("encoders", seconds, seed=1, turns_s=(TURNS_S, TURNS_S))

    def thresholds(self, seconds: float) -> Measured:
        """Move all joints along another excitation, and take the residuals, too."""
        if not residuals_alike(self._session.configuration(), self._c):
            raise ConfigurationError(
                "values of the joints were written since the daemon read its files, and its "
                f"residuals use older ones: {TO_READ_ANEW}, then this again"
            )
        return self._motions.excite("thresholds", seconds, seed=2, residuals=True)

    def gap(self, joint: str, *, by_hand: bool) -> Measured:
        """Turn the motor of one joint to and fro, or hold it while a person moves its link. Raises
        UnobservableError where that needs a hand."""
        return (gap_by_hand if by_hand else gap_by_strokes)(self._motions, joint)


def open_session(socket: Path | None, console: Console, may_enable: Callable[[], bool]) -> Session:
    """Session that prints its warnings in yellow. Raises UnreachableError."""

    def say(text: str) -> None:
        console.print(text, style="yellow", markup=False, highlight=False)

    return Session(socket, Path(), say, may_enable)
