"""Transmission of each joint: a gear with a gap, the rotor behind it, and friction on both sides.

phi = q - theta; the link is free while |phi| < alpha. The equations are those of the paper, with
its misprints corrected and with the rotor's inertia, which the paper omits. The functions on arrays
here serve the identification; a tick computes friction in `torques.py` and `stiction.py`.
"""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector, check_shapes
from common.errors import ModelError
from estimator.play import put_play

REST_VELOCITY = 0.05  # [rad/s]
CREEP = 0.003
"""[rad/s]; a slower motor velocity may be noise and bias, and its integral meaningless"""
LINK_REST = 0.01
"""[rad/s]; a link encoder's noise stays below it"""

STICTION_ERROR = 0.3
"""Error of an identified stiction share."""

LEAST_LOAD_ERROR = 0.005
"""Error of friction per transmitted torque that always remains."""

_SCALARS = ("joints", "sign_width")
_SHARES = ("least_stiction", "most_stiction", "load_friction", "load_friction_error")
_SIGNED = ("contact_stiffness", "contact_damping")


@dataclass(frozen=True, slots=True, kw_only=True)
class Transmission:
    """Joint parameters at the link side: read-only arrays of shape (n,); a single number applies to
    all.

    Friction of the rotor's side and of the link's side are kept apart. While engaged both act, and
    an identification sees their sum, K_theta = motor + link.

    Raises ModelError naming field and joint if a value is not finite or out of range.
    """

    joints: tuple[str, ...]
    torque_constant: Vector
    """K_c [Nm/A], > 0"""
    rotor_inertia: Vector
    """B [kg m2], reflected through the gear, >= 0"""
    half_gap: Vector
    """alpha [rad], >= 0"""
    motor_coulomb: Vector
    """[Nm], >= 0; acts on the rotor's side"""
    motor_viscous: Vector
    """[Nm s/rad], >= 0"""
    link_coulomb: Vector
    """K_q_s [Nm], >= 0; acts on the link alone"""
    link_viscous: Vector
    """K_q_v [Nm s/rad], >= 0"""
    gap_coulomb: Vector = field(default_factory=lambda: np.array(0.0))
    """K_phi_s [Nm], >= 0; acts between rotor and link inside the gap"""
    gap_viscous: Vector = field(default_factory=lambda: np.array(0.0))
    """K_phi_v [Nm s/rad], >= 0"""
    least_stiction: Vector = field(default_factory=lambda: np.array(0.0))
    """Least share of Coulomb friction that, near rest, the last motion left; 0 ... 1"""
    most_stiction: Vector = field(default_factory=lambda: np.array(1.0))
    """largest such share, >= least_stiction"""
    load_friction: Vector = field(default_factory=lambda: np.array(0.0))
    """Coulomb friction per torque that the gear transmits; 0 ... 1"""
    load_friction_error: Vector = field(default_factory=lambda: np.array(0.0))
    """uncertainty of that; 0 if it was not identified"""
    contact_stiffness: Vector = field(default_factory=lambda: np.array(0.0))
    """K_phi_p [Nm/rad]: a fit's correction on top of tau_M, not the gear's stiffness; any sign"""
    contact_damping: Vector = field(default_factory=lambda: np.array(0.0))
    """K_phi_d [Nm s/rad]: likewise"""
    sign_width: float = 0.02
    """[rad/s], > 0: velocity over which Coulomb friction changes its sign"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints))
        if not np.isfinite(self.sign_width) or self.sign_width <= 0.0:
            raise ModelError(f"sign_width is {self.sign_width}; it must be > 0 rad/s")
        for each in fields(self):
            if each.name not in _SCALARS:
                object.__setattr__(self, each.name, self._checked(each.name))
        for name in _SIGNED:
            self._refuse(name, (self.half_gap == 0.0) & (getattr(self, name) != 0.0), "0 (no gap)")
        less = self.most_stiction < self.least_stiction
        self._refuse("most_stiction", less, ">= least_stiction")

    @property
    def n(self) -> int:
        return len(self.joints)

    @property
    def engaged_coulomb(self) -> Vector:
        """K_theta_s [Nm]"""
        return self.motor_coulomb + self.link_coulomb

    def play(self, phi: Vector, sigma: Vector) -> Vector:
        """Distance that each link may fall downwards and upwards while its motor stands, (2, n)
        [rad]: alpha + phi and alpha - phi, plus the uncertainty `sigma` of phi, at most the gap."""
        check_shapes(self.half_gap.shape, phi=phi, sigma=sigma)
        way = np.empty((2, self.n))
        put_play(self.half_gap, phi, sigma, way)
        return way

    def _checked(self, name: str) -> Vector:
        try:
            values: Vector = np.array(getattr(self, name), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ModelError(f"{name}: not numbers: {getattr(self, name)}") from error
        if values.ndim == 0:
            values = np.full(self.n, values)
        if values.shape != (self.n,):
            raise ModelError(
                f"{name} has shape {values.shape}; it must be ({self.n},), one per joint"
            )
        object.__setattr__(self, name, values)
        if name in _SIGNED:
            self._refuse(name, ~np.isfinite(values), "finite")
        elif name in _SHARES:
            self._refuse(name, ~((values >= 0.0) & (values <= 1.0)), ">= 0 and <= 1")
        elif name == "torque_constant":
            self._refuse(name, ~(np.isfinite(values) & (values > 0.0)), "> 0")
        else:
            self._refuse(name, ~(np.isfinite(values) & (values >= 0.0)), ">= 0")
        values.setflags(write=False)
        return values

    def _refuse(self, name: str, bad: NDArray[np.bool_], allowed: str) -> None:
        for i in np.flatnonzero(bad):
            value = getattr(self, name)[i]
            raise ModelError(f"{name} of {self.joints[i]} is {value}; it must be {allowed}")


def stiction_range(share: float | None) -> tuple[float, float]:
    """Least and most stiction of a joint, given its identified share, or None without one. The fit
    assumes one pre-sliding distance, and finds half of the share if the true one differs."""
    if share is None:
        return 0.0, 1.0
    return max(share - STICTION_ERROR, 0.0), min(2.0 * share + STICTION_ERROR, 1.0)


def load_range(interval: tuple[float, float] | None) -> tuple[float, float]:
    """Friction per transmitted torque, and its error, of a joint: of the identified interval, or
    0."""
    if interval is None:
        return 0.0, 0.0
    least, most = interval
    return 0.5 * (least + most), max(0.5 * (most - least), LEAST_LOAD_ERROR)


def smooth_sign(velocity: Vector, width: float) -> Vector:
    """tanh(velocity / width): a sign function without chatter at rest."""
    sign: Vector = velocity * (1.0 / width)
    return np.tanh(sign, out=sign)


def resting(velocity: Vector) -> Vector:
    """exp(-(velocity / 0.05)^2): 1 at rest, where Coulomb friction may have any value; else 0."""
    at_rest = velocity * (1.0 / REST_VELOCITY)
    at_rest *= -at_rest
    return np.exp(at_rest, out=at_rest)


def penetration(phi: Vector, half_gap: Vector) -> Vector:
    """delta = phi - sign(phi) alpha beyond the border of the gap, zero inside [rad]."""
    return phi - np.minimum(np.maximum(phi, -half_gap), half_gap)


def coulomb_viscous(coulomb: Vector, viscous: Vector, velocity: Vector, width: float) -> Vector:
    """Friction coulomb * sign(velocity) + viscous * velocity [Nm], positive along the velocity."""
    friction = smooth_sign(velocity, width)
    friction *= coulomb
    friction += viscous * velocity
    return friction
