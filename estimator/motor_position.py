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


_REST = 0.05  # [rad/s]; Coulomb friction below this velocity may have any value
_LINK_REST = 0.01  # [rad/s]; a link encoder's noise stays below it
_PULL = 0.2  # share of a border's error that is corrected in one tick
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
        self._floor = _FLOOR * self._alpha
        self._margin = settings.margin * self._alpha
        self.theta = np.zeros(n)
        self.sigma = np.array(self._alpha)
        self.side = np.full(n, Side.UNKNOWN, dtype=np.int8)
        # Ticks in a row in which the transmitted torque clearly had one sign; signed as phi.
        self.streak = np.zeros(n, dtype=np.int64)

    def start(self, q: Vector) -> None:
        """Nothing is known but that phi is somewhere in the gap."""
        self.theta[:] = q
        self.sigma[:] = self._alpha
        self.side[:] = Side.UNKNOWN
        self.streak[:] = 0

    def uncertainty(self, tau_M: Vector, rotor: Vector, theta_dot: Vector) -> tuple[Vector, Vector]:
        """How wrong the torque transmitted by the gear may be [Nm]: in motion, and as it is now.

        tau_M and rotor = B theta_ddot [Nm]. They differ near rest, where Coulomb friction may have
        any value.
        """
        t, s = self._t, self._s
        friction = t.motor_coulomb + t.motor_viscous * np.abs(theta_dot)
        moving = s.friction_error * friction
        moving += s.rotor_error * np.abs(rotor) + s.current_error * np.abs(tau_M)
        w = theta_dot / _REST
        return moving, moving + t.motor_coulomb * np.exp(-w * w)

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
    ) -> None:
        """Advance by dt seconds.

        advance: change of theta in the interval [rad], integrated or measured.
        transmitted: torque that the rotor gives to the link in the interval [Nm], and its
        `uncertainty` [Nm].
        """
        s, alpha = self._s, self._alpha
        if not measured:
            speed = np.abs(theta_dot)
            moving = (speed > s.standstill) | (np.abs(qd) > _LINK_REST)
            advance = np.where(moving, advance, 0.0)
            self.sigma += np.where(moving, s.velocity_scale_error * speed + s.velocity_bias, 0) * dt
        self.theta += advance

        # A torque that may be friction does not tell the side; but it may as well be a load, and
        # dropping a load is worse than keeping a friction.
        small, doubtful = uncertainty
        clear = (transmitted < -doubtful).astype(np.int64) - (transmitted > doubtful)
        self.streak[:] = np.where(clear * self.streak > 0, self.streak + clear, clear)
        engaged = np.abs(self.streak) >= s.hold_ticks
        border = np.sign(self.streak)
        load = np.abs(transmitted)
        self._correct(q, engaged, border, load)

        phi = q - self.theta
        free = np.abs(phi) < alpha - np.maximum(self._margin, self.sigma)
        unknown = self.sigma >= alpha
        self.side[:] = np.where(free & (load < small), Side.GAP, np.where(phi < 0, -1, 1))
        self.side[unknown] = Side.UNKNOWN
        np.copyto(self.side, border, where=engaged, casting="unsafe")
        self._couple(q, transmitted)

    def _correct(
        self, q: Vector, engaged: NDArray[np.bool_], border: NDArray[np.int64], load: Vector
    ) -> None:
        """Pull phi to the engaged border; never let it go further than the load bends the gear."""
        alpha = self._alpha
        beyond = alpha + load / self._t.gear_stiffness
        phi = q - self.theta
        low = np.where(engaged & (border > 0), alpha, -beyond)
        high = np.where(engaged & (border < 0), -alpha, beyond)
        error = phi - np.minimum(np.maximum(phi, low), high)
        # What is not known at all is taken at once, what is known a little at a time.
        pull = np.where(engaged & (self.sigma < alpha), _PULL, 1.0)
        self.theta += pull * error
        sigma = np.minimum(self.sigma, alpha)
        self.sigma[:] = np.where(engaged, sigma + pull * (self._floor - sigma), sigma)

    def _couple(self, q: Vector, transmitted: Vector) -> None:
        """A joint without gap: theta is q, and its side only says which way it pushes."""
        rigid = self._rigid
        np.copyto(self.theta, q, where=rigid)
        np.copyto(self.sigma, 0.0, where=rigid)
        pushes = np.where(transmitted > 0.0, Side.LEFT, Side.RIGHT)
        np.copyto(self.side, pushes, where=rigid, casting="unsafe")

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
