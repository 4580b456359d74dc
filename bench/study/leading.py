"""A hand of 1500 N/m that leads joints of the simulated arm, and the torque and work of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import click
import numpy as np
import pinocchio as pin

from arrays import Vector
from bench.rigs.lockstep import Rig
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from simulator.arm import SimulatedArm
from simulator.hand import Hand
from simulator.hand_script import AnyAct, Guide, Release

STIFFNESS_N_M, DAMPING_NS_M = 1500.0, 20.0
# A grip holds a joint by more than the lever of one point [m].
SMALLEST_LEVER_M = 0.08
STRONGEST_NM = 25.0
STROKE_RAD = 0.4


@dataclass(frozen=True, slots=True)
class Led:
    """Cost for the hand of leading one joint, or one way of the whole arm at that joint."""

    joint: str
    peak_nm: float
    usual_nm: float
    """median over the second half of the way"""
    work_j: float
    moved_rad: float
    tremble: float
    """standard deviation of the link's speed over its mean, in the second half of the way"""
    coast_mrad: float = 0.0
    """how far the motors went on after the hand let go, the furthest joint"""
    commanded_mrad: float = 0.0
    """what of that the setpoints asked for; the rest is the drives' own, unloaded"""
    drift_mrad: float = 0.0
    """and the links, which also fall through their gaps then"""
    resumed_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Way:
    """Start [rad] of a way of the hand, and the joints that it leads to positions [rad]."""

    start: Vector
    to: Mapping[int, float]


