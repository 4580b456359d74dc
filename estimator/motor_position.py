"""Motor position in the gap: theta, its uncertainty, and the side that is engaged.

Theta is the integral of the motor velocity, or follows the drive's motor position; in both cases
its offset to the link is found, and drift taken out, by the geometry of the gap:

- |phi| never exceeds alpha and the gear's deflection;
- a torque transmitted for some ticks shows the side: phi < 0 pushes the link up, phi > 0 down;
- at standstill theta is held; a link that creeps meanwhile makes phi uncertain, as its rotor may
  or may not go along.

The side comes from the motor's side of the gear alone (current, friction, rotor inertia), never
from the residual: a hand that moves the link to the other border of its gap is seen to do so, and
is not explained away.
"""

from enum import IntEnum
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from arrays import Matrix, Vector
from estimator import memory
from estimator.transmission import Transmission


class Side(IntEnum):
    """Gap state of a joint; LEFT is phi = -alpha, where the rotor pushes the link upwards."""

    LEFT = -1
    GAP = 0
    RIGHT = 1
    UNKNOWN = 2


class GapSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Allowed errors of motor velocity and torque. The defaults suit drives of two encoders."""

    velocity_scale_error: Annotated[float, Meta(ge=0, le=0.1)] = 0.002
    velocity_bias: Annotated[float, Meta(ge=0, le=0.1)] = 0.001  # [rad/s]
    standstill: Annotated[float, Meta(ge=0, le=0.1)] = 0.002  # motor velocity [rad/s]
    hold_ticks: Annotated[int, Meta(ge=1, le=100)] = 3
    margin: Annotated[float, Meta(ge=0.12, lt=1)] = 0.12  # of alpha
    hysteresis: Annotated[float, Meta(ge=0, le=0.01)] = 0.0001  # at the border [rad]
    friction_error: Annotated[float, Meta(ge=0, le=1)] = 0.27  # of the motor's side
    rotor_error: Annotated[float, Meta(ge=0, le=1)] = 0.15
    current_error: Annotated[float, Meta(ge=0, le=1)] = 0.05
    half_gap_error: Annotated[float, Meta(ge=0, le=1)] = 0.07
    compliance: Annotated[float, Meta(ge=0, le=0.1)] = 0.0007  # of a gear under load [rad/Nm]


LINK_REST = 0.01
"""[rad/s]; a link encoder's noise stays below it"""
# Standard uncertainties between phi and a border that it is clear of. Where phi rests, a border is
# near that is not where it is believed: inside the gap the link would fall.
_CLEAR, _CLEAR_AT_REST = 1.3, 2.5
_RESTS_S, _RESTS_WITHIN = 0.3, 0.0005  # [rad]
_PULL = 0.2  # share of a border's error that is corrected in one tick
# Looking a member up in its enumeration costs as much as five sums.
_LEFT, _GAP, _RIGHT, _UNKNOWN = map(int, Side)


MOTION = (
    "q",  # link position at the end of the interval [rad]
    "q_dot",  # [rad/s]
    "theta_dot",  # [rad/s]
    "resting",  # `transmission.resting` of theta_dot
    "tau_M",  # K_c * current [Nm]
    "advance",  # change of theta, integrated or measured [rad]
    "rotor",  # mean B theta_ddot [Nm]
    "transmitted",  # mean torque that the rotor gives to the link [Nm]
)
"""Motion and torques of one joint in one interval, at the link side."""


