"""Worst case of a configuration: gravity and inertia at each joint, beside what its motor gives."""

from dataclasses import dataclass

import numpy as np

from daemon.config.schema import Configuration, Joint
from estimator.model import Model

_POSES = 2000


@dataclass(frozen=True, slots=True)
class Load:
    """Worst load of one joint, at the link [Nm]."""

    gravity: float  # largest within the limits of all joints
    motor: float  # at its largest current
    inertia: float = 0.0  # of what the joint moves, largest, about its axis [kg m2]

    @property
    def too_much(self) -> bool:
        """True if the motor alone cannot hold the arm in every pose."""
        return self.gravity > self.motor


def worst_loads(c: Configuration, urdf: str) -> list[Load]:
    """Worst load of each joint: max |g_i(q)| and M_ii(q) over poses within the limits, beside K_c
    times the largest current.

    The poses are random, always the same; the true maximum is up to some per cent more.
    """
    model = Model(urdf, c.joint_names)
    lower = np.array([joint.limits.lower for joint in c.joints])
    upper = np.array([joint.limits.upper for joint in c.joints])
    span = upper - lower
    # Half of the coordinates are at a limit, where an arm that cannot reach out further is worst.
    drawn = np.random.default_rng(0).uniform(
        lower - 0.5 * span, upper + 0.5 * span, (_POSES, model.n)
    )
    poses = np.clip(drawn, lower, upper)
    gravity = np.max([np.abs(model.gravity(q)) for q in poses], axis=0)
    inertia = np.max([model.inertia(q) for q in poses], axis=0)
    return [
        Load(float(g), peak_torque(joint), float(i))
        for g, i, joint in zip(gravity, inertia, c.joints, strict=True)
    ]


def peak_torque(joint: Joint) -> float:
    """Torque of a joint's motor at its largest current [Nm at the link]."""
    return joint.torque_constant * joint.wiring.max_current_A
