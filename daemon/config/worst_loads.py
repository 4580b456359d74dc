"""Worst loads of a configuration: gravity and inertia at each joint, with and without a payload,
against the torque of its motor."""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix
from daemon.config.schema import Configuration, Joint
from estimator.model import Model
from estimator.payload import Payload

_POSES = 2000
_NO_LEVER = 1e-9  # [Nm/kg]


@dataclass(frozen=True, slots=True)
class Load:
    """Worst load of one joint, at the link [Nm]."""

    gravity: float  # largest within the limits of all joints
    motor: float  # at its largest current
    inertia: float = 0.0  # largest, of all bodies that the joint moves, about its axis [kg m2]

    @property
    def too_much(self) -> bool:
        """True if the motor alone cannot hold the arm in every pose."""
        return self.gravity > self.motor


def worst_loads(c: Configuration, model: Model) -> list[Load]:
    """Worst load of each joint: max |g_i(q)| and max M_ii(q) over poses within the limits, and the
    motor's torque, K_c times the largest current.

    The poses are random with a fixed seed; the true maximum is up to a few per cent larger.
    """
    poses = _poses(c)
    gravity = np.max([np.abs(model.gravity(q)) for q in poses], axis=0)
    inertia = np.max([model.inertia(q) for q in poses], axis=0)
    return [
        Load(float(g), peak_torque(joint), float(i))
        for g, i, joint in zip(gravity, inertia, c.joints, strict=True)
    ]


class PayloadCapacity:
    """Payload capacity of an arm: gravity at its joints in many poses, with or without a payload,
    against the largest torques of its motors."""

    def __init__(self, c: Configuration, model: Model) -> None:
        poses = _poses(c)
        self._names = c.joint_names
        self._motor = np.array([peak_torque(joint) for joint in c.joints])
        self._gravity = np.array([model.gravity(q) for q in poses])  # (poses, n)
        torques = [model.payload_torques(q, model.down) for q in poses]
        self._by_mass = np.array([one for one, _ in torques])  # (poses, n)
        self._by_place = np.array([other for _, other in torques])  # (poses, n, 3)

    def too_heavy(self, payload: Payload) -> list[str]:
        """Reasons why the motors cannot hold the arm with a payload in every pose within the
        limits: each joint that is too weak, and the mass they can hold there; empty if they can."""
        per_kg = self._by_mass + self._by_place @ np.array(payload.com)
        torque = np.abs(self._gravity - payload.mass * per_kg).max(axis=0)
        weak = [
            f"{name} would need up to {needed:.1f} Nm for {payload.mass:.3g} kg, its motor gives "
            f"{gives:.1f} Nm"
            for name, needed, gives in zip(self._names, torque, self._motor, strict=True)
            if needed > gives
        ]
        return [*weak, f"too heavy: the motors can hold {self._most(per_kg)} there"] if weak else []

    def _most(self, per_kg: Matrix) -> str:
        """Heaviest mass that the motors can hold there, as text, rounded down to 0.01 kg."""
        heaviest = self._heaviest(per_kg)
        if heaviest == np.inf:  # without a lever; the arm itself is too heavy
            return "not even the arm"
        return f"at most {0.01 * int(100.0 * heaviest):g} kg" if heaviest >= 0.01 else "nothing"

    def _heaviest(self, per_kg: Matrix) -> float:
        """Heaviest mass [kg] that the motors can hold, from its torques (poses, n) [Nm/kg];
        infinite if it has no lever at any joint."""
        room = np.maximum(self._motor - np.sign(-per_kg) * self._gravity, 0.0)
        size = np.abs(per_kg)
        return float(np.min(np.where(size > _NO_LEVER, room / np.maximum(size, _NO_LEVER), np.inf)))


def _poses(c: Configuration) -> Matrix:
    """Poses (poses, n) within the limits [rad]."""
    lower = np.array([joint.limits.lower for joint in c.joints])
    upper = np.array([joint.limits.upper for joint in c.joints])
    span = upper - lower
    # Half of the coordinates are at a limit, the worst case if the arm cannot stretch fully.
    drawn = np.random.default_rng(0).uniform(
        lower - 0.5 * span, upper + 0.5 * span, (_POSES, len(lower))
    )
    return np.clip(drawn, lower, upper)


def peak_torque(joint: Joint) -> float:
    """Torque of a joint's motor at its largest current [Nm at the link]."""
    return joint.torque_constant * joint.wiring.max_current_A
