"""Arm that is not the model's: two masses per joint, its drives' loops and sensors, no bus."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission
from simulator.description import ArmDescription, JointDescription, Mismatch, SimulationSettings
from simulator.mismatch import true_parameters
from simulator.plant import Plant
from simulator.profile import PROFILE
from simulator.sensors import Sensors
from simulator.servo import SERVO_PERIOD_S, Servo

CONFIGS = Path(__file__).parents[2] / "configs"
ROMEO = CONFIGS / "romeo_left_arm" / "arm.urdf"
PERIOD = 0.01
JOINTS = (
    *("LShoulderPitch", "LShoulderYaw", "LElbowRoll", "LElbowYaw"),
    *("LWristRoll", "LWristYaw", "LWristPitch"),
)
ALPHA = np.array([0.018, 0.025, 0.003, 0.011, 0.0, 0.0, 0.023])
CONTACT = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
COULOMB = np.array([0.9, 0.7, 0.4, 0.35, 0.12, 0.05, 0.04])
VISCOUS = np.array([0.6, 0.4, 0.2, 0.15, 0.05, 0.02, 0.02])
TORQUE_CONSTANT = np.array([4.77, 3.01, 3.09, 2.51, 1.81, 1.44, 1.0])
ROTOR = np.array([0.08, 0.06, 0.03, 0.025, 0.008, 0.003, 0.003])
GEAR = np.array([150.0, 150.0, 100.0, 100.0, 100.0, 80.0, 80.0])
RATED = np.array([2.0, 1.5, 1.2, 1.2, 0.6, 0.3, 0.3])
HOME = np.array([0.3, 0.3, 0.0, -0.8, -1.2, 0.0, 0.0])
WRONG = Mismatch(
    mass=5, center_of_mass=5, friction=20, torque_constant=3, half_gap=10, rotor_inertia=10
)

Reference = Callable[[float], tuple[np.ndarray, np.ndarray]]
"""Desired q and q_dot at a time."""
Push = Callable[[float], np.ndarray]
"""External torque at a time."""


@dataclass(frozen=True)
class Recording:
    """Samples of every tick, as the drives report them, and the truth beside them."""

    current: np.ndarray
    q: np.ndarray
    theta_dot: np.ndarray
    theta: np.ndarray
    true_phi: np.ndarray
    true_external: np.ndarray

    def replay(self, estimator: Estimator, ticks: slice = slice(None)) -> list[Estimate]:
        rows = zip(
            self.current[ticks],
            self.q[ticks],
            self.theta_dot[ticks],
            self.theta[ticks],
            strict=True,
        )
        return [estimator.step(*row, PERIOD) for row in rows]


def describe() -> ArmDescription:
    model = pin.buildModelFromUrdf(str(ROMEO))
    joints = tuple(
        JointDescription(
            name=name, node=i + 1, gear=GEAR[i], rated_current_A=RATED[i],
            max_current_A=2 * RATED[i], torque_constant=TORQUE_CONSTANT[i],
            rotor_inertia=ROTOR[i], half_gap=ALPHA[i],
            motor_coulomb=COULOMB[i], motor_viscous=VISCOUS[i],
            link_coulomb=0.1 * COULOMB[i], link_viscous=0.1 * VISCOUS[i],
            lower=model.lowerPositionLimit[i], upper=model.upperPositionLimit[i],
            initial_position=HOME[i],
        )
        for i, name in enumerate(JOINTS)
    )  # fmt: skip
    return ArmDescription(urdf=ROMEO, eds=ROMEO.with_name("drive.eds"), joints=joints)


def record(
    seconds: float, reference: Reference, push: Push | None = None, **settings: object
) -> Recording:
    """Let the arm follow `reference` by a proportional loop on its links, 8 /s."""
    description = describe()
    options = SimulationSettings(**{"mismatch": WRONG, **settings})
    parameters = true_parameters(description, options)
    plant = Plant(parameters, options.step_s, options.law)
    model = pin.buildModelFromUrdf(str(ROMEO))
    inertia = np.diag(pin.crba(model, model.createData(), HOME))
    plant.place(reference(0.0)[0])
    servo = Servo(description, inertia)
    sensors = Sensors(description, options, plant.q)
    for joint in range(len(JOINTS)):
        servo.energise(joint, 0.0)
    inner = round(SERVO_PERIOD_S / options.step_s)
    ticks = round(seconds / PERIOD)
    rows = {name: np.zeros((ticks, 7)) for name in Recording.__dataclass_fields__}
    for k in range(ticks):
        t = k * PERIOD
        for _ in range(round(PERIOD / SERVO_PERIOD_S)):
            servo.update(plant.theta_dot)
            plant.motor_torque[:] = parameters.torque_constant * servo.current
            if push is not None:
                plant.external_torque[:] = push(t)
            t += SERVO_PERIOD_S
            plant.advance(inner)
            sensors.update(plant.q, servo.current)
        readings = sensors.read(plant.q, plant.theta, plant.theta_dot)
        rows["current"][k] = np.array(readings.current) * PROFILE.effort_unit * RATED
        rows["q"][k] = np.array(readings.link_position) * (2 * np.pi / PROFILE.link_counts)
        rows["theta_dot"][k] = (
            np.array(readings.motor_velocity) * PROFILE.measured_velocity_unit / GEAR
        )
        rows["theta"][k] = (
            np.array(readings.motor_position) * (2 * np.pi / PROFILE.motor_counts) / GEAR
        )
        rows["true_phi"][k] = plant.phi
        rows["true_external"][k] = plant.external_torque
        q_d, qd_d = reference(t)
        for joint, velocity in enumerate(qd_d + 8.0 * (q_d - rows["q"][k])):
            servo.follow(joint, velocity, PERIOD)
    return Recording(**rows)


def sines(amplitude: float = 0.3, still_s: float = 0.0) -> Reference:
    """All joints on sines of different periods around HOME, eased in after `still_s`."""
    omega = 2 * np.pi / np.array([7.0, 5.3, 4.1, 6.1, 3.7, 4.7, 3.1])

    def reference(t: float) -> tuple[np.ndarray, np.ndarray]:
        t = max(t - still_s, 0.0)
        ease, rate = (t * t / 4, t / 2) if t < 2 else (1.0, 0.0)
        sine, cosine = np.sin(omega * t), np.cos(omega * t)
        q = HOME + amplitude * ease * sine
        return q, amplitude * (ease * omega * cosine + rate * sine)

    return reference


def transmission(**changes: object) -> Transmission:
    values = {
        "joints": JOINTS, "torque_constant": TORQUE_CONSTANT, "rotor_inertia": ROTOR,
        "half_gap": ALPHA, "motor_coulomb": COULOMB, "motor_viscous": VISCOUS,
        "link_coulomb": 0.1 * COULOMB, "link_viscous": 0.1 * VISCOUS, **changes,
    }  # fmt: skip
    return Transmission(**values)


def estimator(**settings: object) -> Estimator:
    """That of the Romeo arm; it does not learn unless it is asked to."""
    settings = {"learning": False, **settings}
    return Estimator(
        Model(ROMEO, JOINTS),
        transmission(),
        EstimatorSettings(**settings),
        Thresholds(CONTACT, 6 * CONTACT),
        PERIOD,
    )


@pytest.fixture(scope="session")
def sine_motion() -> Recording:
    """25 s of contact-free motion of all joints of an arm that is not quite the model's."""
    return record(25.0, sines(), seed=1)


@pytest.fixture(scope="session")
def drifting_motion() -> Recording:
    """The same with a motor velocity that is 0.2 % and 1 mrad/s off."""
    return record(25.0, sines(), seed=1, velocity_scale_error=0.002, velocity_bias=0.001)


@pytest.fixture(scope="session")
def pushed_motion() -> Recording:
    """The same motion; after 8 s every joint is pushed by twice its threshold, for ever."""
    return record(12.0, sines(), lambda t: 2 * CONTACT * (t >= 8.0), seed=1)


@pytest.fixture
def make_estimator() -> Callable[..., Estimator]:
    return estimator


@pytest.fixture
def make_transmission() -> Callable[..., Transmission]:
    return transmission


@pytest.fixture
def romeo() -> Model:
    return Model(ROMEO, JOINTS)


@pytest.fixture
def romeo_urdf() -> Path:
    return ROMEO