class JointGap:
    """The rotor of one joint in its gap. Plain numbers, not arrays: over a handful of joints a
    branch costs less than a mask."""

    def __init__(
        self,
        settings: GapSettings,
        *,
        alpha: float,
        coulomb: float,
        viscous: float,
        measured: bool,
    ) -> None:
        """alpha [rad], friction of the motor's side [Nm] and [Nm s/rad]; measured: theta follows
        the drive's motor position."""
        s = settings
        self._alpha, self._coulomb = alpha, coulomb
        self._compliance = s.compliance if alpha else 0.0
        self._doubt_coulomb = s.friction_error * coulomb
        self._doubt_viscous = s.friction_error * viscous
        self._doubt_rotor, self._doubt_current = s.rotor_error, s.current_error
        self._margin, self._doubt_alpha = s.margin * alpha, s.half_gap_error * alpha
        self._scale_error, self._bias = s.velocity_scale_error, s.velocity_bias
        self._hysteresis = s.hysteresis
        self._standstill, self._hold_ticks, self._measured = s.standstill, s.hold_ticks, measured
        self.start(0.0)

    def start(self, q: float) -> None:
        """Forget everything but that phi is somewhere in the gap."""
        self.theta = q
        self.sigma = self._alpha
        self.side = _UNKNOWN
        # Ticks in a row in which the transmitted torque clearly had one sign; signed as that.
        self.streak = 0
        # Sure to be in the gap: unlike `side`, never in doubt.
        self.gap = False
        # How far the link has moved while theta was held, and how far at most [rad].
        self.q, self.slipped, self.slipped_most = q, 0.0, 0.0
        # Where phi has been for how long [rad, s].
        self.rested_at, self.rested_s = 0.0, 0.0

    def step(
        self,
        q: float,
        q_dot: float,
        theta_dot: float,
        resting: float,
        tau_M: float,
        advance: float,
        rotor: float,
        transmitted: float,
        *,
        dt: float,
    ) -> None:
        """Advance by dt seconds; arguments are those of MOTION."""
        alpha, load, speed = self._alpha, abs(transmitted), abs(theta_dot)
        if self._measured:
            self.theta += advance
        elif speed > self._standstill or abs(q_dot) > LINK_REST:
            self.theta += advance
            self.sigma += (self._scale_error * speed + self._bias) * dt
        else:
            self._hold(q - self.q)
        self.q = q

        # How wrong the transmitted torque may be; near rest friction may have any value. A torque
        # that may be friction shows nothing: neither the side, nor that there is a load.
        doubt = self._doubt_coulomb + self._doubt_viscous * speed + self._coulomb * resting
        doubt += self._doubt_rotor * abs(rotor) + self._doubt_current * abs(tau_M)
        sign = 0
        if load > doubt:
            sign = 1 if transmitted > 0.0 else -1
        self.streak = self.streak + sign if self.streak * sign > 0 else sign
        engaged = abs(self.streak) >= self._hold_ticks

        phi = self._correct(q, engaged, load * self._compliance)
        if abs(phi - self.rested_at) > _RESTS_WITHIN:
            self.rested_at, self.rested_s = phi, 0.0
        # It follows, so that a theta which drifts, slower than 2 mrad/s, rests all the same.
        self.rested_at += (phi - self.rested_at) * dt / _RESTS_S
        self.rested_s += dt
        clearance = _CLEAR_AT_REST if self.rested_s > _RESTS_S else _CLEAR
        border = alpha - max(self._margin, clearance * self.sigma)
        # Inside the gap the border itself counts; to enter it phi must go further.
        clear = abs(phi) < (border if self.gap else border - self._hysteresis)
        self.gap = clear and load < doubt and not engaged
        if self.gap:
            self.side = _GAP
        elif not engaged and (self.sigma >= alpha > 0.0 or clear):
            # Nothing is known, or a load that came just now contradicts what is.
            self.side = _UNKNOWN
        else:
            towards = -transmitted if engaged or alpha == 0.0 else phi
            self.side = _LEFT if towards < 0.0 else _RIGHT

    def _hold(self, moved: float) -> None:
        """Hold theta at standstill. A link that creeps may take its rotor along, or be moved by a
        hand while the rotor stands: phi is as uncertain as the link has crept. Back and forth, as
        an encoder's counts do, it comes to nothing."""
        self.slipped += moved
        most = abs(self.slipped)
        if most > self.slipped_most:
            self.sigma += most - self.slipped_most
            self.slipped_most = most

    def _correct(self, q: float, engaged: bool, bent: float) -> float:
        """Move theta to where phi = q - theta can be, and return that: at its border while
        engaged, and never further than the load may bend the gear, `bent`."""
        alpha, phi = self._alpha, q - self.theta
        beyond = alpha + bent
        # The torque pushes the link up where phi is at its lower border, and the other way round.
        border = -1.0 if self.streak > 0 else 1.0
        outward = border * phi
        lowest = alpha if engaged else -beyond
        error = border * (outward - min(max(outward, lowest), beyond))
        if engaged:
            # What is not known at all is taken at once, what is known a little at a time.
            pull = _PULL if self.sigma < alpha else 1.0
            error *= pull
            self.sigma = min(self.sigma, alpha)
            self.sigma += pull * (min(self._doubt_alpha + bent, alpha) - self.sigma)
            self.slipped = self.slipped_most = 0.0
        elif self.sigma > alpha:
            self.sigma = alpha
        self.theta += error
        return phi - error


class MotorPosition:
    """All rotors of an arm: theta [rad], sigma [rad], side, gap; new arrays of shape (n,)."""

    _STATE: tuple[str, ...] = (
        *("theta", "sigma", "streak", "side", "gap"),
        *("q", "slipped", "slipped_most", "rested_at", "rested_s"),
    )

    def __init__(
        self, transmission: Transmission, settings: GapSettings, *, measured: bool = False
    ) -> None:
        t = transmission
        self.joints = tuple(
            JointGap(
                settings,
                alpha=float(t.half_gap[i]),
                coulomb=float(t.motor_coulomb[i]),
                viscous=float(t.motor_viscous[i]),
                measured=measured,
            )
            for i in range(t.n)
        )

    @property
    def theta(self) -> Vector:
        """Motor position at the link side [rad]."""
        return np.array([joint.theta for joint in self.joints])

    @property
    def sigma(self) -> Vector:
        """Standard uncertainty of phi [rad]."""
        return np.array([joint.sigma for joint in self.joints])

    @property
    def side(self) -> NDArray[np.int8]:
        """`Side` of each joint."""
        return np.array([joint.side for joint in self.joints], dtype=np.int8)

    def start(self, q: Vector) -> None:
        """Begin at the link positions (n,) [rad], with nothing else known."""
        for joint, x in zip(self.joints, q.tolist(), strict=True):
            joint.start(x)

    def step(self, motion: Matrix, dt: Vector) -> Vector:
        """Advance by dt (n,) [s], joints where it is 0 not at all; motion: rows of MOTION, shape
        (8, n).

        Returns 0 where a joint was in its gap at both ends of the interval and else 1, (n,).
        """
        engaged = []
        for joint, moved, dt_s in zip(self.joints, motion.T.tolist(), dt.tolist(), strict=True):
            before = joint.gap
            if dt_s > 0.0:
                joint.step(*moved, dt=dt_s)
            engaged.append(0.0 if before and joint.gap else 1.0)
        return np.array(engaged)

    def memory(self) -> dict[str, Any]:
        return {name: [getattr(j, name) for j in self.joints] for name in self._STATE}

    def restore(self, state: dict[str, Any]) -> None:
        read = _Rows(self.memory())
        memory.load(read, self._STATE, state)
        for name in self._STATE:
            for joint, value in zip(self.joints, getattr(read, name).tolist(), strict=True):
                setattr(joint, name, value)


class _Rows:
    """A memory as arrays, so that `memory.load` can check what comes back."""

    def __init__(self, state: dict[str, list[Any]]) -> None:
        for name, values in state.items():
            setattr(self, name, np.array(values))
