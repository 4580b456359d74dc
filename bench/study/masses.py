"""Arms whose masses and centres differ from the URDF's, and their residuals by each model: the
URDF's, the true one, and the identified one, with friction identified alike; by any drives."""

from dataclasses import dataclass, replace
from typing import Final

import msgspec
import numpy as np
import pinocchio as pin

from bench.rigs.arm_batch import Reference, Scatter, random_arm, record_fleet
from bench.rigs.lockstep import ROMEO
from bench.rigs.reaching import RAMPING, Reaching
from bench.study.estimates import rows_of
from common.arrays import Matrix, Vector
from daemon.assembly import build_estimator, build_transmission
from daemon.config.dynamics import model_of
from daemon.config.load import load_robot
from daemon.config.schema import Configuration, Friction
from daemon.config.vectors import row
from estimator.body_inertia import BodyInertia
from estimator.model import Model
from estimator.payload import Payload
from identification.friction import identify_friction
from identification.friction_fit import adopt
from identification.masses import identify_masses
from identification.motion_log import MotionLog
from identification.payload_fit import PayloadVerdict, identify_payload
from programs.identify.motions import bounds_of, excitation
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.description import Mismatch, SimulationSettings
from simulator.mismatch import PlantParameters, true_parameters

EXACT: Final = Mismatch(
    mass=0, center_of_mass=0, friction=0, torque_constant=0, half_gap=0, rotor_inertia=0
)
SETTLED_S: Final = 1.0  # The residual of a restarted estimator does not count for this time.
AWAY_M: Final = 0.03  # Largest distance of a load from the tool point along each axis.
LIGHTEST, HEAVIEST = 0.1, 0.5  # kg; the wrist holds 0.59


def wrongly_weighed(arm: PlantParameters, rng: np.random.Generator) -> PlantParameters:
    """Arm whose bodies are all heavier or lighter by a fifth, with their tensors, and whose centres
    are displaced by 20 mm in random directions."""
    model = arm.model.copy()
    for i in range(1, model.njoints):
        body, shift = model.inertias[i], rng.standard_normal(3)
        factor = 1.0 + 0.2 * rng.choice((-1.0, 1.0))
        center = body.lever + 0.02 * shift / np.linalg.norm(shift)
        model.inertias[i] = pin.Inertia(factor * body.mass, center, factor * body.inertia)
    return replace(arm, model=model)


def carrying(arm: PlantParameters, by: Model, load: Payload) -> PlantParameters:
    """Arm with a load in its hand, whose frame is that of the model `by`."""
    model = arm.model.copy()
    hand = model.njoints - 1
    point = pin.Inertia(load.mass, by.in_joint(np.array(load.com)), np.zeros((3, 3)))
    model.inertias[hand] = model.inertias[hand] + point
    return replace(arm, model=model)


def true_bodies(arm: PlantParameters) -> dict[str, BodyInertia]:
    """True bodies that the joints move, by joint."""
    model = arm.model
    return {
        model.names[i]: BodyInertia.of(model.inertias[i].toDynamicParameters())
        for i in range(1, model.njoints)
    }


def with_bodies(c: Configuration, bodies: dict[str, BodyInertia]) -> Configuration:
    """Configuration with these bodies in place of the URDF's."""
    joints = [msgspec.structs.replace(j, body=bodies.get(j.name)) for j in c.joints]
    return msgspec.structs.replace(c, joints=joints)


class Fleet:
    """The left arm of Romeo as configured, and arms that differ from it."""

    def __init__(self, arms: int, seed: tuple[int, int], scatter: Scatter) -> None:
        self.robot = load_robot(ROMEO)
        self.c = self.robot.configuration
        self.model = Model(self.robot.urdf, self.c.joint_names)
        self.max_current = row(self.c, lambda j: j.wiring.max_current_A)
        self.description = describe(self.robot, read_simulation(self.robot))
        self.rng = np.random.default_rng(seed)
        noise = int(self.rng.integers(2**31))
        self.settings = SimulationSettings(mismatch=EXACT, seed=noise)
        nominal = true_parameters(self.description, self.settings)
        self.arms = [random_arm(nominal, scatter, self.settings, self.rng) for _ in range(arms)]


