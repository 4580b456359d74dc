"""Armed arms that learned what is no longer true, and their reaction, judged by the plant.

An arm works, meets one change, and continues without a person. `Watched` ticks it and records
motion that no person drives, false contacts, touches and levels.
"""

from dataclasses import dataclass, field, replace
from typing import Final

import msgspec
import numpy as np

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.rigs.lockstep import ROMEO
from bench.study import changes, world
from bench.study.changes import BY_PERSON, LASTING, Change, Kind
from bench.study.world import LAWS
from common.arrays import Vector
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Sinusoid
from daemon.config.vectors import limits_of
from daemon.modes.contact_reactions import AfterQuiet, ContactReaction
from daemon.modes.table import GUIDED, Event, Mode

WORK_S: Final = 240.0
JUDGED_S: Final = 60.0  # at the end of the work, in which the level is measured
SOON_S: Final = 10.0
LATE_S: Final = 120.0
TOUCHES_S: Final = 75.0
EVERY_S: Final = 15.0  # between touches: doubt lasts until the joint has passed the place again
TOUCH_S: Final = 0.5
FADES_S: Final = 0.5
AFTER_S: Final = 130.0
LEVEL_S: Final = 40.0
TIMES: Final = 2.0  # size of a touch, over the level in force before the change
MOVES: Final = 0.02  # [rad/s]
FAST: Final = 0.1  # speed of a joint touched in motion [rad/s], engaged for ENGAGED_S
ENGAGED_S: Final = 0.3
GAINS: Final = (0.1, 5.0)
START: Final = np.array([0.3, 0.3, 0.0, -0.8, -1.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Job:
    """One arm and one kind of change."""

    seed: int
    kind: Kind
    reaction: ContactReaction = ContactReaction.ADMITTANCE  # to contact
    light: bool = False  # with assist and a guide


@dataclass
class Course:
    """Observations of one arm."""

    alone_s: float = 0.0  # longest motion without a person
    alone_rad: float = 0.0  # largest, in one contact
    false: list[float] = field(default_factory=list)  # times of contacts [s]
    levels: list[float] = field(default_factory=list)  # in motion, of the changed joint [Nm]
    felt: list[float] = field(default_factory=list)  # delays of touches [s]; infinite: missed
    faults: int = 0

    def level(self) -> float:
        """Median of `levels` [Nm]; clears them."""
        median = float(np.median(self.levels)) if self.levels else np.nan
        self.levels.clear()
        return median


def arm_of(
    seed: int, contact: ContactReaction = ContactReaction.ADMITTANCE, *, light: bool = False
) -> tuple[Robot, world.Law, bool]:
    """Robot of one arm, its friction law, and whether it has its own gains."""
    robot = load_robot(ROMEO)
    c, rng = robot.configuration, np.random.default_rng((seed, 71))
    own = bool(rng.random() < 1 / 3)
    gain = float(np.exp(rng.uniform(*np.log(GAINS))))
    joints = [
        joint if own else msgspec.structs.replace(joint, admittance_gain=gain) for joint in c.joints
    ]
    limits = limits_of(c)
    room = np.minimum(limits.upper - START, START - limits.lower)
    sinusoids = {
        joint.name: Sinusoid(
            amplitude=float(min(0.8 * reach, rng.uniform(0.2, 0.4))),
            frequency_Hz=float(rng.uniform(0.08, 0.2)),
        )
        for joint, reach in zip(c.joints, room.tolist(), strict=True)
    }
    trajectory = msgspec.structs.replace(c.trajectory, sinusoids=sinusoids)
    admittance = msgspec.structs.replace(c.admittance, after_quiet=AfterQuiet.RETURN)
    if light:
        line = {"stiff": ("y", "z", "rx", "ry", "rz")}
        admittance = msgspec.structs.replace(admittance, assist=True, **line)
    reactions = msgspec.structs.replace(c.reactions, contact=contact)
    changed = {"trajectory": trajectory, "admittance": admittance, "reactions": reactions}
    c = msgspec.structs.replace(c, joints=joints, **changed)
    return replace(robot, configuration=c), LAWS[seed % len(LAWS)], own


class Watched:
    """One arm at work, observed tick by tick."""

    def __init__(self, robot: Robot, law: world.Law, seed: int, change: Change) -> None:
        subject = replace(world.subject(robot, law, seed), drift=0.0)
        self.on = ArmInTheLoop(subject, robot, START)
        self.change, self.seen = change, Course()
        self._rng = np.random.default_rng((seed, 72))
        n = len(START)
        self.there = self.rests = False
        self.push: Vector = np.zeros(n)
        self._alone_s, self._alone_rad, self._least = np.zeros((3, n))
        self._before, self._fades_s = Mode.OFF, -1.0
        self.on.start()

    def run(self, seconds: float) -> None:
        """Tick for this time."""
        for _ in range(round(seconds / self.on.period_s)):
            self.step()

    def step(self) -> None:
        """One tick."""
        on, plant = self.on, self.on.harness.plant
        person, torque = self.push, np.zeros(len(START))
        if self.there:
            torque = self.change.torques(plant.q_dot, plant.q, START)
            changes.lose(self.change, on, self._rng)
            if self.change.kind in BY_PERSON:
                person = person + torque
                torque = np.zeros_like(torque)
        on.drives.external[:] = person + torque
        on.step()
        if person.any():
            self._fades_s = on.time_s + FADES_S
        self._judge(person)
        if on.ticks % 50 == 0:
            self._go_on()

    def _judge(self, person: Vector) -> None:
        on, seen, mode = self.on, self.seen, self.on.mode
        # Speeds of the rotors: a link that falls through its gap is not moved by its drive.
        velocity = on.harness.plant.theta_dot
        speed, estimate = np.abs(velocity), on.estimate
        yields = mode in (Mode.ADMITTANCE, Mode.RETRACTING)
        begins = yields and self._before not in GUIDED
        if begins:
            self._alone_rad[:], self._least[:] = 0.0, speed
            if on.time_s > self._fades_s:
                seen.false.append(round(on.time_s, 2))
        alone = (speed > MOVES) & (person * velocity <= 0.0)
        alone &= yields and on.time_s > self._fades_s
        self._alone_s = np.where(alone, self._alone_s + on.period_s, 0.0)
        # The remainder of the initial speed decays.
        coasts = speed <= self._least + MOVES
        self._least = np.where(coasts, speed, np.where(self._least < MOVES, 0.0, self._least))
        self._alone_rad += np.where(alone & ~coasts, speed * on.period_s, 0.0)
        seen.alone_s = max(seen.alone_s, float(self._alone_s.max()))
        seen.alone_rad = max(seen.alone_rad, float(self._alone_rad.max()))
        i = self.change.joint
        if mode is Mode.TRACKING and speed[i] > FAST:
            seen.levels.append(float(estimate.threshold[i]))
        seen.faults += mode is Mode.FAULTED and self._before is not Mode.FAULTED
        self._before = mode

    def _go_on(self) -> None:
        """Arm again after the permission ended, and start again after the trajectory did."""
        on, machine = self.on, self.on.tick.controller.machine
        if on.mode is Mode.TRACKING and not machine.armed:
            on.permit()
        if on.mode is Mode.HOLDING and not self.rests:
            on.tick.controller.request(Event.START, "the bench", on.time_s)

    def rest(self, seconds: float) -> None:
        """Stand still for this time, then continue."""
        on = self.on
        on.tick.controller.request(Event.PAUSE, "the bench", on.time_s)
        self.rests = True
        self.run(seconds)
        self.rests = False
        changes.begin(self.change, on)
        on.tick.controller.request(Event.START, "the bench", on.time_s)

    def touches(self, torque: float) -> None:
        """Touch the joint in motion repeatedly, for TOUCHES_S."""
        on, i, end = self.on, self.change.joint, self.on.time_s + TOUCHES_S
        while on.time_s < end:
            self.run(EVERY_S - TOUCH_S)
            waits = on.time_s + EVERY_S
            engaged_s = 0.0  # a touch while crossing the gap would be missed anyway
            while on.time_s < waits and engaged_s < ENGAGED_S:
                self.step()
                plant = on.harness.plant
                moves = on.mode is Mode.TRACKING and abs(plant.q_dot[i]) > FAST
                engaged_s = engaged_s + on.period_s if moves and not plant.in_gap[i] else 0.0
            if on.mode is Mode.TRACKING:
                self.seen.felt.append(self._touch(torque))

    def _touch(self, torque: float) -> float:
        """Touch once, against the motion; returns the delay of its detection [s]."""
        on, i = self.on, self.change.joint
        self.push[i] = -torque * np.sign(on.harness.plant.q_dot[i])
        felt = np.inf
        for tick in range(round(TOUCH_S / on.period_s)):
            self.step()
            if np.isinf(felt) and on.estimate.thresholded.any():
                felt = tick * on.period_s
        self.push[:] = 0.0
        return felt


def course(
    job: Job, change: Change, *, happens: bool, always: bool = False
) -> tuple[Course, tuple[int, int], float]:
    """One arm with the change, without it, or with it from the beginning (`always`); returns the
    observations, the false contacts during and after the change, and the level at the end [Nm]."""
    robot, law, _ = arm_of(job.seed, job.reaction, light=job.light)
    watched = Watched(robot, law, job.seed, change)
    on, seen = watched.on, watched.seen
    if always:
        changes.begin(change, on)
    watched.run(WORK_S - JUDGED_S)
    seen.levels.clear()
    watched.run(JUDGED_S)
    before = seen.level()
    seen.false.clear()
    seconds = change.seconds
    if happens and change.kind == "rest":
        watched.rest(seconds)
    else:
        watched.there = happens
        if happens:
            changes.begin(change, on)
        watched.run(LATE_S if change.kind in LASTING else seconds)
    came = len(seen.false)
    if change.kind not in LASTING:
        watched.there = False
        changes.end(change, on)
    elif change.kind == "rest":
        watched.run(LATE_S)
        came = len(seen.false)
    ended = on.time_s
    watched.run(SOON_S)
    watched.touches(TIMES * before)
    watched.run(max(ended + AFTER_S - on.time_s, 0.0))
    seen.levels.clear()
    watched.run(LEVEL_S)
    return seen, (came, len(seen.false) - came), seen.level()
