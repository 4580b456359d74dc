"""Ideal arm: a controller, and two joints that do exactly what it commands, with made-up
torques."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from common.arrays import Vector
from daemon.modes.contact_reactions import AfterQuiet, Reactions
from daemon.modes.table import ENERGISED, Event, Mode
from daemon.motion.admittance import AdmittanceLaw, AllowanceSettings, Gains
from daemon.motion.limits import Limits
from daemon.motion.motion import Motion, MotionSettings
from daemon.motion.path import Follower, PathPoint, Sinusoids
from daemon.motion.release import ReleaseSettings
from daemon.tick.controller import Controller
from daemon.tick.decision import ControlInput, ControllerSettings, Decision
from drivers.api import DriveCondition, DriveStatus

T = 0.01
ON = DriveStatus(DriveCondition.OPERATING, "on", "on", supplied=True, following=True)
OFF = DriveStatus(DriveCondition.OFF, "off", "off, as it reports", True, following=False)
AMPLITUDE, FREQUENCY = 0.3, 0.2  # of joint a; b holds
TUNING = ControllerSettings(
    joints=("a", "b"),
    ends=("hold", "brake"),
    reactions=Reactions(),
    quiet_s=2.0,
    after_quiet=AfterQuiet.RESUME,
    bounds=AllowanceSettings(max_duration_s=5.0, max_excursion=0.4),
    enable_timeout_s=3.0,
    stop_timeout_s=3.0,
)
MANNER = MotionSettings(
    position_gain=8.0,
    return_velocity=0.2,
    retract_velocity=0.4,
    retract_distance=0.1,
    release=ReleaseSettings(velocity=0.25, distance=0.3, ahead=np.full(2, 0.15)),
)
LIMITS = Limits(np.full(2, -1.0), np.full(2, 1.0), np.full(2, 1.0), np.full(2, 4.0), T)


@dataclass(slots=True)
class IdealArm:
    """Controller and joints; `step` is one tick, keywords replace fields of its ControlInput."""

    controller: Controller
    q: Vector = field(default_factory=lambda: np.array([0.1, -0.2]))
    tick: int = 0
    decisions: list[Decision] = field(default_factory=list)

    @property
    def time_s(self) -> float:
        """Time of the next tick [s]."""
        return self.tick * T

    @property
    def mode(self) -> Mode:
        """Mode of the controller."""
        return self.controller.machine.mode

    @property
    def armed(self) -> bool:
        """True while contacts may move the arm."""
        return self.controller.machine.armed

    @property
    def cause(self) -> str:
        """Cause of this mode."""
        return self.controller.machine.cause

    def step(self, **seen: Any) -> Decision:
        """One tick."""
        before = self.decisions[-1].velocity if self.decisions else np.zeros(2)
        # Its drives come on with the mode, and go off with it.
        drives = (ON if self.mode in ENERGISED else OFF,) * 2
        calm = ControlInput(self.q.copy(), before, np.zeros(2), np.zeros(2), "", "", drives, ())
        decision = self.controller.step(self.time_s, T, replace(calm, **seen))
        self.q = self.q + decision.velocity * T
        self.tick += 1
        self.decisions.append(decision)
        return decision

    def run(self, seconds: float, **seen: Any) -> None:
        """Do ticks that are all alike."""
        for _ in range(round(seconds / T)):
            self.step(**seen)

    def run_until(self, mode: Mode, seconds: float = 20.0, **seen: Any) -> float:
        """Tick until `mode`; returns how long [s] that took. Raises AssertionError if it takes more
        than `seconds`."""
        begun = self.tick
        while self.mode is not mode:
            assert (self.tick - begun) * T <= seconds, (self.mode, self.cause)
            self.step(**seen)
        return (self.tick - begun) * T

    def request(self, event: Event) -> list[str]:
        """Request an event as a person would; returns the reasons of a refusal."""
        return self.controller.request(event, "me", self.time_s)

    def push(self, torque: float) -> dict[str, Any]:
        """Fields of ControlInput while a contact on joint a lasts: the residual beyond
        its threshold [Nm], which is none."""
        felt = np.array([torque, 0.0])
        return {"residual": felt, "thresholded": felt, "touched": "a feels it"}

    def press(self, torque: float) -> dict[str, Any]:
        """Fields of ControlInput while a collision on joint a lasts."""
        return {**self.push(torque), "hit": "a was hit"}

    def touch(self, torque: float = 0.4) -> None:
        """One tick of contact."""
        self.step(**self.push(torque))

    def hit(self, torque: float = 0.4) -> None:
        """One tick in which a collision begins."""
        self.step(**self.press(torque), struck=True)


def ideal_arm(**changes: Any) -> IdealArm:
    """An arm whose drives are off. `changes` replace fields of TUNING, or parts of the motion."""
    parts: dict[str, Any] = {
        "manner": MANNER,
        "limits": LIMITS,
        "law": AdmittanceLaw(np.full(2, 0.05), np.full(2, 0.5)),
        "gains": Gains(np.array([0.5, 0.5])),
    }
    walls = changes.pop("walls", None)
    parts = {name: changes.pop(name, part) for name, part in parts.items()}
    path = Sinusoids(np.array([AMPLITUDE, 0.0]), np.array([2 * np.pi * FREQUENCY, 0.0]))
    motion = Motion(**parts, follower=Follower(PathPoint(path), 1.0), walls=walls)
    return IdealArm(Controller(replace(TUNING, **changes), motion))


def holding_arm(**changes: Any) -> IdealArm:
    """An arm that is energised and holds."""
    arm = ideal_arm(**changes)
    arm.step()
    assert arm.request(Event.ENABLE) == []
    arm.step()
    assert arm.mode is Mode.HOLDING
    return arm


def tracking_arm(**changes: Any) -> IdealArm:
    """An arm on its trajectory for 1.5 s, armed."""
    arm = holding_arm(**changes)
    assert arm.request(Event.START) == []
    arm.run(1.5)
    assert arm.mode is Mode.TRACKING
    assert arm.controller.arm("me") == []
    return arm
