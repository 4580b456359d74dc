"""Loads that an armed arm takes while its trajectory runs: it yields, and says what it believes.

The whole program runs in lockstep with arms as wide as the world, which swing about a pose of their
own. The load is there from one moment on, as a cup is that somebody puts into the hand. Where the
arm holds because it could not go on by itself, somebody starts it again, and arms it.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from bench.rigs.arm_without_bus import Course
from bench.rigs.lockstep import Rig, lockstep_rig
from bench.study import courses, world
from bench.study.loads import AWAY_M
from bench.study.world import Law
from common.arrays import Vector
from daemon.config.load import Robot, load_robot
from daemon.modes.table import Event, Mode
from programs.simulate.simulated_robot import read_simulation

WATCHED_S: Final = 60.0  # from the load on
LOOKS_S: Final = 3.0  # Somebody looks after an arm that stands this often.
_MARGIN: Final = 0.15  # of the way between its limits that a joint keeps off them, each side


@dataclass(frozen=True, slots=True)
class ArmedJob:
    """One arm, the mass that it gets [kg], and how long it worked before [s]."""

    robot: Path
    law: Law
    seed: int
    mass: float
    worked_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmedResult:
    """What became of it."""

    job: ArmedJob
    felt_s: float | None  # from the load until the arm first yielded or let go; None: never
    hinted_s: float | None  # until it was said what to do if it is one; None: not within WATCHED_S
    found_s: float | None  # from the load until it was recognised, likewise
    mass: float  # that was believed [kg]; NaN
    told_before: bool  # a load was recognised before there was one
    rearmed: int  # times that it was armed again
    modes: dict[str, float]  # seconds from the load on, by mode


def armed_load(job: ArmedJob) -> ArmedResult:
    """Let one arm work, arm it, give it the load, and watch."""
    robot = load_robot(job.robot)
    settings = world.subject(robot, job.law, job.seed).settings
    rng = np.random.default_rng((job.seed, 63))
    with tempfile.TemporaryDirectory() as place:
        swing = _swing(robot, job.worked_s + WATCHED_S, rng)
        folder = courses.folder_with(swing, robot, Path(place) / "arm")
        with lockstep_rig(folder, simulate=lambda _: settings) as rig:
            rig.enable()
            rig.run(1.0)
            rig.request(Event.START)
            before = _Watch(rig)
            before.until(job.worked_s)
            if reasons := rig.permit():
                raise RuntimeError(f"seed {job.seed} is not armed: {'; '.join(reasons)}")
            before.until(job.worked_s + LOOKS_S)
            com = rig.tick.estimator.model.tool_place + rng.uniform(-AWAY_M, AWAY_M, 3)
            rig.arm.plant.carry(job.mass, com)
            after = _Watch(rig)
            after.until(WATCHED_S)
    return ArmedResult(
        job=job,
        felt_s=after.felt_s,
        hinted_s=after.hinted_s,
        found_s=after.found_s,
        mass=after.mass,
        told_before=before.found_s is not None,
        rearmed=after.rearmed,
        modes={mode: round(seconds, 2) for mode, seconds in after.modes.items()},
    )


class _Watch:
    """What happens from now on, until a load is recognised."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._began_s = rig, rig.time_s
        self._arms = rig.tick.controller.machine.armed
        self.felt_s: float | None = None
        self.hinted_s: float | None = None
        self.found_s: float | None = None
        self.mass, self.rearmed = np.nan, 0
        self.modes: dict[str, float] = {}

    def until(self, seconds: float) -> None:
        """Go on until so long after the beginning, or until a load is recognised."""
        rig, period_s = self._rig, self._rig.robot.configuration.period_s
        while (now_s := rig.time_s - self._began_s) < seconds and self.found_s is None:
            rig.step()
            mode = str(rig.mode)
            self.modes[mode] = self.modes.get(mode, 0.0) + period_s
            if self.felt_s is None and rig.mode not in (Mode.TRACKING, Mode.HOLDING):
                self.felt_s = now_s
            if self.hinted_s is None and rig.tick.loads.hint:
                self.hinted_s = now_s
            if (found := rig.tick.loads.found) is not None:
                self.found_s, self.mass = now_s, found.mass
            elif rig.ticks % round(LOOKS_S / period_s) == 0:
                self._look_after()

    def _look_after(self) -> None:
        """Start an arm that stands, and arm it where it was armed before."""
        rig, machine = self._rig, self._rig.tick.controller.machine
        if rig.mode is not Mode.HOLDING:
            return
        rig.tick.controller.request(Event.START, "the bench", rig.time_s)
        if self._arms and not machine.armed:
            self.rearmed += not rig.permit()


def _swing(robot: Robot, seconds: float, rng: np.random.Generator) -> Course:
    """A move to a pose well within the limits, and sinusoids about it."""
    c, room = robot.configuration, courses.Room.of(robot.configuration)
    margin: Vector = _MARGIN * (room.upper - room.lower)
    room = replace(room, lower=room.lower + margin, upper=room.upper - margin)
    initial = read_simulation(robot).initial_position
    start = np.array([initial.get(name, 0.0) for name in c.joint_names])
    home = rng.uniform(room.lower, room.upper)
    there = courses.move(room, start, home)
    return courses.joined([there, courses.sinusoids(room, home, seconds, rng)])
