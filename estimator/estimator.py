"""One tick of the mathematics: samples in, `Estimate` out.

Samples are first brought to one common instant (`link_velocity`); everything after that, from the
motor position to the residual, belongs to that instant, `Estimator.delay_s` before the samples.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from errors import ModelError
from estimator import memory
from estimator.contact import Contact, ContactDetector, Thresholds, dead_band
from estimator.link_velocity import Alignment
from estimator.model import Model
from estimator.motor_position import MotorPosition
from estimator.residual import IMPULSES, Residual
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission, coulomb_viscous, penetration, resting
from estimator.types import Matrix, Vector


class Flag(IntFlag):
    """What the estimator complains about in a tick."""

    INVALID = 1
    """A sample or dt was not a finite number: everything holds, the samples are not used."""
    LATE = 2
    """More than one and a half periods since the last samples; the true interval was used."""
    RESTARTED = 4
    """More than two periods: residual and motor position start anew."""
    STARTING = 8
    """Not enough samples yet for a link velocity: the residual is zero."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Result of one tick; arrays of shape (n,), never changed afterwards."""

    q: Vector
    """link position at the common instant [rad]"""
    qd: Vector
    """link velocity [rad/s]"""
    theta: Vector
    """motor position at the link side [rad]"""
    phi: Vector
    """q - theta [rad]"""
    sigma_phi: Vector
    """standard uncertainty of phi [rad]"""
    side: NDArray[np.int8]
    """`motor_position.Side`"""
    tau_M: Vector
    """K_c * current [Nm]"""
    residual: Vector
    """the residual that decides: estimate of the external torque [Nm]"""
    beside: dict[str, Vector]
    """other residuals on the same samples [Nm]"""
    threshold: Vector
    """contact threshold in force [Nm]"""
    thresholded: Vector
    """sign(r) max(|r| - threshold, 0) [Nm]"""
    contacts: tuple[Contact, ...]
    """contacts that begin in this tick"""
    flags: Flag


