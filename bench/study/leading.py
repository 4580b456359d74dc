"""Hands that hold a simulated arm by one joint or by its tool, and the force that leading it takes.

A hand is a spring and a damper from an anchor that it moves, updated every millisecond. Forces at
the tool are torques over the joint's lever about it.
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
from common.arrays import Matrix, Vector
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Sinusoid
from daemon.config.vectors import limits_of
from daemon.modes.contact_reactions import AfterQuiet
from daemon.modes.table import Event, Mode
from programs.contactctl.balance import LEADING_RAD_S, levers
from programs.contactctl.gain import balance_of

SHARE: Final = 0.6  # of each joint's range, about its middle: arms are not led from stop to stop
SWING: Final = Sinusoid(amplitude=0.15, frequency_Hz=0.15)  # of the work
STROKE_RAD: Final = 0.3
DAMPING_S: Final = 1.0 / 75.0  # of a hand, over its stiffness
LIGHTEST: Final = 0.3  # limit of the damping, beyond which a light link would be unstable at 1 ms
STRONGEST_N: Final = 40.0
RISES_N_S: Final = 4.0  # of a hand's force until a joint yields
MOVES: Final = 0.02  # [rad/s]
PULLS, PULLS_S = 1.2, 3.0  # torque of a load or a cable, over that at which the joint yielded
REACH_M, SPEED_M_S, TRIES = 0.12, 0.15, 8  # of a hand that takes the tool
COMES_S, RESTS_S, LEAVES_S, BEFORE_S = 0.8, 30.0, 10.0, 3.0
GOES_ON: Final = frozenset({Mode.TRACKING, Mode.RETURNING})


def robot_of(robot: Robot | None = None, *, probes: bool = True, assists: bool = False) -> Robot:
    """Arm, by default Romeo's, with balanced gains, that swings all joints and is led for long."""
    robot = robot or load_robot(ROMEO)
    c, change = robot.configuration, msgspec.structs.replace
    gains = balance_of(c, robot.urdf).gain.tolist()
    admittance = change(
        c.admittance,
        max_duration_s=600.0,
        max_excursion=6.3,
        after_quiet=AfterQuiet.RETURN,
        probe=probes,
        assist=assists,
    )
    c = change(
        c,
        joints=[change(j, admittance_gain=k) for j, k in zip(c.joints, gains, strict=True)],
        trajectory=change(c.trajectory, sinusoids=dict.fromkeys(c.joint_names, SWING)),
        admittance=admittance,
    )
    return replace(robot, configuration=c)


def arm_at_work(robot: Robot, seed: int, seconds: float) -> ArmInTheLoop:
    """Armed arm that has worked for this time, and continues."""
    limits = limits_of(robot.configuration)
    middle, half = (limits.lower + limits.upper) / 2.0, (limits.upper - limits.lower) / 2.0
    reach = np.minimum(SHARE * half, np.maximum(half - 1.5 * SWING.amplitude, 0.0))
    share = np.random.default_rng((seed, 80)).uniform(-1.0, 1.0, len(half))
    law = world.LAWS[seed % len(world.LAWS)]
    subject = replace(world.subject(robot, law, seed), drift=0.0)
    on = ArmInTheLoop(subject, robot, middle + reach * share)
    on.start()
    on.run(seconds)
    if reasons := on.permit():
        raise RuntimeError("; ".join(reasons))
    return on


@dataclass
class Hand:
    """Spring and damper towards an anchor (m,) that moves at a rate; `place` gives position (m,)
    and Jacobian (m, n) of what it holds, a joint [rad] or the tool [m]; `force` is the last one."""

    place: Callable[[Vector], tuple[Vector, Matrix]]
    stiffness: float
    strongest: float
    anchor: Vector
    rate: Vector
    force: Vector
    damping: float

    def __call__(self, q: Vector, q_dot: Vector) -> Vector:
        self.anchor = self.anchor + 0.001 * self.rate
        x, J = self.place(q)
        force = self.stiffness * (self.anchor - x) + self.damping * (self.rate - J @ q_dot)
        self.force = force * min(1.0, self.strongest / max(float(np.linalg.norm(force)), 1e-9))
        torque: Vector = J.T @ self.force
        return torque