class Meter:
    """A hand whose torque and velocity are recorded each millisecond."""

    def __init__(self, hand: Hand, arm: SimulatedArm) -> None:
        self._hand, self._plant = hand, arm.plant
        self._torque: list[Vector] = []
        self._velocity: list[Vector] = []
        hand.begin(arm.now)

    @property
    def began(self) -> bool:
        """`began` of the hand."""
        return self._hand.began

    @property
    def touching(self) -> bool:
        """`touching` of the hand."""
        return self._hand.touching

    @property
    def busy(self) -> bool:
        """`busy` of the hand."""
        return self._hand.busy

    @property
    def done(self) -> bool:
        """`done` of the hand."""
        return self._hand.done

    def begin(self, _: float) -> None:
        """Do nothing: the hand began when it came."""

    def torque(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        """Add the hand's torque [Nm] to out (n,)."""
        self._hand.torque(q, q_dot, out)

    def update(self, t: float, q: Vector, period_s: float = 0.001) -> list[str]:
        """Update the hand, and record its torque and the arm's velocity."""
        words = self._hand.update(t, q, period_s)
        if self._hand.touching:
            torque = np.zeros_like(q)
            self._hand.torque(q, self._plant.q_dot, torque)
            self._torque.append(torque)
            self._velocity.append(self._plant.q_dot.copy())
        return words

    def led(self, names: Sequence[str], joint: int, way_s: float) -> Led:
        """Result at one joint, led for way_s [s]."""
        torque = np.array(self._torque)[:, joint]
        velocity = np.array(self._velocity)[:, joint]
        way = slice(round(500 * way_s), round(1000 * way_s))
        speed = float(np.abs(velocity[way]).mean())
        return Led(
            joint=names[joint],
            peak_nm=round(float(np.abs(torque).max()), 3),
            usual_nm=round(float(np.median(np.abs(torque[way]))), 3),
            work_j=round(float(np.sum(torque * velocity)) * 0.001, 4),
            moved_rad=round(float(np.sum(velocity)) * 0.001, 4),
            tremble=round(float(np.std(velocity[way])) / max(speed, 1e-6), 3),
        )


def stiffness(arm: SimulatedArm) -> tuple[Vector, Vector]:
    """Spring [Nm/rad] and damper [Nm s/rad] of the hand at each joint (n,), in the present pose."""
    model = arm.plant.parameters.model
    data = model.createData()
    pin.computeJointJacobians(model, data, arm.plant.q)
    grip = data.oMi[model.nv].act(model.inertias[model.nv].lever)
    lever = np.empty(model.nv)
    for i in range(model.nv):
        lever[i] = np.linalg.norm(np.cross(data.J[3:, i], grip - data.oMi[i + 1].translation))
    square = np.maximum(lever, SMALLEST_LEVER_M) ** 2
    return STIFFNESS_N_M * square, DAMPING_NS_M * square


def takes(
    arm: SimulatedArm, names: Sequence[str], way: Mapping[int, float], speed: float, rests_s: float
) -> float:
    """Let the hand lead joints to positions [rad], rest and let go; how long the way is [s]."""
    k, d = stiffness(arm)
    way_s = max(abs(goal - float(arm.plant.q[i])) for i, goal in way.items()) / speed
    script: list[AnyAct] = [
        Guide(
            at_s=0.0,
            to={names[i]: goal},
            speed=max(abs(goal - float(arm.plant.q[i])) / way_s, 1e-3),
            stiffness=float(k[i]),
            damping=float(d[i]),
            max_torque=STRONGEST_NM,
        )
        for i, goal in way.items()
    ]
    script.append(Release(at_s=way_s + rests_s))
    limit = 0.3 * arm.plant.parameters.lightest_link / arm.settings.step_s
    arm.hand = cast(Hand, Meter(Hand(script, names, limit), arm))
    return way_s


def metered(arm: SimulatedArm) -> Meter:
    """The hand that was put there by `takes`."""
    return cast(Meter, arm.hand)


def stroke(c: Configuration, q: Vector, joint: int) -> float:
    """Goal of leading a joint: STROKE_RAD towards the middle of its range [rad]."""
    limits = c.joints[joint].limits
    towards = 1.0 if q[joint] < 0.5 * (limits.lower + limits.upper) else -1.0
    return float(q[joint] + towards * min(STROKE_RAD, 0.4 * (limits.upper - limits.lower)))


def lead(
    rig: Rig, to: Mapping[int, float], speed: float, rests_s: float = 0.0
) -> tuple[Way, list[Led]]:
    """Let the hand lead joints of the armed arm, let go, and wait until its trajectory goes on."""
    arm, names = rig.arm, rig.robot.configuration.joint_names
    start = arm.plant.q.copy()
    way_s = takes(arm, names, to, speed, rests_s)
    while not metered(arm).done:
        rig.step()
    if not yields(rig):
        raise click.ClickException(f"{rig.mode}: {rig.tick.controller.machine.cause}")
    released, coast, drift = rig.time_s, 0.0, 0.0
    commanded = np.zeros(len(names))
    theta, q = arm.plant.theta.copy(), arm.plant.q.copy()
    while yields(rig):
        rig.step()
        decision = rig.decision
        commanded += decision.velocity * rig.robot.configuration.period_s
        coast = max(coast, float(np.abs(arm.plant.theta - theta).max()))
        drift = max(drift, float(np.abs(arm.plant.q - q).max()))
    rows = [
        replace(
            metered(arm).led(names, i, way_s),
            coast_mrad=round(1000 * coast, 1),
            commanded_mrad=round(1000 * float(np.abs(commanded).max()), 1),
            drift_mrad=round(1000 * drift, 1),
            resumed_s=round(rig.time_s - released, 3),
        )
        for i in to
    ]
    rig.run(1.0)
    return Way(start, to), rows


def yields(rig: Rig) -> bool:
    """True while a person leads the arm, or did a moment ago."""
    return rig.mode is Mode.ADMITTANCE


def lead_limp(rig: Rig, way: Way, speed: float) -> list[Led]:
    """The same way with an arm like that of `rig`, its drives off, that weighs nothing."""
    arm = SimulatedArm(rig.arm.description, rig.arm.settings, lambda _: None)
    arm.plant.weigh(np.zeros(3))
    arm.plant.place(way.start)
    names = rig.robot.configuration.joint_names
    way_s = takes(arm, names, way.to, speed, 0.0)
    arm.advance(way_s)
    return [metered(arm).led(names, i, way_s) for i in way.to]
