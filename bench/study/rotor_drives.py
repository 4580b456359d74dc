"""Arms whose drives reach their setpoints in all sorts of ways, and the rotors found of them.

A third of them ramp from setpoint to setpoint over the period, as contactd asks for; a third take
them as steps; a third ramp at an acceleration of their own. Their velocity loops are fast or slow,
they filter their current more or less, and take setpoints over with the next SYNC or some
milliseconds after they came. Arms are off the model as usual. What is found is good where its error
is not beyond 1.5 times the interval that is stated of it.
"""

from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np

from arrays import Matrix, Vector
from bench.report import Target
from bench.rigs.arm_without_bus import Harness, Subject
from bench.rigs.lockstep import ROMEO
from bench.rigs.reaching import WAYS, Reaching
from daemon.assembly import build_transmission
from daemon.commands.simulated_robot import describe, read_simulation
from daemon.config.load import load_robot
from daemon.identify.motions import bounds_of, excitation
from estimator.identification.friction import identify_friction
from estimator.identification.friction_fit import FrictionFit
from estimator.identification.friction_verdict import Verdict
from estimator.identification.motion_log import MotionLog
from estimator.model import Model
from simulator.description import Mismatch, SimulationSettings
from simulator.servo_periods import ServoPeriods

SECONDS: Final = 20.0
SETTLING_S: Final = 1.0
ALLOWED: Final = 1.5
_95: Final = 1.96


@dataclass(frozen=True, slots=True, kw_only=True)
class Drives:
    """Drives of one arm, and by how much its masses are off."""

    reaching: Reaching
    filter_ms: float = 3.0
    taken_ms: int = 10
    """after the SYNC whose samples a setpoint answers; a whole period: with the next"""
    seed: int = 1
    mass_off: float = 0.0
    """[%]"""


@dataclass(frozen=True, slots=True)
class Rotors:
    """Rotors of one arm, per joint (n,): share by which B is off, its 95 % interval, half, as a
    share, and whether it is given."""

    drives: Drives
    error: Vector
    half: Vector
    given: Vector

    @property
    def wrong(self) -> int:
        """Rotors that are given and further off than allowed."""
        return int(np.count_nonzero(self.given * (np.abs(self.error) > ALLOWED * self.half)))


def random_drives(number: int, seed: int) -> Drives:
    """Some drives; that of the same number and seed is always the same."""
    rng = np.random.default_rng((seed, number, 19))

    def between(least: float, most: float) -> float:
        return float(np.exp(rng.uniform(np.log(least), np.log(most))))

    bandwidth_Hz = between(4.0, 60.0)
    filter_ms = float(rng.choice([1.0, 2.0, 3.0, 5.0, 8.0]))
    taken_ms = int(rng.choice([1, 2, 4, 10]))
    acceleration = between(5.0, 100.0)
    way = WAYS[number % len(WAYS)]
    return Drives(
        reaching=Reaching(way=way, bandwidth_Hz=bandwidth_Hz, acceleration=acceleration),
        filter_ms=filter_ms,
        taken_ms=taken_ms,
        seed=int(rng.integers(10**6)),
        mass_off=float(rng.choice([0.0, 5.0])),
    )


def rotors(drives: Drives, seconds: float = SECONDS) -> Rotors:
    """Excite an arm with such drives, and identify its friction and rotors."""
    fits, true = identified(drives, seconds)
    B = np.array([fit.values.get("B", np.nan) for fit in fits])
    half = _95 * np.array([fit.errors.get("B", np.nan) for fit in fits])
    given = np.array([fit.verdict is Verdict.GOOD and fit.rotor_trusted for fit in fits])
    return Rotors(drives, B / true - 1.0, half / B, given)


