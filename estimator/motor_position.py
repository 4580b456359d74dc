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

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from estimator import memory
from estimator.transmission import Transmission
from estimator.types import Matrix, Vector


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
_FLOOR = 0.05  # of alpha: standard uncertainty at an engaged border
_LEFT, _GAP, _RIGHT, _UNKNOWN = Side.LEFT, Side.GAP, Side.RIGHT, Side.UNKNOWN


class Motion(NamedTuple):
    """One joint in one interval, at the link side."""

    q: float
    """link position at its end [rad]"""
    q_dot: float
    """[rad/s]"""
    theta_dot: float
    """[rad/s]"""
    resting: float
    """`transmission.resting` of theta_dot"""
    tau_M: float
    """K_c * current [Nm]"""
    advance: float
    """change of theta, integrated or measured [rad]"""
    rotor: float
    """mean B theta_ddot [Nm]"""
    transmitted: float
    """mean torque that the rotor gives to the link [Nm]"""


class Known(NamedTuple):
    """What is known of one rotor."""

    theta: float
    """[rad]"""
    sigma: float
    """standard uncertainty of phi [rad]"""
    streak: int
    """ticks in a row in which the transmitted torque clearly had one sign; signed as that"""
    side: int
    """`Side`"""
    gap: bool
    """sure to be in the gap: unlike `side`, never in doubt"""


@dataclass(frozen=True, slots=True)
class JointGap:
    """The gap of one joint. Plain numbers: a branch costs less than a mask over seven joints."""

    settings: GapSettings
    alpha: float
    compliance: float  # of the gear [rad/Nm]
    coulomb: float  # of the motor's side [Nm]
    viscous: float  # [Nm s/rad]
    measured: bool  # theta follows the drive's motor position

    def start(self, q: float) -> Known:
        """Nothing is known but that phi is somewhere in the gap."""
        return Known(q, self.alpha, 0, _UNKNOWN, gap=False)

    def doubt(self, moved: Motion) -> float:
        """How wrong the transmitted torque may be in motion [Nm]. Near rest, where Coulomb
        friction may have any value, it may be wrong by that too."""
        s = self.settings
        return (
            s.friction_error * (self.coulomb + self.viscous * abs(moved.theta_dot))
            + s.rotor_error * abs(moved.rotor)
            + s.current_error * abs(moved.tau_M)
        )

    def step(self, known: Known, moved: Motion, dt: float) -> Known:
        """Advance by dt seconds."""
        s, alpha = self.settings, self.alpha
        load, doubt = abs(moved.transmitted), self.doubt(moved)
        theta, sigma = self._advanced(known, moved, dt)

        # A torque that may be friction does not tell the side; but it may as well be a load, and
        # dropping a load is worse than keeping a friction.
        sign = 0
        if load > doubt + self.coulomb * moved.resting:
            sign = 1 if moved.transmitted > 0.0 else -1
        streak = known.streak + sign if known.streak * sign > 0 else sign
        engaged = abs(streak) >= s.hold_ticks
        phi = moved.q - theta
        error, sigma = self._error(phi, sigma, engaged, streak, load)
        theta += error
        phi -= error

        clear = abs(phi) < alpha - max(s.margin * alpha, sigma)
        gap = clear and load < doubt and not engaged
        if sigma >= alpha > 0.0:
            side = _UNKNOWN
        elif gap:
            side = _GAP
        else:
            towards = -moved.transmitted if engaged or alpha == 0.0 else phi
            side = _LEFT if towards < 0.0 else _RIGHT
        return Known(theta, sigma, streak, side, gap)

    def _advanced(self, known: Known, moved: Motion, dt: float) -> tuple[float, float]:
        """Theta and sigma after the motion: none at standstill, and then nothing is lost either."""
        if self.measured:
            return known.theta + moved.advance, known.sigma
        s, speed = self.settings, abs(moved.theta_dot)
        if speed <= s.standstill and abs(moved.q_dot) <= _LINK_REST:
            return known.theta, known.sigma
        lost = (s.velocity_scale_error * speed + s.velocity_bias) * dt
        return known.theta + moved.advance, known.sigma + lost

    def _error(
        self, phi: float, sigma: float, engaged: bool, streak: int, load: float
    ) -> tuple[float, float]:
        """What phi is beyond where it can be, and sigma after correcting it.

        While engaged phi is at its border; it never goes further than the load bends the gear.
        """
        alpha = self.alpha
        beyond = alpha + load * self.compliance
        # The torque pushes the link up where phi is at its lower border, and the other way round.
        border = -1.0 if streak > 0 else 1.0
        outward = border * phi
        lowest = alpha if engaged else -beyond
        error = border * (outward - min(max(outward, lowest), beyond))
        if not engaged:
            return error, min(sigma, alpha)
        # What is not known at all is taken at once, what is known a little at a time.
        pull = _PULL if sigma < alpha else 1.0
        sigma = min(sigma, alpha)
        return pull * error, sigma + pull * (_FLOOR * alpha - sigma)


class MotorPosition:
    """The rotors of an arm: theta [rad], sigma [rad], side; each of shape (n,)."""

    _MEMORY = ("theta", "sigma", "streak", "side", "gap")

    def __init__(
        self, transmission: Transmission, settings: GapSettings, *, measured: bool = False
    ) -> None:
        t, n = transmission, transmission.n
        self.joints = tuple(
            JointGap(
                settings=settings,
                alpha=float(t.half_gap[i]),
                compliance=float(1.0 / t.gear_stiffness[i] if t.half_gap[i] else 0.0),
                coulomb=float(t.motor_coulomb[i]),
                viscous=float(t.motor_viscous[i]),
                measured=measured,
            )
            for i in range(n)
        )
        self.theta = np.zeros(n)
        self.sigma = np.zeros(n)
        self.streak = np.zeros(n, dtype=np.int64)
        self.side = np.zeros(n, dtype=np.int8)
        self.gap = np.zeros(n, dtype=np.bool_)
        self.start(self.theta)

    def start(self, q: Vector) -> None:
        """Link positions (n,) are all that is known."""
        self._keep([joint.start(x) for joint, x in zip(self.joints, q.tolist(), strict=True)])

    def step(self, moved: Matrix, dt: float) -> Vector:
        """Advance by dt seconds; moved: rows of `Motion`, shape (8, n).

        Returns 0 where a joint was in its gap at both ends of the interval and else 1, (n,).
        """
        known = [
            joint.step(Known(*before), Motion(*motion), dt)
            for joint, motion, *before in zip(
                self.joints,
                moved.T.tolist(),
                self.theta.tolist(),
                self.sigma.tolist(),
                self.streak.tolist(),
                self.side.tolist(),
                self.gap.tolist(),
                strict=True,
            )
        ]
        apart = self.gap.copy()
        self._keep(known)
        apart &= self.gap
        return np.subtract(1.0, apart)

    def _keep(self, known: list[Known]) -> None:
        theta, sigma, streak, side, gap = zip(*known, strict=True)
        self.theta[:], self.sigma[:], self.streak[:] = theta, sigma, streak
        self.side[:], self.gap[:] = side, gap

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