@dataclass(frozen=True, slots=True)
class Led:
    """One joint that was led, compared with the same arm weightless and with its drives off; forces
    at the tool [N], work [J]."""

    joint: str
    sets_out: float
    stated: float  # part of that for the configured level
    friction: float  # part for friction at rest, twice: it opposes the hand, and raises the level
    leads: float
    work: float
    leads_off: float
    work_off: float
    tremble: float  # standard deviation of the link's speed over its mean, in the second half
    coasts_rad: float
    rebounds_rad: float  # backwards, by its drive, whose velocity loop the hand had wound up


def yields(on: ArmInTheLoop) -> bool:
    """True while a hand leads the arm, or did until a moment ago."""
    return on.mode is Mode.ADMITTANCE


def lead(on: ArmInTheLoop, joint: int, hand_n_m: float) -> Led | None:
    """Figures of a joint of a holding arm that is made to yield, led at 0.25 rad/s, and released in
    motion; None if it did not yield."""
    plant, start = on.harness.plant, on.harness.plant.q.copy()
    if (begun := _set_out(on, joint)) is None:
        return None
    way, force, lever = begun
    on.drives.external[:] = 0.0
    sticks = float(plant.coulomb[:, joint].sum()) * on.subject.settings.law.stribeck
    k, row = hand_n_m * lever**2, np.eye(plant.n)[[joint]]
    anchor, rate = row @ plant.q + way * force * lever / k, np.array([way * LEADING_RAD_S])
    softer = LIGHTEST * float(plant.parameters.lightest_link[joint]) / 0.001
    hand = Hand(lambda q: (row @ q, row), k, STRONGEST_N * lever, anchor, rate, np.zeros(1),
                min(DAMPING_S * k, softer))  # fmt: skip
    on.drives.hold = hand
    torque, speed = _along(hand, on.step, plant.q_dot, joint, on.period_s)
    on.drives.hold, theta = None, plant.theta.copy()
    on.run(1.0)
    coasts, rebounds = let_go(plant.theta - theta, joint, way)
    while yields(on):
        on.step()
    off, speed_off = _limp(on.subject, start, replace(hand, anchor=row @ start), joint)
    late = slice(len(torque) // 2, None)
    return Led(
        joint=on.robot.configuration.joint_names[joint],
        sets_out=force,
        stated=on.robot.configuration.joints[joint].thresholds.contact / lever,
        friction=2.0 * sticks / lever,
        leads=float(np.median(np.abs(torque[late]))) / lever,
        work=float(torque @ speed) * on.period_s,
        leads_off=float(np.median(np.abs(off[late]))) / lever,
        work_off=float(off @ speed_off) * on.period_s,
        tremble=float(speed[late].std() / max(abs(speed[late].mean()), 1e-6)),
        coasts_rad=coasts,
        rebounds_rad=rebounds,
    )


def let_go(moved: Vector, joint: int, way: float) -> tuple[float, float]:
    """Largest motion by which motors coast (n,) [rad], and by which that of a joint led in this
    direction `way` (1, -1) springs back."""
    rebounds = max(-way * float(moved[joint]), 0.0)
    onwards = np.abs(moved)
    onwards[joint] = max(way * float(moved[joint]), 0.0)
    return float(onwards.max()), rebounds


def _set_out(on: ArmInTheLoop, joint: int) -> tuple[float, float, float] | None:
    """Push a joint of a holding arm until it moves, and keep pushing. Returns the direction of the
    push, towards the joint's middle, its force at the tool [N] and lever [m]; None if it never
    yielded."""
    plant, start = on.harness.plant, on.harness.plant.q.copy()
    lever = float(levers(on.robot.model.tool_jacobian(start)[np.newaxis])[0, joint])
    limits, force = limits_of(on.robot.configuration), 0.0
    way = float(np.sign(limits.lower[joint] + limits.upper[joint] - 2.0 * start[joint]))
    while not yields(on) or way * plant.theta_dot[joint] < MOVES:
        force += RISES_N_S * on.period_s
        on.drives.external[joint] = way * force * lever
        if force > STRONGEST_N:
            on.drives.external[:] = 0.0
            return None
        on.step()
    return way, force, lever


def pull(on: ArmInTheLoop, joint: int) -> float | None:
    """Distance [rad] by which a steady torque, as of a load or a cable, moves a joint that it made
    yield; None if the joint did not yield."""
    plant = on.harness.plant
    if (begun := _set_out(on, joint)) is None:
        return None
    way, force, lever = begun
    start = float(plant.q[joint])
    on.drives.external[joint] = way * PULLS * force * lever
    on.run(PULLS_S)
    carried = way * (float(plant.q[joint]) - start)
    on.drives.external[:] = 0.0
    while yields(on):
        on.step()
    return carried


def _along(
    hand: Hand, step: Callable[[], None], q_dot: Vector, joint: int, period_s: float
) -> tuple[Vector, Vector]:
    """Torque [Nm] and speed of the link [rad/s], a row per period of the lead."""
    rows = []
    for _ in range(round(STROKE_RAD / LEADING_RAD_S / period_s)):
        step()
        rows.append((float(hand.force[0]), float(q_dot[joint])))
    table = np.array(rows)
    return table[:, 0], table[:, 1]


def _limp(subject: Subject, start: Vector, hand: Hand, joint: int) -> tuple[Vector, Vector]:
    """The same lead with a similar arm, weightless and with its drives off."""
    harness = Harness(subject)
    plant = harness.plant
    plant.weigh(np.zeros(3))
    plant.place(start)

    def step() -> None:
        for _ in range(harness.per_tick):
            harness.period(hand(plant.q, plant.q_dot)[np.newaxis])

    return _along(hand, step, plant.q_dot, joint, harness.period_s)


@dataclass(frozen=True, slots=True)
class Rested:
    """Hand that led an arm off its trajectory, and rested on it; times from its rest, or from its
    release [s], infinite: not within RESTS_S, LEAVES_S."""

    share: float  # of the level in force, on the joint that it loads most
    joint: str
    hand_n_m: float
    newtons: float
    went_on_s: float
    let_go_s: float  # until the arm continues, or holds

    @property
    def missed(self) -> bool:
        """True if the trajectory continued under the hand."""
        return bool(np.isfinite(self.went_on_s)) and self.share > 0.0


def rest(
    on: ArmInTheLoop, share: float, hand_n_m: float, rng: np.random.Generator
) -> Rested | None:
    """Lead a tracking arm by its tool, and rest on it with a share of the level in force; None if
    it did not yield. With a share of 0 the hand releases it at once."""
    plant, at_tool = on.harness.plant, Hands(on.robot.model, on.robot.urdf).at_tool
    if not _works(on):
        return None
    for _ in range(TRIES):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        x, rate = at_tool(plant.q)[0], way * SPEED_M_S
        d, none = DAMPING_S * hand_n_m, np.zeros(3)
        on.drives.hold = hand = Hand(at_tool, hand_n_m, STRONGEST_N, x, rate, none, d)
        on.run(REACH_M / SPEED_M_S)
        if yields(on):
            break
        on.drives.hold = None
        if on.mode is not Mode.TRACKING:
            return None
        on.run(BEFORE_S)
    else:
        return None
    hand.rate, joint, force = np.zeros(3), 0, np.zeros(3)
    for _ in range(round(COMES_S / on.period_s) if share else 0):
        x, J = at_tool(plant.q)
        torque = np.abs(J.T @ way) / on.estimate.threshold
        joint = int(torque.argmax())
        force = way * share / torque[joint]
        hand.anchor += 0.15 * (x + force / hand_n_m - hand.anchor)
        on.step()
    went_on = _until(on, RESTS_S if share else 0.0, GOES_ON)
    on.drives.hold = None
    let_go = _until(on, LEAVES_S, GOES_ON | {Mode.HOLDING}) if np.isinf(went_on) else np.nan
    name, newtons = on.robot.configuration.joint_names[joint], float(np.linalg.norm(force))
    return Rested(share, name, hand_n_m, newtons, went_on, let_go)


def _works(on: ArmInTheLoop) -> bool:
    """Let an armed arm work again; False if it cannot."""
    _until(on, LEAVES_S, GOES_ON | {Mode.HOLDING})
    if on.mode is Mode.HOLDING:
        on.tick.controller.request(Event.START, "the bench", on.time_s)
    on.run(BEFORE_S)
    return on.mode is Mode.TRACKING and not on.permit()


def _until(on: ArmInTheLoop, seconds: float, modes: frozenset[Mode]) -> float:
    """Time until the arm is in one of these modes [s]; infinite if not within `seconds`."""
    begin = on.time_s
    while on.time_s < begin + seconds:
        if on.mode in modes:
            return on.time_s - begin
        on.step()
    return np.inf