class Subjects(Fleet):
    """Fleet whose masses differ from the URDF's."""

    def __init__(self, arms: int, seed: tuple[int, int], reaching: Reaching = RAMPING) -> None:
        # Torque constants are exact, as their errors cannot be distinguished from those of masses.
        scatter = Scatter(mass=1.0, center_of_mass=1.0, torque_constant=1.0, half_gap=1.0)
        super().__init__(arms, seed, scatter)
        self.reaching = reaching
        self.limits = row(self.c, lambda j: j.limits.lower), row(self.c, lambda j: j.limits.upper)
        self.arms = [wrongly_weighed(arm, self.rng) for arm in self.arms]

    def moved(
        self, arms: list[PlantParameters], seconds: float, seed: int, *turn_s: float
    ) -> list[MotionLog]:
        """Logs of an excitation of all joints; turn_s: its periods, by default the usual ones."""
        period = self.c.period_s
        motion = excitation(bounds_of(self.c), self.model, period, seed, *turn_s)
        path = motion.path(motion.motion.at(np.zeros(1))[0][0], seconds)
        return record_fleet(
            self.description, arms, along(path, period), len(path) * period, self.settings,
            reaching=self.reaching,
        )[0]  # fmt: skip

    def friction_with(self, bodies: dict[str, BodyInertia], log: MotionLog) -> Configuration:
        """Configuration with these bodies, and the friction identified with them."""
        c = with_bodies(self.c, bodies)
        old = build_transmission(c)
        fits, _ = identify_friction(
            log, model_of(c, self.robot.urdf), old, c.estimator, self.max_current
        )
        new = adopt(old, fits)
        names = [name for name in Friction.__struct_fields__ if name not in ("stiction", "load")]
        joints = [
            msgspec.structs.replace(
                joint,
                friction=Friction(
                    **{name: float(getattr(new, name)[i]) for name in names},
                    stiction=fits[i].stiction if fits[i].stiction_known else None,
                    load=fits[i].load,
                ),
                rotor_inertia=float(new.rotor_inertia[i]),
            )
            for i, joint in enumerate(c.joints)
        ]
        return msgspec.structs.replace(c, joints=joints)

    def residual(self, c: Configuration, log: MotionLog) -> Vector:
        """rms of r (n,) [Nm] of the estimator of a configuration over a log."""
        measured = np.full_like(log.current, np.nan)
        motor_position = measured if log.motor_position is None else log.motor_position
        samples = (log.current, log.link_position, log.motor_velocity, motor_position)
        estimator = build_estimator(c, model_of(c, self.robot.urdf))
        rows = rows_of(estimator, np.stack(samples, axis=1))
        counted = rows.residual[round(SETTLED_S / c.period_s) :]
        return np.asarray(np.sqrt(np.square(counted).mean(axis=0)))


def along(path: Matrix, period_s: float) -> Reference:
    """Reference along link positions (N, n) [rad] every period."""
    speed = np.gradient(path, period_s, axis=0)

    def reference(t: float) -> tuple[Vector, Vector]:
        k = min(round(t / period_s), len(path) - 1)
        return path[k], speed[k]

    return reference


@dataclass(frozen=True, slots=True)
class MassesJob:
    """Some of the arms, and the duration of motion for the identification."""

    arms: int
    seconds: float
    seed: tuple[int, int]
    reaching: Reaching = RAMPING


@dataclass(frozen=True, slots=True)
class MassesFound:
    """rms of r on held-out motion, over that with exact masses: (arms, n) each; NaN where masses
    were refused. Loads: true and found mass [kg], distance of the centres [m] and standard errors,
    (arms, 5), NaN where refused."""

    job: MassesJob
    by_urdf: Matrix
    by_identified: Matrix
    loads: Matrix
    refused: list[str]


def examine(job: MassesJob) -> MassesFound:
    """Simulate and identify."""
    subjects = Subjects(job.arms, job.seed, job.reaching)
    fitted = subjects.moved(subjects.arms, job.seconds, seed=3)
    for_friction = subjects.moved(subjects.arms, job.seconds, seed=1)
    tested = subjects.moved(subjects.arms, job.seconds, seed=2)
    by_urdf, by_found, loads, refused = [], [], [], []
    for k, arm in enumerate(subjects.arms):

        def rms(bodies: dict[str, BodyInertia], k: int = k) -> Vector:
            c = subjects.friction_with(bodies, for_friction[k])
            return subjects.residual(c, tested[k])

        masses = identify_masses(
            fitted[k], subjects.model, build_transmission(subjects.c), subjects.c.estimator,
            subjects.max_current, subjects.limits,
        )  # fmt: skip
        exact = rms(true_bodies(arm))
        by_urdf.append(rms({}) / exact)
        bodies = {fit.joint: fit.body for fit in masses.fits if fit.body is not None}
        none = np.full(len(exact), np.nan)
        by_found.append(rms(bodies) / exact if masses.usable else none)
        refused += [f"{f.joint}: {f.verdict.value}: {f.reason}" for f in masses.fits if f.reason]
        loads.append(_load(subjects, arm, bodies if masses.usable else {}))
    return MassesFound(job, np.array(by_urdf), np.array(by_found), np.array(loads), refused)


def _load(subjects: Subjects, arm: PlantParameters, bodies: dict[str, BodyInertia]) -> Vector:
    """Result of ten seconds with a random load in the hand."""
    rng = subjects.rng
    place = subjects.model.tool_place + rng.uniform(-AWAY_M, AWAY_M, 3)
    load = Payload.of(float(rng.uniform(LIGHTEST, HEAVIEST)), place.tolist())
    log = subjects.moved([carrying(arm, subjects.model, load)], 10.0, 4, 10.0, 10.0)[0]
    c = with_bodies(subjects.c, bodies)
    fit = identify_payload(
        log, model_of(c, subjects.robot.urdf), build_transmission(c), c.estimator,
        subjects.max_current, 0.01 if bodies else 0.05,
    )  # fmt: skip
    if fit.verdict is not PayloadVerdict.GOOD:
        return np.array([load.mass, *[np.nan] * 4])
    apart = float(np.linalg.norm(fit.com - place))
    return np.array([load.mass, fit.mass, apart, fit.mass_error, fit.com_error])
