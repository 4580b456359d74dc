"""Hands that hold a simulated arm, by one joint or by its tool, and what it costs them.

A hand is a spring and a damper from an anchor that it moves, and acts anew every millisecond.
Forces at the tool are torques over the joint's lever about it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.rigs.arm_without_bus import Harness, Subject
from bench.rigs.lockstep import ROMEO
from bench.study import world
from bench.study.hands import Hands
from bench.study.world import LAWS
from common.arrays import Vector
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration, Sinusoid
from daemon.config.vectors import limits_of
from daemon.modes.contact_reactions import AfterQuiet
from daemon.modes.table import Event, Mode
from daemon.motion.balance import LEADING_RAD_S, levers
from programs.contactctl.gain import balance_of
from simulator.plant import Plant

SHARE: Final = 0.6  # of each joint's range, in its middle: arms are not led from stop to stop
SWING: Final = Sinusoid(amplitude=0.15, frequency_Hz=0.15)  # of the work
STROKE_RAD: Final = 0.3
DAMPING_S: Final = 1.0 / 75.0  # of a hand, over its stiffness
STRONGEST_N: Final = 40.0
RISES_N_S: Final = 4.0  # force of a hand that sets a joint out
MOVES: Final = 0.02  # [rad/s]
MS: Final = 0.001


@dataclass(frozen=True, slots=True)
class HeldArm:
    """An armed arm of the world's width that has worked around a pose of its own, and its hand."""

    on: ArmInTheLoop
    subject: Subject
    hands: Hands

    @property
    def plant(self) -> Plant:
        """Of the arm that is there."""
        return self.on.harness.plant

    @property
    def lever(self) -> Vector:
        """Levers (n,) [m] of the joints about the tool."""
        q, model = self.plant.q, self.hands.model
        each: Vector = levers(model.tool_jacobian(q)[np.newaxis])[0]
        return each


def balanced_of(c: Configuration, urdf: str) -> Configuration:
    """The arm with the gains that `contactctl gain --balance` proposes."""
    gains = balance_of(c, urdf).gain.tolist()
    joints = [
        msgspec.structs.replace(joint, admittance_gain=gain)
        for joint, gain in zip(c.joints, gains, strict=True)
    ]
    return msgspec.structs.replace(c, joints=joints)


def robot_of(*, balanced: bool, probes: bool = True) -> Robot:
    """The Romeo arm, which swings all joints, and may be led for as long and far as they go."""
    robot = load_robot(ROMEO)
    c = balanced_of(robot.configuration, robot.urdf) if balanced else robot.configuration
    swings = dict.fromkeys(c.joint_names, SWING)
    c = msgspec.structs.replace(
        c,
        trajectory=msgspec.structs.replace(c.trajectory, sinusoids=swings),
        admittance=msgspec.structs.replace(
            c.admittance,
            max_duration_s=600.0,
            max_excursion=6.3,
            after_quiet=AfterQuiet.RETURN,
            probe=probes,
        ),
    )
    return replace(robot, configuration=c)


def arm_at_work(robot: Robot, seed: int, seconds: float) -> HeldArm:
    """One arm, armed, that has worked for so long, and goes on."""
    limits = limits_of(robot.configuration)
    middle, half = (limits.lower + limits.upper) / 2.0, (limits.upper - limits.lower) / 2.0
    room = np.maximum(half - 1.5 * SWING.amplitude, 0.0)
    share = np.random.default_rng((seed, 80)).uniform(-SHARE, SHARE, len(half))
    subject = replace(world.subject(robot, LAWS[seed % len(LAWS)], seed), drift=0.0)
    on = ArmInTheLoop(subject, robot, middle + np.minimum(SHARE * half, room) / SHARE * share)
    on.start()
    on.run(seconds)
    if reasons := on.permit():
        raise RuntimeError("; ".join(reasons))
    return HeldArm(on, subject, Hands(robot.model, robot.urdf))


