"""Where the rotor is in the gap: theta, how well it is known, and which side is engaged.

Theta is the integral of the motor velocity, or follows the drive's motor position; in both cases
its offset to the link is found, and drift taken out, by the geometry of the gap:

- |phi| never exceeds alpha and the gear's deflection;
- a torque transmitted for some ticks tells the side: phi < 0 pushes the link up, phi > 0 down;
- at standstill theta is held.

The side comes from the motor's side of the gear alone (current, friction, rotor inertia), never
from the residual: a hand that moves the link to the other border of its gap is seen to do so,
and is not explained away.
"""

from enum import IntEnum
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from estimator import memory
from estimator.transmission import Transmission
from estimator.types import Vector


class Side(IntEnum):
    """Gap state of a joint; LEFT is phi = -alpha, where the rotor pushes the link upwards."""

    LEFT = -1
    GAP = 0
    RIGHT = 1
    UNKNOWN = 2


class GapSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far to trust motor velocity and torque. The defaults suit drives of two encoders."""

    velocity_scale_error: Annotated[float, Meta(ge=0, le=0.1)] = 0.002
    velocity_bias: Annotated[float, Meta(ge=0, le=0.1)] = 0.001  # [rad/s]
    standstill: Annotated[float, Meta(ge=0, le=0.1)] = 0.002  # motor velocity [rad/s]
    hold_ticks: Annotated[int, Meta(ge=1, le=100)] = 3
    margin: Annotated[float, Meta(ge=0.12, lt=1)] = 0.2  # of alpha
    friction_error: Annotated[float, Meta(ge=0, le=1)] = 0.2
    rotor_error: Annotated[float, Meta(ge=0, le=1)] = 0.15
    current_error: Annotated[float, Meta(ge=0, le=1)] = 0.05


_LINK_REST = 0.01  # [rad/s]; a link encoder's noise stays below it
_PULL = 0.2  # share of a border's error that is corrected in one tick
_UNKNOWN = np.int8(Side.UNKNOWN)
_FLOOR = 0.05  # of alpha: standard uncertainty at an engaged border


class MotorPosition:
    """Estimate of theta [rad], standard uncertainty of phi [rad] and side, each of shape (n,)."""

    _MEMORY = ("theta", "sigma", "side", "streak")

    def __init__(self, transmission: Transmission, settings: GapSettings) -> None:
        n = transmission.n
        self._t = transmission
        self._s = settings
        self._alpha = transmission.half_gap
        self._rigid = self._alpha == 0.0
        self._unknown_from = np.where(self._rigid, np.inf, self._alpha)
        self._compliance = np.where(self._rigid, 0.0, 1.0 / transmission.gear_stiffness)
        self._doubtful_coulomb = settings.friction_error * transmission.motor_coulomb
        self._doubtful_viscous = settings.friction_error * transmission.motor_viscous
        self._floor = _FLOOR * self._alpha
        self._margin = settings.margin * self._alpha
        self.theta = np.zeros(n)
        self.sigma = np.array(self._alpha)
        self.side = np.full(n, Side.UNKNOWN, dtype=np.int8)
        # Ticks in a row in which the transmitted torque clearly had one sign; signed as that.
        self.streak = np.zeros(n)

    def start(self, q: Vector) -> None:
        """Nothing is known but that phi is somewhere in the gap."""
        self.theta[:] = q
        self.sigma[:] = self._alpha
        self.side[:] = Side.UNKNOWN
        self.streak[:] = 0

    def uncertainty(
        self, tau_M: Vector, rotor: Vector, theta_dot: Vector, resting: Vector
    ) -> tuple[Vector, Vector]:
        """How wrong the torque transmitted by the gear may be [Nm]: in motion, and as it is now.

        tau_M and rotor = B theta_ddot [Nm]. They differ by `transmission.resting`: near rest
        Coulomb friction may have any value.
        """
        s = self._s
        moving = self._doubtful_viscous * np.abs(theta_dot)
        moving += self._doubtful_coulomb
        moving += s.rotor_error * np.abs(rotor)
        moving += s.current_error * np.abs(tau_M)
        return moving, moving + self._t.motor_coulomb * resting

    def step(
        self,
        q: Vector,
        qd: Vector,
        theta_dot: Vector,
        advance: Vector,
        transmitted: Vector,
        uncertainty: tuple[Vector, Vector],
        dt: float,
        *,
        measured: bool,
    ) -> NDArray[np.bool_]:
        """Advance by dt seconds; returns which joints are in their gap.

        advance: change of theta in the interval [rad], integrated or measured.
        transmitted: torque that the rotor gives to the link in the interval [Nm], and its
        `uncertainty` [Nm].
        """
        self.theta += advance if measured else self._integrated(qd, theta_dot, advance, dt)

        # A torque that may be friction does not tell the side; but it may as well be a load, and
        # dropping a load is worse than keeping a friction.
        small, doubtful = uncertainty
        load = np.abs(transmitted)
        clear = np.copysign(load > doubtful, transmitted)
        streak = self.streak
        streak *= streak * clear > 0.0
        streak += clear
        engaged = np.abs(streak) >= self._s.hold_ticks
        phi = self._correct(q, engaged, load)

        gap = np.abs(phi) < self._alpha - np.maximum(self._margin, self.sigma)
        gap &= load < small
        gap &= ~engaged
        np.copyto(phi, -transmitted, where=engaged | self._rigid)
        np.copysign(~gap, phi, out=self.side, casting="unsafe")
        np.copyto(self.side, _UNKNOWN, where=self.sigma >= self._unknown_from)
        return gap

    def _integrated(self, qd: Vector, theta_dot: Vector, advance: Vector, dt: float) -> Vector:
        """The integrated advance, none at standstill; sigma grows by the velocity's error."""
        s, speed = self._s, np.abs(theta_dot)
        moving = (speed > s.standstill) | (np.abs(qd) > _LINK_REST)
        speed *= s.velocity_scale_error * dt
        speed += s.velocity_bias * dt
        self.sigma += speed * moving
        return advance * moving

    def _correct(self, q: Vector, engaged: NDArray[np.bool_], load: Vector) -> Vector:
        """Pull phi to the engaged border, and never let it go further than the load bends the gear.

        Returns phi.
        """
        alpha, sigma = self._alpha, self.sigma
        beyond = alpha + load * self._compliance
        phi = q - self.theta
        # The torque pushes the link up where phi is at its lower border, and the other way round.
        border = np.copysign(1.0, -self.streak)
        outward = border * phi
        lowest = np.where(engaged, alpha, -beyond)
        error = border * (outward - np.minimum(np.maximum(outward, lowest), beyond))
        # What is not known at all is taken at once, what is known a little at a time.
        pull = 1.0 - (1.0 - _PULL) * (engaged & (sigma < alpha))
        np.minimum(sigma, alpha, out=sigma)
        sigma += pull * engaged * (self._floor - sigma)
        error *= pull
        self.theta += error
        phi -= error
        return phi

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