def identified(drives: Drives, seconds: float = SECONDS) -> tuple[list[FrictionFit], Vector]:
    """Fits of an arm with such drives, and its true rotors (n,) [kg m2]."""
    robot = load_robot(ROMEO)
    c = robot.configuration
    mismatch = Mismatch(mass=drives.mass_off, center_of_mass=0, friction=30, torque_constant=1.5,
                        half_gap=0, rotor_inertia=15)  # fmt: skip
    settings = SimulationSettings(
        mismatch=mismatch, current_filter_ms=drives.filter_ms, seed=drives.seed
    )
    harness = Harness(Subject(robot=robot, settings=settings))
    _tune(harness, drives.reaching)
    model = Model(robot.urdf, c.joint_names)
    motion = excitation(bounds_of(c), model, c.period_s, seed=1)
    start = motion.motion.at(np.zeros(1))[0][0]
    log = _excited(harness, drives, motion.path(start, seconds), c.control.position_gain)
    estimator = msgspec.structs.replace(c.estimator, current_delay_ms=drives.filter_ms)
    known = replace(build_transmission(c), half_gap=harness.parameters.half_gap)
    most = np.array([joint.wiring.max_current_A for joint in c.joints])
    log = replace(log, joints=tuple(c.joint_names))
    fits, _ = identify_friction(log, model, known, estimator, most)
    return fits, harness.parameters.rotor_inertia


def _tune(harness: Harness, reaching: Reaching) -> None:
    """Give the harness drives that reach them so."""
    description = describe(robot := load_robot(ROMEO), read_simulation(robot))
    p = harness.parameters
    harness.servo = reaching.servo(description, p.usual_link)
    harness.periods = ServoPeriods(
        harness.servo, harness.sensors, harness.plant.masses, p.torque_constant
    )


def _excited(harness: Harness, drives: Drives, path: Matrix, gain: float) -> MotionLog:
    """Log of a motion along a path (N, n) [rad], after the arm stood at its beginning."""
    period_s, n = harness.period_s, path.shape[1]
    speed = np.gradient(path, period_s, axis=0)
    late = drives.taken_ms if drives.taken_ms < harness.per_tick else 0
    harness.plant.place(path[0])
    harness.energise()
    before = now = np.zeros(n)
    rows = np.empty((len(path), 5, n))
    for k in range(-round(SETTLING_S / period_s), len(path)):
        # `before` was asked a period before `now`; it is taken over with this SYNC.
        if not late:
            drives.reaching.reach(harness.servo, before, period_s)
        harness.run(late)
        if late:
            drives.reaching.reach(harness.servo, now, period_s)
        harness.run(harness.per_tick - late)
        sample, at = harness.sample(), max(k, 0)
        moving = speed[at] if k >= 0 else np.zeros(n)
        before, now = now, moving + gain * (path[at] - sample[1])
        current, q, theta_dot, theta = sample
        rows[at] = current, q, theta_dot, theta, now
    names = tuple(str(i) for i in range(n))
    time_s: Vector = period_s * np.arange(len(path), dtype=np.float64)
    return MotionLog(names, time_s, *(rows[:, c] for c in range(5)))


def random_rotors(job: tuple[int, int]) -> Rotors:
    """Rotors of one arm; job: its number and a seed."""
    return rotors(random_drives(*job))


def targets(found: list[Rotors]) -> list[Target]:
    """Targets of the project."""
    ramps = [one for one in found if one.drives.reaching.way == "ramps"]
    refused = [1.0 - float(one.given.mean()) for one in ramps]
    return [
        Target("rotors that are given and off by over 1.5 times their stated interval",
               sum(one.wrong for one in found), 0, "", "lower"),
        Target("rotors not given, of drives that ramp", 100.0 * float(np.mean(refused)), 10, "%",
               "lower"),
    ]  # fmt: skip


def data(found: list[Rotors]) -> dict[str, dict[str, float]]:
    """Numbers behind the targets, by the way that drives follow."""
    table: dict[str, dict[str, float]] = {}
    for way in WAYS:
        own = [one for one in found if one.drives.reaching.way == way]
        if own:
            error, half, given = (
                np.concatenate([getattr(one, name) for one in own])
                for name in ("error", "half", "given")
            )
            table[way] = {
                "rotors": len(given),
                "given": int(given.sum()),
                "wrong": sum(one.wrong for one in own),
                "median_error_percent": round(100.0 * float(np.median(np.abs(error))), 1),
                "worst_error_given_percent": round(
                    100.0 * float(np.abs(error[given]).max(initial=0.0)), 1
                ),
                "median_half_interval_given_percent": round(
                    100.0 * float(np.median(half[given])) if given.any() else 0.0, 1
                ),
            }
    return table
