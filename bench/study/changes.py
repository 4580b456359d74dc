"""Changes other than pushes that a working arm meets: rubbing, leaning, a pull at one place, stiff
friction, a load in the gripper, or losses on the bus.

Each is a torque on the links depending on the plant's motion, an action on the plant, or missing
samples. All are below the stated level of their joint.
"""

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from common.arrays import Vector
from daemon.config.schema import Configuration

Kind = Literal[
    "rub", "rub one way", "rub with the motion", "lean", "friction", "rest", "spring", "load",
    "losses",
]  # fmt: skip
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
BY_PERSON: Final = frozenset({"rub", "rub one way", "rub with the motion", "lean"})
"""Kinds whose contacts are not false."""
LASTING: Final = frozenset({"friction", "rest"})  # permanent changes

SIZES: Final = (0.2, 0.9)  # of the stated level
TIMES_S: Final = (60.0, 420.0)
LEANS_S: Final = (60.0, 1200.0)
RESTS_S: Final = (120.0, 300.0)
FACTORS: Final = (0.5, 2.0)  # friction after a step, over the identified one
GROWN: Final = 1.5  # friction after a rest, over that before, within FACTORS
LOST: Final = 0.01  # of the samples of each joint
SPRING_RAD: Final = 0.15  # from where a spring begins to pull to its largest force
JOINTS: Final = (0, 1, 2, 3)
SMOOTH: Final = 0.02  # [rad/s]


@dataclass(frozen=True, slots=True)
class Change:
    """One change of one joint."""

    kind: Kind
    joint: int
    torque: float  # signed maximum [Nm]; for friction, its factor
    seconds: float
    place: float = 0.0  # of a spring, from the middle of the joint's swing [rad]

    def torques(self, velocity: Vector, q: Vector, middle: Vector) -> Vector:
        """Torque (n,) [Nm] of rubbing, leaning or pulling, from the links' motion."""
        i, out = self.joint, np.zeros(len(q))
        along = float(np.tanh(velocity[i] / SMOOTH))
        match self.kind:
            case "rub":
                out[i] = -abs(self.torque) * along
            case "rub one way":
                out[i] = -abs(self.torque) * max(along * np.sign(self.torque), 0.0)
                out[i] *= np.sign(self.torque)
            case "rub with the motion":
                out[i] = abs(self.torque) * along
            case "lean":
                out[i] = self.torque
            case "spring":
                stretch = np.sign(self.torque) * (middle[i] + self.place - q[i])
                out[i] = self.torque * float(np.clip(stretch / SPRING_RAD, 0.0, 1.0))
            case _:
                pass
        return out


def draw(kind: Kind, c: Configuration, seed: int) -> Change:
    """Change of this kind, reproducible by its seed."""
    rng = np.random.default_rng((seed, 70))
    joint = int(rng.choice(JOINTS))
    level = c.joints[joint].thresholds.contact
    torque = float(level * rng.uniform(*SIZES) * rng.choice((-1.0, 1.0)))
    seconds = float(np.exp(rng.uniform(*np.log(LEANS_S if kind == "lean" else TIMES_S))))
    place = float(rng.uniform(-0.1, 0.1))
    if kind == "friction":
        torque = float(np.exp(rng.uniform(*np.log(FACTORS))))
    if kind == "rest":
        seconds, torque = float(rng.uniform(*RESTS_S)), GROWN
    return Change(kind, joint, torque, seconds, place)


def begin(change: Change, on: ArmInTheLoop) -> None:
    """Begin a change that is not a torque."""
    n, plant = len(on.drives.names), on.harness.plant
    if change.kind in LASTING:
        identified = on.tick.estimator.transmission.engaged_coulomb
        before = plant.coulomb.sum(axis=0) / np.maximum(identified, 1e-6)
        if change.kind == "rest":
            factor = np.minimum(change.torque, np.maximum(FACTORS[1] / before, 1.0))
        else:
            factor = np.ones(n)
            factor[change.joint] = change.torque / before[change.joint]
        plant.scale_friction(factor)
    if change.kind == "load":
        plant.carry(_mass(change, on))


def end(change: Change, on: ArmInTheLoop) -> None:
    """End the change, unless it is permanent."""
    if change.kind == "load":
        on.harness.plant.carry(0.0)
    on.drives.lost[:] = False


def lose(change: Change, on: ArmInTheLoop, rng: np.random.Generator) -> None:
    """Lose samples of this tick."""
    if change.kind == "losses":
        on.drives.lost[:] = rng.random(len(on.drives.names)) < LOST


def _mass(change: Change, on: ArmInTheLoop) -> float:
    """Mass [kg] that no joint shows beyond this share of its stated level, wherever it swings."""
    plant, c = on.harness.plant, on.robot.configuration
    rng = np.random.default_rng(73)
    reach = np.array([c.trajectory.sinusoids[name].amplitude for name in c.joint_names])
    poses = plant.q + 2.0 * rng.uniform(-1.0, 1.0, (200, len(reach))) * reach
    before = np.array([plant.weight(q) for q in poses])
    plant.carry(1.0)
    per_kg = np.abs(np.array([plant.weight(q) for q in poses]) - before).max(axis=0)
    plant.carry(0.0)
    level = np.array([joint.thresholds.contact for joint in c.joints])
    share = abs(change.torque) / level[change.joint]
    return float(share * np.min(level / np.maximum(per_kg, 1e-6)))
