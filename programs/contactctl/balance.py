"""Balance of the gains K_a: gains with which each joint asks for the same force at the hand.

Led at a joint speed w, a joint pushes back with its threshold and w / K_a. At the hand that is a
force

    F_i(q) = (threshold_i + w / K_i) / l_i(q)        l_i = |J_i(q)|, the lever of joint i

and the joint with the smallest force moves first: with one gain for all, joints with short levers
fold to their limits while those with long ones stand. The joint that must require the largest force
therefore sets the force for all others. Levers differ from pose to pose, and a gain does not: F is
the same where each lever is longest, and more where it is shorter. Balanced at shorter levers, the
largest force of all poses would be as many times the smallest, and every joint heavier. No gain
exceeds the one that a stiff hand and the joint's inertia allow.
"""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector
from daemon.protocol.bounds import MAX_GAIN

# Typical joint speed at which a person leads an arm [rad/s].
LEADING_RAD_S = 0.25
# Stiffness of a stiff hand, and largest product of K_a and its stiffness at a joint: a third of the
# one at which the arm trembles in it (docs/admittance.md).
HAND_N_M, FIRMEST_1_S = 1500.0, 25.0
# Least lever: a hand holds a joint by more than one point [m].
GRIP_M = 0.08
# Time constant below which a virtual mass has no effect [s].
NO_MASS_S = 0.005
# Percentiles of the levers over all poses for the shortest and the longest [%].
USUAL = (5.0, 95.0)


@dataclass(frozen=True, slots=True)
class Balance:
    """Gains, and the levers that they were found for; each (n,)."""

    gain: Vector  # K_a [rad/s per Nm]
    shortest: Vector  # lever [m]
    longest: Vector  # lever [m]


def levers(jacobians: Matrix) -> Matrix:
    """Lever (poses, n) [m] of each joint about the hand, from its Jacobians (poses, 3, n); at least
    GRIP_M."""
    long: Matrix = np.maximum(np.linalg.norm(jacobians, axis=1), GRIP_M)
    return long


def balanced(lever: Matrix, threshold: Vector, inertia: Vector, virtual_mass_s: Vector) -> Balance:
    """Gains that ask for one force at the hand.

    lever: (poses, n) [m]; threshold: (n,) [Nm]; inertia: (n,) [kg m2] of link and rotor; the
    virtual mass (n,) [s] as its time constant: as a mass it is virtual_mass_s / K_a, and with one
    below its real mass a joint would have to push its own links into the hand.
    """
    shortest, longest = np.percentile(lever, USUAL, axis=0)
    most = np.minimum(FIRMEST_1_S / (HAND_N_M * lever.max(axis=0) ** 2), MAX_GAIN)
    light = np.where(virtual_mass_s > NO_MASS_S, virtual_mass_s / inertia, np.inf)
    most = np.minimum(most, light)
    force = float(((threshold + LEADING_RAD_S / most) / longest).max())
    gain = LEADING_RAD_S / (force * longest - threshold)
    return Balance(_three_digits(gain), shortest, longest)


def _three_digits(values: Vector) -> Vector:
    """Values rounded to three digits, for typing."""
    return np.array([float(f"{value:.3g}") for value in values.tolist()])


def leading_torque(gain: Vector, threshold: Vector) -> Vector:
    """Torque (n,) [Nm] at which a joint is led at LEADING_RAD_S; infinite without a gain."""
    with np.errstate(divide="ignore"):
        torque: Vector = threshold + LEADING_RAD_S / gain
    return torque
