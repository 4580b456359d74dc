"""Random single joints for the gap without a hand, and the search over many of them at once.

Gears of 300 to 4000 Nm/rad, half-gaps of 1 to 100 mrad, gravity of 0 to 15 Nm, friction that
sticks, weak wrists, encoders with errors that repeat with a turn; every second joint has no
position of its motor. The URDF has its balance up to 60 mrad elsewhere.

A joint is observable where its link meets both borders: gravity changes side within its range (or
does not act), and a gap is there to be seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pinocchio as pin

from bench.rigs.arm_batch import joined, record_fleet
from common.arrays import Matrix, Vector
from identification.gap_result import GapResult
from identification.gap_search import Search, Strokes, search
from identification.motion_log import MotionLog
from programs.identify.motions import strokes
from simulator.description import ArmDescription, JointDescription, SimulationSettings
from simulator.mismatch import PlantParameters

PERIOD_S = 0.01
GUESS = 0.01
"""Half-gap that every configuration guesses [rad]."""
_LEVER, _G = 0.3, 9.81


@dataclass(frozen=True, slots=True)
class Joint:
    """One plant, what the URDF says of it, and what its encoders add."""

    plant: PlantParameters
    description: JointDescription
    gravity: float
    """largest [Nm]; as sin(q - believed) by the URDF, sin(q) in truth"""
    believed: float
    lower: float
    upper: float
    link_error: Matrix
    """(orders, 2): amplitude [rad] and phase"""
    motor_error: Matrix
    has_motor_position: bool

    @property
    def half_gap(self) -> float:
        return float(self.plant.half_gap[0])

    @property
    def observable(self) -> bool:
        """True where gravity changes side within the range, or does not act."""
        balances = (0.0, np.pi)
        inside = [self.lower + 0.3 < q < self.upper - 0.3 for q in balances]
        return self.gravity == 0.0 or any(inside)


def random_joint(rng: np.random.Generator, settings: SimulationSettings) -> Joint:
    """One joint of the population."""

    def log_uniform(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    weak = rng.random() < 0.25
    gravity = (
        0.0 if rng.random() < 0.25 else float(rng.uniform(*((0.05, 0.3) if weak else (0.3, 15))))
    )
    coulomb = float(rng.uniform(*((0.02, 0.15) if weak else (0.1, 0.4))))
    coulomb += 0.06 * gravity * float(rng.uniform(0.5, 1.5))
    link_coulomb = coulomb * float(rng.uniform(0.1, 0.6))
    mass = gravity / (_G * _LEVER)
    bare = log_uniform(*((0.002, 0.005) if weak else (0.01, 0.05)))
    inertia = mass * _LEVER**2 * 1.2 + bare
    # Less, and the drive's velocity loop, tuned to both, would swing inside the gap.
    rotor = inertia * log_uniform(0.2, 1.0)
    light = inertia * rotor / (inertia + rotor)
    stiffness = min(log_uniform(300.0, 4000.0), light * (0.35 / settings.step_s) ** 2)
    damping = min(0.6 * np.sqrt(stiffness * light), 0.3 * light / settings.step_s)
    kind = rng.random()
    lower, upper = (0.5, 2.5) if kind < 0.15 else (1.6, 4.1) if kind > 0.85 else (-2.0, 2.0)
    gear = float(rng.uniform(50.0, 160.0))
    peak = 3.0 * (gravity + coulomb + link_coulomb)
    half_gap = log_uniform(0.001, 0.1)
    plant = PlantParameters(
        model=pendulum(mass, bare + 0.2 * mass * _LEVER**2),
        half_gap=np.array([half_gap]),
        rotor_inertia=np.array([rotor]),
        torque_constant=np.array([peak / 4.0]),
        coulomb=np.array([link_coulomb, coulomb]),
        viscous=np.array([0.05 * coulomb, 0.5 * coulomb]),
        stiffness=np.array([stiffness]),
        damping=np.array([damping]),
        lower=np.array([lower]),
        upper=np.array([upper]),
        initial_position=np.array([0.5 * (lower + upper)]),
        lightest_link=np.array([inertia]),
        usual_link=np.array([inertia]),
    )
    description = JointDescription(
        name="joint", node=1, gear=gear, rated_current_A=2.0, max_current_A=4.0,
        torque_constant=peak / 4.0 * float(rng.uniform(0.98, 1.02)), rotor_inertia=rotor,
        half_gap=half_gap, motor_coulomb=coulomb, motor_viscous=0.5 * coulomb,
        link_coulomb=link_coulomb, link_viscous=0.05 * coulomb, lower=lower, upper=upper,
        initial_position=0.5 * (lower + upper),
    )  # fmt: skip

    def errors() -> Matrix:
        return np.stack([rng.uniform(0.0, 0.0005 / np.sqrt(2.0), 2), rng.uniform(0.0, 6.28, 2)], 1)

    return Joint(plant, description, gravity, float(rng.uniform(-0.06, 0.06)), lower, upper,
                 errors(), errors(), bool(rng.random() < 0.5))  # fmt: skip


def pendulum(mass: float, inertia: float) -> pin.Model:
    """A link about a horizontal axis that hangs at 0."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "joint")
    body = pin.Inertia(mass, np.array([0.0, 0.0, -_LEVER]), inertia * np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return model


def searched(
    joints: Sequence[Joint], guess: float, settings: SimulationSettings
) -> list[tuple[GapResult | None, float]]:
    """Result of each joint's search, None where the URDF leaves no pose to begin with, and how long
    it moved [s]; all joints move at once, round by round."""
    starts = [begin(joint) for joint in joints]
    searches: dict[int, Search] = {}
    asked: dict[int, Strokes] = {}
    found: list[GapResult | None] = [None] * len(joints)
    lasted = [0.0] * len(joints)
    for k, (joint, start) in enumerate(zip(joints, starts, strict=True)):
        if start is None:
            continue
        room = (joint.lower + 0.02, joint.upper - 0.02)
        about = joint.description

        def gravity(pose: Vector, joint: Joint = joint) -> float:
            return joint.gravity * float(np.sin(pose[0] - joint.believed))

        searches[k] = search(0, about.torque_constant, about.gear, guess, gravity, start, room)
        asked[k] = next(searches[k])
    while asked:
        logs = _record(joints, asked, settings)
        settings = msgspec.structs.replace(settings, seed=settings.seed + 1)
        for k, log in logs.items():
            lasted[k] += float(log.time_s[-1])
            try:
                asked[k] = searches[k].send(log)
            except StopIteration as end:
                found[k] = end.value
                del asked[k]
    return list(zip(found, lasted, strict=True))


def begin(joint: Joint) -> float | None:
    """Pose [rad] in which gravity changes side by the URDF, the stable one if both are in range;
    None without one."""
    if joint.gravity == 0.0:
        return 0.5 * (joint.lower + joint.upper)
    places = (joint.believed, joint.believed + np.pi)
    inside = [q for q in places if joint.lower + 0.2 < q < joint.upper - 0.2]
    return inside[0] if inside else None


def _record(
    joints: Sequence[Joint], asked: dict[int, Strokes], settings: SimulationSettings
) -> dict[int, MotionLog]:
    """Log of each joint's strokes, all of them branches of one arm."""
    paths = {
        k: strokes(np.array([s.about]), 0, s.travel, s.speed, s.count, PERIOD_S)[:, 0]
        for k, s in asked.items()
    }
    longest = max(len(path) for path in paths.values())
    path = np.stack([np.pad(p, (0, longest - len(p)), mode="edge") for p in paths.values()], axis=1)
    speed = np.gradient(path, PERIOD_S, axis=0)

    def reference(t: float) -> tuple[Vector, Vector]:
        k = min(round(t / PERIOD_S), longest - 1)
        return path[k], speed[k]

    plant = joined([joints[k].plant for k in asked])
    arm = ArmDescription(
        urdf=Path(), eds=Path(), joints=tuple(joints[k].description for k in asked),
        period_s=PERIOD_S,
    )  # fmt: skip
    [[log]] = record_fleet(arm, [plant], reference, longest * PERIOD_S, settings, motors_only=True)
    return {k: _seen(log, place, len(paths[k]), joints[k]) for place, k in enumerate(asked)}


def _seen(log: MotionLog, place: int, length: int, joint: Joint) -> MotionLog:
    """Readings of the encoders of one joint for its part of the log."""
    rows, column = slice(0, length), slice(place, place + 1)
    assert log.motor_position is not None
    q, theta = log.link_position[rows, column], log.motor_position[rows, column]
    gear, velocity = joint.description.gear, log.motor_velocity[rows, column]
    late, changes = np.zeros_like(theta), np.zeros_like(theta)
    for order, (size, phase) in enumerate(joint.motor_error, start=1):
        angle = order * gear * theta + phase
        late, changes = late + size * np.sin(angle), changes + size * order * gear * np.cos(angle)
    for order, (size, phase) in enumerate(joint.link_error, start=1):
        q = q + size * np.sin(order * q + phase)
    return MotionLog(
        joints=("joint",),
        time_s=log.time_s[rows],
        current=log.current[rows, column],
        link_position=q,
        motor_velocity=velocity * (1.0 + changes),
        motor_position=theta + late if joint.has_motor_position else None,
    )


@dataclass(frozen=True, slots=True)
class Answer:
    """One joint: truth and what was said of it [rad], NaN without a figure."""

    half_gap: float
    observable: bool
    found: float
    confidence: float
    verdict: str
    reason: str
    lasted_s: float

    @property
    def answered(self) -> bool:
        return bool(np.isfinite(self.found))


def answers(job: tuple[int, int, int]) -> list[Answer]:
    """Search some of the joints; job: how many, a seed and the number of the job."""
    count, seed, number = job
    rng = np.random.default_rng((seed, number))
    settings = SimulationSettings(
        friction="dahl", presliding=0.0003, velocity_bias=0.0007, seed=1000 * seed + number
    )
    joints = [random_joint(rng, settings) for _ in range(count)]
    found = []
    for joint, (result, lasted_s) in zip(joints, searched(joints, GUESS, settings), strict=True):
        about = ("by hand", "gravity keeps its side within the limits")
        if result is not None:
            about = (result.verdict.value, result.reason)
        found.append(
            Answer(
                joint.half_gap,
                joint.observable,
                result.half_gap if result else np.nan,
                result.confidence if result else np.nan,
                *about,
                lasted_s,
            )
        )
    return found