@dataclass
class JointHand:
    """A hand on one joint: spring [Nm/rad] and damper towards an anchor [rad] that moves at a rate
    [rad/s]; `torque` is its last [Nm]."""

    joint: int
    stiffness: float
    strongest: float  # [Nm]
    anchor: float
    rate: float
    torque: float = 0.0

    def __call__(self, q: Vector, q_dot: Vector) -> Vector:
        self.anchor += self.rate * MS
        i, out = self.joint, np.zeros_like(q)
        damped = DAMPING_S * self.stiffness * (self.rate - q_dot[i])
        pull = self.stiffness * (self.anchor - q[i]) + damped
        self.torque = out[i] = min(max(pull, -self.strongest), self.strongest)
        return out


@dataclass(frozen=True, slots=True)
class Led:
    """One joint that was led, beside the same arm with its drives off, weightless; forces at the
    tool [N], work [J]."""

    joint: str
    sets_out: float
    leads: float
    work: float
    leads_off: float
    work_off: float
    tremble: float  # standard deviation of the link's speed over its mean, second half of the way
    coasts_rad: float


def yields(on: ArmInTheLoop) -> bool:
    """True while a hand leads the arm, or did a moment ago."""
    return on.mode is Mode.ADMITTANCE


def lead(held: HeldArm, joint: int, hand_n_m: float) -> Led | None:
    """Set a joint of an arm that holds out, lead it at 0.25 rad/s, and let go in motion; None where
    it did not set out."""
    on, plant, lever = held.on, held.plant, float(held.lever[joint])
    limits, start = limits_of(on.robot.configuration), plant.q.copy()
    way = float(np.sign(limits.lower[joint] + limits.upper[joint] - 2.0 * plant.q[joint]))
    force = 0.0
    while not yields(on) or way * plant.theta_dot[joint] < MOVES:
        force += RISES_N_S * on.period_s
        if force > STRONGEST_N:
            on.drives.external[:] = 0.0
            return None
        on.drives.external[joint] = way * force * lever
        on.step()
    on.drives.external[:] = 0.0
    k = hand_n_m * lever**2
    begins = float(plant.q[joint]) + way * force * lever / k
    hand = JointHand(joint, k, STRONGEST_N * lever, begins, way * LEADING_RAD_S)
    on.drives.hold = hand
    torque, speed = _along(hand, on.step, plant, on.period_s)
    on.drives.hold, theta = None, plant.theta.copy()
    on.run(1.0)
    coasts = float(np.abs(plant.theta - theta).max())
    while yields(on):
        on.step()
    torque_off, speed_off = _limp(held, start, replace(hand, anchor=float(start[joint])))
    late = slice(len(torque) // 2, None)
    return Led(
        joint=on.robot.configuration.joint_names[joint],
        sets_out=force,
        leads=float(np.median(np.abs(torque[late]))) / lever,
        work=float(torque @ speed) * on.period_s,
        leads_off=float(np.median(np.abs(torque_off[late]))) / lever,
        work_off=float(torque_off @ speed_off) * on.period_s,
        tremble=float(speed[late].std() / max(abs(speed[late].mean()), 1e-6)),
        coasts_rad=coasts,
    )


def _along(
    hand: JointHand, step: Callable[[], None], plant: Plant, period_s: float
) -> tuple[Vector, Vector]:
    """Torque [Nm] and speed of the link [rad/s], a row for each period of the way."""
    rows = []
    for _ in range(round(STROKE_RAD / LEADING_RAD_S / period_s)):
        step()
        rows.append((hand.torque, float(plant.q_dot[hand.joint])))
    table = np.array(rows)
    return table[:, 0], table[:, 1]


def _limp(held: HeldArm, start: Vector, hand: JointHand) -> tuple[Vector, Vector]:
    """The same way with an arm like it, its drives off, that weighs nothing."""
    harness = Harness(held.subject)
    plant = harness.plant
    plant.weigh(np.zeros(3))
    plant.place(start)
    for joint in range(plant.n):
        harness.servo.release(joint)

    def step() -> None:
        for _ in range(harness.per_tick):
            harness.period(hand(plant.q, plant.q_dot)[np.newaxis])

    return _along(hand, step, plant, harness.period_s)


REACH_M, SPEED_M_S, TRIES = 0.12, 0.15, 8
COMES_S, RESTS_S, LEAVES_S = 0.8, 30.0, 10.0
BEFORE_S = 3.0  # in which the arm is back at work


@dataclass
class ToolHand:
    """A hand at the tool: spring [N/m] and damper towards an anchor (3,) [m] that moves at a rate
    (3,) [m/s]; `force` is its last (3,) [N]."""

    held: HeldArm
    stiffness: float
    anchor: Vector
    rate: Vector
    force: Vector

    def __call__(self, q: Vector, q_dot: Vector) -> Vector:
        self.anchor = self.anchor + self.rate * MS
        hands, model = self.held.hands, self.held.hands.model
        J = hands.jacobian(q, model.hand_joint, model.in_joint(model.tool_place))
        damped = DAMPING_S * self.stiffness * (self.rate - J @ q_dot)
        force = self.stiffness * (self.anchor - hands.tool(q)) + damped
        self.force = force * min(1.0, STRONGEST_N / max(float(np.linalg.norm(force)), 1e-9))
        torque: Vector = J.T @ self.force
        return torque


@dataclass(frozen=True, slots=True)
class Rested:
    """A hand that led an arm from its trajectory, and rested on it; times from its rest, or from
    when it let go [s], infinite: not within RESTS_S, LEAVES_S."""

    share: float  # of the level in force, on the joint that it loads most
    joint: str
    hand_n_m: float
    newtons: float
    went_on_s: float
    let_go_s: float

    @property
    def missed(self) -> bool:
        """True where the trajectory went on in the hand."""
        return bool(np.isfinite(self.went_on_s)) and self.share > 0.0


def rest(held: HeldArm, share: float, hand_n_m: float, rng: np.random.Generator) -> Rested | None:
    """Lead a tracking arm by its tool, rest on it with a share of the level in force; None where
    it did not yield. With a share of 0 the hand lets go at once."""
    on, plant, model = held.on, held.plant, held.hands.model
    if not _works(on):
        return None
    for _ in range(TRIES):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        hand = ToolHand(held, hand_n_m, held.hands.tool(plant.q), way * SPEED_M_S, np.zeros(3))
        on.drives.hold = hand
        on.run(REACH_M / SPEED_M_S)
        if yields(on):
            break
        if on.mode is not Mode.TRACKING:
            return None
        on.drives.hold = None
        on.run(3.0)
    else:
        return None
    hand.rate, joint, force = np.zeros(3), 0, np.zeros(3)
    for _ in range(round(COMES_S / on.period_s) if share else 0):
        J = held.hands.jacobian(plant.q, model.hand_joint, model.in_joint(model.tool_place))
        torque = np.abs(J.T @ way) / on.estimate.threshold
        joint = int(torque.argmax())
        force = way * share / torque[joint]
        hand.anchor += 0.15 * (held.hands.tool(plant.q) + force / hand_n_m - hand.anchor)
        on.step()
    went_on = _until_it_goes_on(on, RESTS_S if share else 0.0)
    on.drives.hold = None
    let_go = _until_it_goes_on(on, LEAVES_S) if np.isinf(went_on) else np.nan
    name = on.robot.configuration.joint_names[joint]
    return Rested(share, name, hand_n_m, float(np.linalg.norm(force)), went_on, let_go)


def _works(on: ArmInTheLoop) -> bool:
    """Have an armed arm at work again; False where it cannot."""
    begin = on.time_s
    while on.mode is not Mode.TRACKING and on.time_s < begin + LEAVES_S:
        on.step()
    if on.mode is Mode.HOLDING:
        on.tick.controller.request(Event.START, "the bench", on.time_s)
    on.run(BEFORE_S)
    return on.mode is Mode.TRACKING and not on.permit()


def _until_it_goes_on(on: ArmInTheLoop, seconds: float) -> float:
    begin = on.time_s
    while on.time_s < begin + seconds:
        if on.mode in (Mode.TRACKING, Mode.RETURNING):
            return on.time_s - begin
        on.step()
    return np.inf
