"""Balance of the gains K_a: gains with which each joint requires the same force at the hand.

A joint that is led at speed w resists with its threshold plus w / K_a, at the hand with the force

    F_i(q) = (threshold_i + w / K_i) / l_i(q)        l_i = |J_i(q)|, the lever of joint i

The joint that requires the smallest force moves first: with equal gains, joints with short levers
fold to their limits while those with long ones stand. The joint whose force cannot be reduced
further therefore sets the force of all. Levers vary with the pose, gains do not: F is equal where
each lever is longest, and larger where it is shorter. Balancing at shorter levers would not reduce
the ratio of the largest force to the smallest, and would make every joint heavier. No gain exceeds
what a stiff hand and the joint's inertia allow.
"""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector
from daemon.protocol.bounds import MAX_GAIN

# Typical joint speed at which a person leads an arm [rad/s].
LEADING_RAD_S = 0.25
# Stiffness of a stiff hand [N/m], and largest product of K_a and its stiffness at a joint [1/s]: a
# third of the one at which the arm oscillates against it (docs/admittance.md).
HAND_N_M, FIRMEST_1_S = 1500.0, 25.0
# Least lever: a hand grips a joint at more than one point [m].
GRIP_M = 0.08
# Time constant below which a virtual mass has no effect [s].
NO_MASS_S = 0.005
# Percentiles, over all poses, that define the shortest and the longest lever [%].
USUAL = (5.0, 95.0)


@dataclass(frozen=True, slots=True)
class Balance:
    """Gains, and the levers that they are based on; each (n,)."""

    gain: Vector  # K_a [rad/s per Nm]
    shortest: Vector  # lever [m]
    longest: Vector  # lever [m]


def levers(jacobians: Matrix) -> Matrix:
    """Lever (poses, n) [m] of each joint at the hand, from Jacobians (poses, 3, n); at least
    GRIP_M."""
    found: Matrix = np.maximum(np.linalg.norm(jacobians, axis=1), GRIP_M)
    return found


def balanced(lever: Matrix, threshold: Vector, inertia: Vector, virtual_mass_s: Vector) -> Balance:
    """Gains with which all joints require one force at the hand.

    lever: (poses, n) [m]; threshold: (n,) [Nm]; inertia: (n,) [kg m2] of link and rotor;
    virtual_mass_s: (n,) [s], a time constant. The virtual inertia is virtual_mass_s / K_a; it must
    not be below the real one, or a joint would have to push its own links into the hand.
    """
    shortest, longest = np.percentile(lever, USUAL, axis=0)
    most = np.minimum(FIRMEST_1_S / (HAND_N_M * lever.max(axis=0) ** 2), MAX_GAIN)
    light = np.where(virtual_mass_s > NO_MASS_S, virtual_mass_s / inertia, np.inf)
    most = np.minimum(most, light)
    force = float(((threshold + LEADING_RAD_S / most) / longest).max())
    gain = LEADING_RAD_S / (force * longest - threshold)
    return Balance(_three_digits(gain), shortest, longest)


def _three_digits(values: Vector) -> Vector:
    """Values rounded to three significant digits, so that they can be typed."""
    return np.array([float(f"{value:.3g}") for value in values.tolist()])


def leading_torque(gain: Vector, threshold: Vector) -> Vector:
    """Torque (n,) [Nm] that leads a joint at LEADING_RAD_S; infinite for a gain of 0."""
    with np.errstate(divide="ignore"):
        torque: Vector = threshold + LEADING_RAD_S / gain
    return torque