class Estimator:
    """The whole chain from samples to contact for one arm.

    Raises ModelError if the parts do not fit each other.
    """

    _MEMORY = (
        *("elapsed", "pending", "_started"),
        *("_momentum", "_ends", "_gap", "_shown"),
    )
    _PARTS = ("alignment", "motor_position", "residual", "detector")

    def __init__(
        self,
        model: Model,
        transmission: Transmission,
        settings: EstimatorSettings,
        thresholds: Thresholds,
        period_s: float,
    ) -> None:
        n = model.n
        if transmission.joints != model.names:
            raise ModelError(f"transmission of {transmission.joints}, model of {model.names}")
        if settings.sign_width != transmission.sign_width:
            raise ModelError(
                f"sign_width {settings.sign_width} and {transmission.sign_width} differ"
            )
        self.model = model
        self.transmission = transmission
        self.settings = settings
        self.period_s = period_s
        self.alignment = Alignment(
            n,
            settings.link_velocity,
            period_s,
            current_delay=settings.current_delay_ms / 1000,
            link_delay=settings.link_position_delay_ms / 1000,
            motor_delay=settings.motor_velocity_delay_ms / 1000,
        )
        self.motor_position = MotorPosition(transmission, settings.gap)
        variants = (settings.residual, *settings.beside)
        self.residual = Residual(variants, settings.gain, period_s, n)
        self.detector = ContactDetector(
            model.names,
            thresholds,
            hidden=settings.stiction_share * transmission.engaged_coulomb,
            gain=settings.gain,
            debounce=settings.debounce,
        )
        self._beside = tuple(enumerate((v.name for v in settings.beside), start=1))
        self._corrected = bool(
            np.any(transmission.contact_stiffness) or np.any(transmission.contact_damping)
        )
        self._measured = settings.motor_position == "measured"
        # current, motor velocity, motor position (zero where it is not used), link position
        self._samples: Matrix = np.zeros((4, n))
        self._impulses: Matrix = np.zeros((len(IMPULSES), n))
        self._velocities: Matrix = np.zeros((4, n))
        t = transmission
        self._coulomb = np.stack([t.motor_coulomb, t.link_coulomb, t.link_coulomb, t.gap_coulomb])
        self._viscous = np.stack([t.motor_viscous, t.link_viscous, t.link_viscous, t.gap_viscous])
        # Values at the common instant of the last tick, and room for those of this one.
        self._momentum = np.zeros(n)
        self._ends: Matrix = np.zeros((8, n))  # tau_M, theta_dot, theta, beta, _rub's friction
        self._next_ends: Matrix = np.zeros((8, n))
        self._means: Matrix = np.zeros((8, n))  # integrals of these rows over the interval
        self._gap = np.zeros(n, dtype=np.bool_)
        self._shown = np.zeros((4, n))  # q, q_dot, tau_M, threshold
        self._started = False
        self.elapsed = 0.0
        self.pending = 0.0
        self._last = self._still(np.zeros(n), Flag.STARTING)

    @property
    def delay_s(self) -> float:
        """The estimate belongs to this long before its samples; the residual adds ln 2 / K."""
        return self.alignment.delay

    def step(
        self,
        current: Vector,
        link_position: Vector,
        motor_velocity: Vector,
        motor_position: Vector | None = None,
        dt: float | None = None,
        *,
        time_s: float | None = None,
    ) -> Estimate:
        """Take the samples of one tick, each of shape (n,) [A, rad, rad/s, rad at the link].

        dt: true interval since the samples before [s], by default the period. time_s: only for the
        contacts' time; by default the sum of all dt.
        """
        dt = self.period_s if dt is None else dt
        samples = self._samples
        samples[0], samples[1], samples[3] = current, motor_velocity, link_position
        if self._measured:
            samples[2] = np.nan if motor_position is None else motor_position
        if not (np.isfinite(samples).all() and 0.0 < dt < np.inf):
            self.pending += dt if 0.0 < dt < np.inf else self.period_s
            return replace(self._last, contacts=(), flags=Flag.INVALID)

        dt, self.pending = dt + self.pending, 0.0
        self.elapsed += dt
        flags = Flag.LATE if dt > 1.5 * self.period_s else Flag(0)
        if dt > 2.0 * self.period_s * (1 + 1e-9):
            flags |= Flag.RESTARTED
            self.restart()
        self.alignment.push(samples, dt)
        if self.alignment.ready:
            self._last = self._advance(dt, flags, self.elapsed if time_s is None else time_s)
        else:
            self._last = self._still(link_position, flags | Flag.STARTING)
        return self._last

    def reset(self) -> None:
        """Forget external torque and contacts: r = 0. Positions and velocities are kept, so that
        nothing jumps."""
        self.residual.reset()
        self.detector.reset()

    def restart(self) -> None:
        """Forget all samples, and with them where the rotors are in their gaps."""
        self.reset()
        self.alignment.restart()
        self._started = False

    def memory(self) -> dict[str, Any]:
        """The complete internal state, fit for JSON; `restore` continues bit-identically."""
        parts = {name: getattr(self, name).memory() for name in self._PARTS}
        return {"estimator": memory.dump(self, self._MEMORY), **parts}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from `memory()`. Raises ModelError if it belongs to another arm."""
        if set(state) != {"estimator", *self._PARTS}:
            raise ModelError(f"memory of an estimator: {sorted(state)}")
        memory.load(self, self._MEMORY, state["estimator"])
        for name in self._PARTS:
            getattr(self, name).restore(state[name])
        self._last = self._estimate((), Flag(0))

    def _advance(self, dt: float, flags: Flag, time_s: float) -> Estimate:
        q, qd = self.alignment.link()
        ends = self._next_ends
        self.alignment.motor(out=ends[:3])
        tau_M, theta_dot = ends[0], ends[1]
        tau_M *= self.transmission.torque_constant
        momentum, ends[3] = self.model.dynamics(q, qd)
        self._rub(qd, theta_dot, out=ends[4:])
        rest = resting(theta_dot)
        if self._started:
            gap = self._balance(q, qd, momentum, rest, dt)
            self.residual.step(self._impulses, dt)
            self._gap[:] = gap
        else:
            self.motor_position.start(q)
            self._started = True
            flags |= Flag.STARTING
        self._momentum[:] = momentum
        self._ends, self._next_ends = ends, self._ends
        threshold = self.detector.thresholds(rest, dt)
        side = self.motor_position.side
        contacts = self.detector.step(self.residual.values[0], side, time_s)
        self._show(q, qd, tau_M, threshold)
        return self._estimate(contacts, flags)

    def _rub(self, qd: Vector, theta_dot: Vector, out: Matrix) -> None:
        """Friction [Nm]: motor at theta_dot, link at theta_dot, link at q_dot, gap at phi_dot."""
        v = self._velocities
        v[:2] = theta_dot
        v[2] = qd
        np.subtract(qd, theta_dot, out=v[3])
        out[:] = coulomb_viscous(self._coulomb, self._viscous, v, self.transmission.sign_width)

    def _balance(
        self, q: Vector, qd: Vector, momentum: Vector, rest: Vector, dt: float
    ) -> NDArray[np.bool_]:
        """Fill the interval's impulses, in the order of IMPULSES; which joints are in their gap."""
        t, impulses, means = self.transmission, self._impulses, self._means
        ends, before = self._next_ends, self._ends
        np.add(ends, before, out=means)
        np.multiply(means, 0.5 * dt, out=means)
        pushed, turned, _, beta, motor_rub, link_rub_together, link_rub, gap_rub = means

        np.subtract(momentum, self._momentum, out=impulses[0])
        impulses[0] -= beta
        impulses[1] = pushed
        np.subtract(ends[1], before[1], out=impulses[2])
        impulses[2] *= t.rotor_inertia
        np.add(motor_rub, link_rub_together, out=impulses[3])
        np.add(motor_rub, link_rub, out=impulses[4])

        advance = ends[2] - before[2] if self._measured else turned
        gap = self._locate(q, qd, advance, motor_rub, rest, dt)
        apart = gap & self._gap
        np.multiply(impulses[1:3], ~apart, out=impulses[5:7])
        impulses[7] = impulses[3]
        np.copyto(impulses[7], link_rub + gap_rub, where=apart)
        if self._corrected:
            delta = penetration(q - self.motor_position.theta, t.half_gap)
            correction = t.contact_stiffness * delta + t.contact_damping * (qd - ends[1])
            impulses[5] += dt * correction * ~apart
        return gap

    def _locate(
        self, q: Vector, qd: Vector, advance: Vector, motor_rub: Vector, rest: Vector, dt: float
    ) -> NDArray[np.bool_]:
        """Move theta; which joints are in their gap now. motor_rub: motor friction's impulse."""
        tau_M, theta_dot = self._next_ends[:2]
        _, pushed, rotor = self._impulses[:3]
        transmitted = (pushed - rotor - motor_rub) / dt
        doubt = self.motor_position.uncertainty(tau_M, rotor / dt, theta_dot, rest)
        return self.motor_position.step(
            q, qd, theta_dot, advance, transmitted, doubt, dt, measured=self._measured
        )

    def _still(self, q: Vector, flags: Flag) -> Estimate:
        """No velocity yet: no residual."""
        zero = np.zeros(self.model.n)
        self.motor_position.start(q)
        threshold = self.detector.thresholds(resting(zero), self.period_s)
        self._show(q, zero, zero, threshold)
        return self._estimate((), flags)

    def _show(self, q: Vector, qd: Vector, tau_M: Vector, threshold: Vector) -> None:
        shown = self._shown
        shown[0], shown[1], shown[2], shown[3] = q, qd, tau_M, threshold

    def _estimate(self, contacts: tuple[Contact, ...], flags: Flag) -> Estimate:
        position = self.motor_position
        q, qd, tau_M, threshold = self._shown.copy()
        residuals = self.residual.values.copy()
        return Estimate(
            q=q,
            qd=qd,
            theta=position.theta.copy(),
            phi=q - position.theta,
            sigma_phi=position.sigma.copy(),
            side=position.side.copy(),
            tau_M=tau_M,
            residual=residuals[0],
            beside={name: residuals[row] for row, name in self._beside},
            threshold=threshold,
            thresholded=dead_band(residuals[0], threshold),
            contacts=contacts,
            flags=flags,
        )
