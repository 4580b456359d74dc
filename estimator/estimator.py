"""The estimator's chain for one tick: samples in, `Estimate` out.

Samples are first brought to one common instant (`link_velocity`); everything after that, from the
motor position to the residual, belongs to that instant, `Estimator.delay_s` before the samples.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace

from arrays import Matrix, Vector
from errors import ModelError
from estimator import memory
from estimator.contact import Contact, ContactDetector, dead_band, touched_link
from estimator.estimate import Estimate, Flag
from estimator.friction import FRICTIONS, FrictionTerms
from estimator.interval import ROW, Interval
from estimator.link_velocity import ALIGNED, Alignment
from estimator.model import Model
from estimator.motor_position import MOTION, MotorPosition
from estimator.residual import Residual
from estimator.settings import EstimatorSettings
from estimator.stiction import Stiction, displacement
from estimator.thresholds import ThresholdRaise, Thresholds
from estimator.transmission import Transmission, penetration, resting, smooth_sign

# Sums of an interval's terms that the motor position needs; the residual's forms follow them.
_ADVANCE = {"integrated": {"theta_dot": 1.0}, "measured": {"theta": 1.0}}
_ROTOR = {"rotor": 1.0}
_TRANSMITTED = {"tau_M": 1.0, "rotor": -1.0, "motor_friction": -1.0}
# Their rows among the impulses, in this order.
_ADVANCE_ROW, _TORQUE_ROWS, _RESIDUAL_ROWS = 0, slice(1, 3), slice(3, None)
_MEAN_TORQUES = slice(MOTION.index("rotor"), None)  # the same rows of MOTION, divided by dt
_INPUTS = ("current", "link_position", "motor_velocity")


class Estimator:
    """The whole chain from samples to contact for one arm.

    Raises ModelError if the parts do not fit each other.
    """

    _MEMORY = ("elapsed", "pending", "_started", "_shown")
    _PARTS = ("alignment", "interval", "motor_position", "stiction", "residual", "detector")

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
            velocity_delay=settings.motor_velocity_delay_ms / 1000,
            position_delay=settings.motor_position_delay_ms / 1000,
        )
        self._measured = settings.motor_position == "measured"
        self.motor_position = MotorPosition(transmission, settings.gap, measured=self._measured)
        self.stiction = Stiction(n, settings.presliding)
        variants = (settings.residual, *settings.beside)
        self.residual = Residual(variants, settings.gain, period_s, n)
        own = (_ADVANCE[settings.motor_position], _ROTOR, _TRANSMITTED)
        self.interval = Interval([*own, *self.residual.forms()], n)
        self.detector = ContactDetector(
            model.names,
            thresholds,
            gain=settings.gain,
            debounce=settings.debounce,
        )
        self._contact, self._per_speed = thresholds.contact, thresholds.per_speed
        self._beside = tuple(enumerate((v.name for v in settings.beside), start=1))
        t = transmission
        self._has_gap = t.half_gap > 0.0
        self._held = t.stiction * t.engaged_coulomb
        self._threshold_raise = ThresholdRaise(t, settings, thresholds.contact)
        # Variants whose tau_M a fit corrects while engaged: those with engagement.
        self._corrected = np.array([[v.kind == "backlash"] for v in variants], dtype=np.float64)
        self._correcting = bool(np.any(t.contact_stiffness) or np.any(t.contact_damping))
        self._shape = (n,)
        # current, motor velocity, motor position (zero where it is not used), link position
        self._samples: Matrix = np.zeros((4, n))
        self._ones = np.ones(4 * n)
        self._aligned: Matrix = np.zeros((len(ALIGNED), n))
        self._moved: Matrix = np.zeros((len(MOTION), n))
        self._friction = FrictionTerms(t)
        self._shown: Matrix = np.zeros((4, n))  # q, q_dot, tau_M, threshold
        self._started = False
        self.elapsed = 0.0
        self.pending = 0.0
        self._last = self._still(np.zeros(n), Flag.STARTING)

    @property
    def delay_s(self) -> float:
        """Age of the estimate when its samples arrive [s]; the residual adds ln 2 / K."""
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

        Samples that are not finite are not used; finite ones of which the arithmetic makes what is
        not finite start everything anew. Either way the last good values come back, flagged
        INVALID. Raises ModelError for arrays of another shape.
        """
        dt = self.period_s if dt is None else dt
        for name, values in zip(_INPUTS, (current, link_position, motor_velocity), strict=True):
            self._check_shape(name, values)
        samples = self._samples
        samples[0], samples[1], samples[3] = current, motor_velocity, link_position
        if self._measured:
            if motor_position is not None:
                self._check_shape("motor_position", motor_position)
            samples[2] = np.nan if motor_position is None else motor_position
        # One sum is enough: any value that is not finite makes the sum so.
        if not (math.isfinite(samples.ravel() @ self._ones) and 0.0 < dt < math.inf):
            self.pending += dt if 0.0 < dt < math.inf else self.period_s
            return self._invalid()

        dt, self.pending = dt + self.pending, 0.0
        self.elapsed += dt
        flags = Flag.LATE if dt > 1.5 * self.period_s else Flag(0)
        # One sample may be missing, and the tick after it late.
        if dt > 2.5 * self.period_s:
            flags |= Flag.RESTARTED
            self.restart()
        self.alignment.push(samples, dt)
        if self.alignment.ready:
            made = self._advance(dt, flags, self.elapsed if time_s is None else time_s)
            if not self._is_finite(made):
                # The state would never become finite again.
                self.restart()
                self._still(self._last.q, Flag.STARTING)
                return self._invalid()
            self._last = made
        else:
            self._last = self._still(link_position, flags | Flag.STARTING)
        return self._last

    def levels_at(self, speed: Vector) -> Vector:
        """Contact levels (n,) [Nm] that would be in force at motor speeds (n,) [rad/s], with what
        is known now of friction and gaps. Changes nothing."""
        side = self.motor_position.side
        hidden = self._threshold_raise.at(resting(speed), self.stiction.unknown, side)
        levels: Vector = self._contact + hidden + self._per_speed * np.abs(speed)
        return levels

    def reset(self) -> None:
        """Forget external torque and contacts: r = 0. Positions and velocities are kept, so that
        nothing jumps."""
        self.residual.reset()
        self.detector.reset()

    def restart(self) -> None:
        """Forget all samples, and with them where the rotors are in their gaps."""
        self.reset()
        self.alignment.restart()
        self.interval.restart()
        self.stiction.restart()
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

    def _check_shape(self, name: str, values: Vector) -> None:
        """Raise ModelError for another shape: numpy would stretch one number over all joints."""
        if getattr(values, "shape", None) != self._shape:
            given = getattr(values, "shape", type(values).__name__)
            raise ModelError(f"{name} is {given}; it must be an array of shape {self._shape}")

    def _is_finite(self, made: Estimate) -> bool:
        """True where no value is infinite or NaN, by one sum: inf and -inf make NaN. phi stands for
        q and theta."""
        shown = made.q_dot + made.tau_M
        shown += made.phi
        shown += made.phi_sigma
        shown += made.threshold
        return math.isfinite(shown.sum() + self.residual.values.sum())

    def _invalid(self) -> Estimate:
        return replace(self._last, contacts=(), flags=Flag.INVALID)

    def _advance(self, dt: float, flags: Flag, time_s: float) -> Estimate:
        t, (q, q_dot, current, theta_dot, theta) = self.transmission, self._aligned
        self.alignment.aligned(out=self._aligned)
        self.interval.begin()
        now = self.interval.now
        tau_M = now[ROW["tau_M"]]
        np.multiply(t.torque_constant, current, out=tau_M)
        np.multiply(t.rotor_inertia, theta_dot, out=now[ROW["rotor"]])
        now[ROW["momentum"]], now[ROW["beta"]] = self.model.dynamics(q, q_dot)
        now[ROW["theta_dot"]], now[ROW["theta"]] = theta_dot, theta
        self._friction.at(q_dot, theta_dot, out=now[FRICTIONS])
        rest = resting(theta_dot)
        if self._started:
            if self._measured:
                turned = theta - self.interval.before[ROW["theta"]]
            else:
                turned = displacement(theta_dot, q_dot, q - self._shown[0], self._has_gap, dt)
            self.stiction.step(turned)
        sign = smooth_sign(theta_dot, t.sign_width)
        np.multiply(self._held, self.stiction.z - sign, out=now[ROW["stiction"]])
        if self._started:
            self._balance(q, q_dot, theta_dot, tau_M, rest, dt)
        else:
            self.motor_position.start(q)
            self._started = True
            flags |= Flag.STARTING
        side = self.motor_position.side
        hidden = self._threshold_raise.at(rest, self.stiction.unknown, side)
        threshold = self.detector.thresholds(hidden, theta_dot, dt)
        contacts = self.detector.step(self.residual.values[0], side, time_s)
        self._show(q, q_dot, tau_M, threshold)
        return self._estimate(contacts, flags)

    def _balance(
        self, q: Vector, q_dot: Vector, theta_dot: Vector, tau_M: Vector, rest: Vector, dt: float
    ) -> None:
        """Motor position and residual over the interval that ends now."""
        impulses = self.interval.step(dt)
        moved = self._moved
        moved[0], moved[1], moved[2], moved[3], moved[4] = q, q_dot, theta_dot, rest, tau_M
        moved[5] = impulses[_ADVANCE_ROW]
        np.divide(impulses[_TORQUE_ROWS], dt, out=moved[_MEAN_TORQUES])
        engaged = self.motor_position.step(moved, dt)
        errors = impulses[_RESIDUAL_ROWS]
        if self._correcting:
            t = self.transmission
            delta = penetration(q - self.motor_position.theta, t.half_gap)
            correction = t.contact_stiffness * delta + t.contact_damping * (q_dot - theta_dot)
            errors[self.residual.engaged] -= dt * self._corrected * correction
        self.residual.step(errors, engaged, dt)

    def _still(self, q: Vector, flags: Flag) -> Estimate:
        """Estimate without a velocity yet: no residual."""
        zero = np.zeros(self.model.n)
        self.motor_position.start(q)
        threshold = self.detector.thresholds(self._threshold_raise.most, zero, self.period_s)
        self._show(q, zero, zero, threshold)
        return self._estimate((), flags)

    def _show(self, q: Vector, q_dot: Vector, tau_M: Vector, threshold: Vector) -> None:
        shown = self._shown
        shown[0], shown[1], shown[2], shown[3] = q, q_dot, tau_M, threshold

    def _estimate(self, contacts: tuple[Contact, ...], flags: Flag) -> Estimate:
        position = self.motor_position
        q, q_dot, tau_M, threshold = self._shown.copy()
        residuals = self.residual.values.copy()
        theta = position.theta
        thresholded = dead_band(residuals[0], threshold)
        return Estimate(
            q=q,
            q_dot=q_dot,
            theta=theta,
            phi=q - theta,
            phi_sigma=position.sigma,
            side=position.side,
            tau_M=tau_M,
            residual=residuals[0],
            beside={name: residuals[row] for row, name in self._beside},
            threshold=threshold,
            thresholded=thresholded,
            contacts=contacts,
            touched_link=self._touched_link(residuals[0], threshold)
            if np.count_nonzero(thresholded)
            else "",
            flags=flags,
        )

    def _touched_link(self, residual: Vector, threshold: Vector) -> str:
        # A residual that stiction may explain near rest is no sign of a touch.
        link = touched_link(dead_band(residual, threshold - self._contact), self._contact)
        return "" if link is None else self.model.names[link]
