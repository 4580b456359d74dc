"""Clamp of a joint: what a link presses against, and what a person behind it holds against it.

Stands in the place of the simulated arm's hand: `rig.arm.hand = cast(Hand, Clamps(rig))`. Each
obstacle pushes one way only, as a thing does that nothing is stuck to.
"""

from dataclasses import dataclass
from typing import cast

import msgspec
import numpy as np

from bench.rigs.lockstep import DESK_ARM, ROMEO, Rig, lockstep_rig
from common.arrays import Vector
from daemon.config.schema import Configuration, Sinusoid, Trajectory
from daemon.modes.contact_reactions import ContactReaction
from daemon.modes.table import Event, Mode
from simulator.hand import Hand

ARMS = {"romeo": ROMEO, "desk arm": DESK_ARM}
AMPLITUDE = 0.4  # of the trajectory [rad]
AHEAD = 0.01  # how far before the link an obstacle is put [rad]
BEHIND = 0.003  # and the hand behind it, when it stands
STANDS = 0.02  # [rad/s]
FALLS_AFTER_S, WATCHED_S = 0.1, 2.5

# Damping ratio of an obstacle with the lightest link that may meet it: soft wood, a forearm.
DAMPING_RATIO = 0.2


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A spring in the way of one joint, on the side at which its position is above `place`
    (side 1) or below it (side -1)."""

    joint: int
    place: float  # [rad]
    side: int
    stiffness: float  # [Nm/rad]
    damping: float  # [Nm s/rad]

    def torque(self, q: float, q_dot: float) -> float:
        """Torque on the link [Nm]: away from the obstacle, or none."""
        depth = self.side * (q - self.place)
        if depth <= 0.0:
            return 0.0
        push = self.stiffness * depth + self.damping * self.side * q_dot
        return -self.side * max(push, 0.0)


class Clamps:
    """Everything that is in the way of one simulated arm."""

    began, touching, done, busy = True, True, False, True

    def __init__(self, rig: Rig) -> None:
        """Take the place of the arm's hand."""
        self._arm = rig.arm
        self.obstacles: list[Obstacle] = []
        self.trace: list[tuple[float, list[float]]] = []
        """Time [s] and torque of each obstacle [Nm], every millisecond since there is one."""
        rig.arm.hand = cast(Hand, self)  # all of it that is used

    def put(self, joint: int, distance: float, side: int, stiffness: float) -> Obstacle:
        """Put an obstacle `distance` [rad] before a link that moves to `side`; returns it."""
        parameters = self._arm.plant.parameters
        # Beyond what the plant's step resolves a damper would shake by itself.
        mass = float(parameters.lightest_link[joint])
        damping = min(
            2.0 * DAMPING_RATIO * (stiffness * mass) ** 0.5, 0.3 * mass / self._arm.settings.step_s
        )
        place = float(self._arm.plant.q[joint]) + side * distance
        obstacle = Obstacle(joint, place, side, stiffness, damping)
        self.obstacles.append(obstacle)
        return obstacle

    def felt(self, obstacle: Obstacle) -> float:
        """True torque of an obstacle now, away from it and so never negative [Nm]."""
        i, plant = obstacle.joint, self._arm.plant
        return -obstacle.side * obstacle.torque(float(plant.q[i]), float(plant.q_dot[i]))

    # --- as the arm's hand ----------------------------------------------------------------------

    def update(self, t: float, q: Vector, period_s: float = 0.001) -> list[str]:
        """Once per millisecond."""
        if self.obstacles:
            self.trace.append((t, [self.felt(each) for each in self.obstacles]))
        return []

    def torque(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        """Add the torque of all obstacles to out (n,) [Nm]."""
        for obstacle in self.obstacles:
            i = obstacle.joint
            out[i] += obstacle.torque(float(q[i]), float(q_dot[i]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One clamp and how the arm meets it."""

    arm: str
    joint: str
    stiffness: float
    speed: float
    armed: bool = False
    contact: ContactReaction = ContactReaction.ADMITTANCE  # while it is armed
    started: bool = False  # before it, instead of running into it
    hand: float = 0.0  # stiffness of the hand behind; 0 is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Squeeze:
    """Measures of a case; torques [Nm], times [s] after the arm first stood."""

    contact: float  # level
    peak: float
    stood: float  # torque when it first stood; nan where it did not
    rise: float  # the largest from 0.1 s on, beyond the contact level
    half_s: float
    free_s: float  # below the contact level for good
    last: float
    behind: float  # peak of the hand behind
    hand: float  # peak of it, less what the clamp hands on to it through the arm
    collided: bool  # a residual reached its collision level
    modes: tuple[str, ...]


def configured(
    c: Configuration, joint: str, speed: float, contact: ContactReaction
) -> Configuration:
    """The robot with a trajectory that swings one joint with this highest speed [rad/s]."""
    wave = Sinusoid(amplitude=AMPLITUDE, frequency_Hz=speed / AMPLITUDE / (2.0 * np.pi))
    trajectory = Trajectory(sinusoids={joint: wave}, ramp_s=0.5)
    reactions = msgspec.structs.replace(c.reactions, contact=contact)
    return msgspec.structs.replace(c, trajectory=trajectory, reactions=reactions)


def meet(rig: Rig, clamps: Clamps, case: Case) -> Obstacle:
    """Let the arm run, and put the clamp in its way; returns it."""
    i = rig.robot.configuration.joint_names.index(case.joint)
    rig.enable()
    rig.run(0.5)
    side = 1
    clamp = clamps.put(i, 0.002, side, case.stiffness) if case.started else None
    rig.request(Event.START)
    rig.run(0.1)
    if case.armed:
        assert not rig.permit()
    if clamp is None:
        while abs(rig.arm.plant.theta_dot[i]) < 0.93 * case.speed:
            rig.step()
        side = int(np.sign(rig.arm.plant.theta_dot[i]))
        clamp = clamps.put(i, AHEAD, side, case.stiffness)
    return clamp


def measure(case: Case) -> Squeeze:
    """Run one case."""
    with lockstep_rig(
        ARMS[case.arm], configure=lambda c: configured(c, case.joint, case.speed, case.contact)
    ) as rig:
        clamps = Clamps(rig)
        clamp = meet(rig, clamps, case)
        modes, stood_s, collided = [rig.mode], None, False
        while rig.time_s < 20.0 and (stood_s is None or clamps.trace[-1][0] < stood_s + WATCHED_S):
            if stood_s is not None and rig.mode is Mode.TRACKING:
                break  # it goes on by itself, after the quiet time
            rig.step()
            if rig.mode is not modes[-1]:
                modes.append(rig.mode)
            notices = [notice.contact for notice in rig.last.notices if notice.contact]
            collided = collided or any(one.level == "collision" for one in notices)
            into = clamp.side * float(rig.arm.plant.theta_dot[clamp.joint])
            if stood_s is None and len(modes) > 1 and into <= STANDS:
                stood_s = clamps.trace[-1][0]
                if case.hand:
                    clamps.put(clamp.joint, BEHIND, -clamp.side, case.hand)
        level = rig.robot.configuration.joints[clamp.joint].thresholds.contact
        return squeeze(clamps, stood_s, level, collided, tuple(modes))


def squeeze(
    clamps: Clamps, stood_s: float | None, contact: float, collided: bool, modes: tuple[str, ...]
) -> Squeeze:
    """Figures of the torques over time."""
    time_s = np.array([t for t, _ in clamps.trace]) - (np.inf if stood_s is None else stood_s)
    torque = np.array([felt[0] for _, felt in clamps.trace])
    pressed = [felt[1] - felt[0] for _, felt in clamps.trace if len(felt) > 1]
    after = torque[time_s >= 0.0]
    late = np.maximum(torque[time_s >= FALLS_AFTER_S], contact)
    stood = float(after[0]) if after.size else np.nan

    def last_above(level: float) -> float:
        above = time_s[(torque >= level) & (time_s >= 0.0)]
        return float(above[-1]) if above.size else 0.0

    return Squeeze(
        contact=contact,
        peak=float(torque.max()),
        stood=stood,
        rise=float((late - np.minimum.accumulate(late)).max()) if late.size else np.nan,
        half_s=last_above(0.5 * stood),
        free_s=last_above(contact),
        last=float(torque[-1]),
        behind=max((felt[1] for _, felt in clamps.trace if len(felt) > 1), default=0.0),
        hand=max(pressed, default=0.0),
        collided=collided,
        modes=modes,
    )
