"""Arms that differ from the nominal one, moved without contact or held while a hand moves the
links; simulated once per session."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest

from bench.rigs.arm_batch import Reference, Scatter, SoftHand, random_arm, record_fleet
from bench.rigs.lockstep import ROMEO
from daemon.assembly import build_transmission
from daemon.config.load import load_robot
from estimator.model import Model
from estimator.transmission import Transmission
from identification.excitation import Bounds, fourier_within, trajectory
from identification.motion_log import MotionLog
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.description import Mismatch, SimulationSettings
from simulator.mismatch import PlantParameters, true_parameters

EXACT = Mismatch(
    mass=0, center_of_mass=0, friction=0, torque_constant=0, half_gap=0, rotor_inertia=0
)
SAME_LINKS = Scatter(mass=1.0, center_of_mass=1.0, torque_constant=1.0)


@dataclass(frozen=True)
class Arm:
    """The nominal arm, as the configuration has it."""

    robot = load_robot(ROMEO)
    configuration = robot.configuration
    model = Model(robot.urdf, configuration.joint_names)
    transmission = build_transmission(configuration)
    description = describe(robot, read_simulation(robot))
    max_current = np.array([j.wiring.max_current_A for j in configuration.joints])

    @property
    def bounds(self) -> Bounds:
        rows = [
            (j.limits.lower, j.limits.upper, j.limits.velocity, j.limits.acceleration)
            for j in self.configuration.joints
        ]
        return Bounds(*np.array(rows).T)


@dataclass(frozen=True)
class Moved:
    """Logs of an arm with the model's inertias and of one that has others, and the truth."""

    filtered: list[MotionLog]
    unfiltered: list[MotionLog]
    arms: list[PlantParameters]


@pytest.fixture(scope="session")
def arm() -> Arm:
    return Arm()


@pytest.fixture(scope="session")
def nominal(arm) -> PlantParameters:
    return true_parameters(arm.description, SimulationSettings(mismatch=EXACT))


@pytest.fixture(scope="session")
def moved(arm, nominal) -> Moved:
    """24 s of an excitation."""
    settings = SimulationSettings(mismatch=EXACT)
    rng = np.random.default_rng(4)
    arms = [random_arm(nominal, scatter, settings, rng) for scatter in (SAME_LINKS, Scatter())]
    raw = SimulationSettings(mismatch=EXACT, current_filter_ms=0.0)
    logs = record_fleet(arm.description, arms, excited(arm), 24.0, settings, [raw])
    return Moved(logs[0], logs[1], arms)


@pytest.fixture(scope="session")
def sticking(arm, nominal) -> tuple[MotionLog, PlantParameters]:
    """16 s of it with an arm whose friction sticks."""
    # Near the pre-sliding that the fit believes: one of its own is not found.
    settings = SimulationSettings(mismatch=EXACT, friction="dahl", presliding=0.001)
    true = random_arm(nominal, SAME_LINKS, settings, np.random.default_rng(5))
    return record_fleet(arm.description, [true], excited(arm), 16.0, settings)[0][0], true


def excited(arm: Arm) -> Reference:
    motion = fourier_within(arm.bounds.shrunk(0.7), arm.model, np.random.default_rng(1))
    path = trajectory(motion, motion.at(np.zeros(1))[0][0], arm.bounds, 24.0, 0.01)
    speed = np.gradient(path, 0.01, axis=0)

    def reference(t: float) -> tuple[np.ndarray, np.ndarray]:
        k = min(round(t / 0.01), len(path) - 1)
        return path[k], speed[k]

    return reference


@pytest.fixture(scope="session")
def handled(arm, nominal) -> tuple[MotionLog, PlantParameters]:
    """17 s of a hand that leads every link from border to border of its gap and back, while the
    motors stand. Their velocity is 1 mrad/s off."""
    settings = SimulationSettings(mismatch=EXACT, velocity_bias=0.001)
    true = random_arm(nominal, Scatter(friction=1.1), settings, np.random.default_rng(8))
    q0 = np.array([joint.initial_position for joint in arm.description.joints])
    hand = SoftHand([true], q0, arm.model.gravity(q0), settings.step_s)
    still = (q0, np.zeros_like(q0))
    logs = record_fleet(
        arm.description, [true], lambda t: still, 17.0, settings, push=hand, motors_only=True
    )
    return logs[0][0], true


@pytest.fixture(scope="session")
def wound_up(arm, nominal) -> tuple[MotionLog, Model, Transmission]:
    """12 s of it with links eight times as heavy on gears of 400 Nm/rad, and what is known."""
    heavy, text = nominal.model.copy(), arm.robot.urdf
    for i in range(1, heavy.njoints):
        body = heavy.inertias[i]
        heavy.inertias[i] = pin.Inertia(8.0 * body.mass, body.lever, body.inertia)
    text = re.sub(r'<mass value="([^"]+)"', lambda m: f'<mass value="{8.0 * float(m[1])!r}"', text)
    strong, half_gap = 4.0 * nominal.torque_constant, np.full(7, 0.001)
    half_gap[1] = 0.025
    soft = np.minimum(nominal.stiffness, 400.0)
    plant = replace(nominal, model=heavy, torque_constant=strong, half_gap=half_gap, stiffness=soft)
    settings = SimulationSettings(mismatch=EXACT)
    log = record_fleet(arm.description, [plant], excited(arm), 12.0, settings)[0][0]
    known = replace(arm.transmission, torque_constant=strong, half_gap=half_gap)
    return log, Model(text, arm.configuration.joint_names), known
