"""The estimator in arrays: what the kernel must agree with, term by term, written another way.

Every term is one array over all joints, every sum of impulses a row of two matrix products.
"""

import math

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.contact import Contact, dead_band
from estimator.estimate import Estimate, Flag
from estimator.interval import ROW
from estimator.model import Model
from estimator.motor_position import MotorPosition
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission, penetration, resting, smooth_sign
from tests.estimator.in_arrays.contacts import (
    RAISED_PERIODS,
    ContactDetector,
    Residual,
    ThresholdRaise,
    touched_link,
)
from tests.estimator.in_arrays.motion import (
    ALIGNED,
    FRICTIONS,
    Alignment,
    FrictionTerms,
    Interval,
    Stiction,
    displacement,
)

# Sums of an interval's terms that the motor position needs; the residual's forms follow them.
_ADVANCE = {"integrated": {"theta_dot": 1.0}, "measured": {"theta": 1.0}}
_ROTOR = {"rotor": 1.0}
_TRANSMITTED = {"tau_M": 1.0, "rotor": -1.0, "motor_friction": -1.0}
# Their rows among the impulses, in this order.
_ADVANCE_ROW, _TORQUE_ROWS, _RESIDUAL_ROWS = 0, slice(1, 3), slice(3, None)
#: A joint that was without a sample for longer senses nothing [periods]: its residual is old.
SENSED_PERIODS = 2.5
#: Over a longer gap nothing is bridged [periods]: Tustin's rule does not know what happened in it.
BRIDGED_PERIODS = 5.5


class Estimator:
    """The whole chain from samples to contact for one arm.

    Raises ModelError if the parts do not fit each other.
    """

    def __init__(
        self,
        model: Model,
        transmission: Transmission,
        settings: EstimatorSettings,
        thresholds: Thresholds,
        period_s: float,
    ) -> None:
        n = model.n
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
        self.motor_position = MotorPosition(transmission, settings.gap, self._measured)
        t = transmission
        self.stiction = Stiction(n, settings.presliding, t.least_stiction, t.most_stiction)
        variants = (settings.residual, *settings.beside)
        self.residual = Residual(variants, settings.gain, period_s, n)
        own = (_ADVANCE[settings.motor_position], _ROTOR, _TRANSMITTED)
        self.interval = Interval([*own, *self.residual.forms()], n)
        self.detector = ContactDetector(
            model.names, thresholds, gain=settings.gain, debounce=settings.debounce
        )
        self._contact, self._per_speed = thresholds.contact, thresholds.per_speed
        self._beside = tuple(enumerate((v.name for v in settings.beside), start=1))
        t = transmission
        self._has_gap = t.half_gap > 0.0
        self._coulomb = t.engaged_coulomb
        self._threshold_raise = ThresholdRaise(t, settings, thresholds.contact)
        # Variants whose tau_M a fit corrects while engaged: those with engagement.
        self._corrected = np.array([[v.kind == "backlash"] for v in variants], dtype=np.float64)
        self._correcting = bool(np.any(t.contact_stiffness) or np.any(t.contact_damping))
        self._shape = (n,)
        # current, motor velocity, motor position (zero where it is not used), link position
        self._samples: Matrix = np.zeros((4, n))
        self._ones = np.ones(4 * n)
        self._aligned: Matrix = np.zeros((len(ALIGNED), n))
        self._friction = FrictionTerms(t)
        self._shown: Matrix = np.zeros((4, n))  # q, q_dot, tau_M, threshold
        self._every: NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        self._going = ~self._every  # joints whose interval has a beginning
        self.elapsed = 0.0
        self.since = np.zeros(n)
        """time since the sample of each joint that was used last [s]"""
        self._last = self._still(np.zeros(n), Flag.STARTING)

    def step(
        self,
        current: Vector,
        link_position: Vector,
        motor_velocity: Vector,
        motor_position: Vector | None = None,
        dt: float | None = None,
        *,
        time_s: float | None = None,
        fresh: NDArray[np.bool_] | None = None,
    ) -> Estimate:
        """Take the samples of one tick, each of shape (n,) [A, rad, rad/s, rad at the link].

        dt: true interval since the tick before [s], by default the period. time_s: only for the
        contacts' time; by default the sum of all dt. fresh: joints (n,) of which there is a sample
        in this tick, by default all; values of the others are not used.

        Samples that are not finite are not used; finite ones of which the arithmetic makes what is
        not finite start everything anew. Either way the last good values come back, flagged
        INVALID. Raises ModelError for arrays of another shape.
        """
        dt = self.period_s if dt is None else dt
        samples = self._samples
        samples[0], samples[1], samples[3] = current, motor_velocity, link_position
        if self._measured:
            samples[2] = np.nan if motor_position is None else motor_position
        came = self._every if fresh is None or fresh.all() else fresh
        absent = None if came is self._every else ~came
        if absent is not None:
            samples[:, absent] = 0.0
        # One sum is enough: any value that is not finite makes the sum so.
        if not (math.isfinite(samples.ravel() @ self._ones) and 0.0 < dt < math.inf):
            self._wait(dt if 0.0 < dt < math.inf else self.period_s)
            return self._invalid()

        self._wait(dt)
        gaps = np.where(came, self.since, 0.0)
        self.since[came] = 0.0
        flags = Flag.LATE if gaps.max() > 1.5 * self.period_s else Flag(0)
        if absent is not None:
            flags |= Flag.BRIDGED
        too_long = gaps > BRIDGED_PERIODS * self.period_s
        if np.count_nonzero(too_long & (self.alignment.count > 0)):
            flags |= Flag.RESTARTED
            self.restart(too_long)
        self.alignment.push(samples, gaps)
        if np.count_nonzero(self.alignment.ready) and self.alignment.count.all():
            made = self._advance(
                dt, gaps, absent, flags, self.elapsed if time_s is None else time_s
            )
            if not self._is_finite(made):
                # The state would never become finite again.
                self.restart()
                self._still(self._last.q, Flag.STARTING)
                return self._invalid()
            self._last = made
        else:
            known = np.where(np.isfinite(link_position), link_position, self._last.q)
            self._last = self._still(known, flags | Flag.STARTING)
        return self._last

    def _wait(self, dt: float) -> None:
        self.elapsed += dt
        self.since += dt

    def reset(self) -> None:
        """Forget external torque and contacts: r = 0. Positions and velocities are kept, so that
        nothing jumps."""
        self.residual.reset()
        self._threshold_raise.friction[:] = 0.0
        self.detector.reset()

    def restart(self, joints: NDArray[np.bool_] | None = None) -> None:
        """Forget all samples of these joints (n,), by default of all, and with them where their
        rotors are in their gaps."""
        joints = self._every if joints is None else joints
        self.residual.reset(joints)
        self._threshold_raise.friction[joints] = 0.0
        self.detector.reset(joints)
        self.alignment.restart(joints)
        self.interval.restart(joints)
        self.stiction.restart(joints)
        self._aligned[:, joints] = 0.0
        self._going &= ~joints

    def _is_finite(self, made: Estimate) -> bool:
        """True where no value is infinite or NaN, by one sum: inf and -inf make NaN. phi stands for
        q and theta."""
        shown = made.q_dot + made.tau_M
        shown += made.phi
        shown += made.phi_sigma
        shown += made.threshold
        return math.isfinite(shown.sum() + self.residual.values.sum())

    def _invalid(self) -> Estimate:
        return replace(
            self._last, contacts=(), flags=Flag.INVALID, sensing=np.zeros_like(self._every)
        )

    def _advance(
        self, dt: float, gaps: Vector, absent: NDArray[np.bool_] | None, flags: Flag, time_s: float
    ) -> Estimate:
        """Estimate dt [s] after the one before; gaps: since the last sample of each joint (n,) [s],
        0 for those that are `absent`."""
        t, (q, q_dot, current, theta_dot, theta) = self.transmission, self._aligned
        # No link goes on for ever.
        carried = np.where(self.since <= BRIDGED_PERIODS * self.period_s, dt, 0.0)
        self.alignment.aligned(self._aligned, carried, absent)
        going = self._going
        began = going.all()
        if not began:
            flags |= Flag.STARTING
            self._going = going | self.alignment.ready
            gaps = gaps * going
            for i in np.flatnonzero(~going).tolist():
                self.motor_position.start(i, float(q[i]))
        self.interval.begin()
        now = self.interval.now
        tau_M = now[ROW["tau_M"]]
        np.multiply(t.torque_constant, current, out=tau_M)
        np.multiply(t.rotor_inertia, theta_dot, out=now[ROW["rotor"]])
        now[ROW["momentum"]], now[ROW["beta"]] = self.model.dynamics(q, q_dot)
        now[ROW["theta_dot"]], now[ROW["theta"]] = theta_dot, theta
        self._friction.at(q_dot, theta_dot, out=now[FRICTIONS])
        rest = resting(theta_dot)
        if self._measured:
            turned = (gaps > 0.0) * (theta - self.interval.before[ROW["theta"]])
        else:
            moved = going * (q - self._shown[0])
            turned = displacement(theta_dot, q_dot, moved, self._has_gap, gaps)
        self.stiction.step(turned, smooth_sign(theta_dot, t.sign_width))
        np.multiply(self._coulomb, self.stiction.held, out=now[ROW["stiction"]])
        if absent is not None or not began:
            self.interval.start(~going)
            self.interval.keep((gaps == 0.0) & going)
        self._balance(q, q_dot, theta_dot, tau_M, rest, gaps)
        side = np.asarray(self.motor_position.side)
        periods = gaps / self.period_s if Flag.LATE in flags else None
        if periods is not None and periods.max() > RAISED_PERIODS:
            flags |= Flag.RAISED
        raised = self._threshold_raise
        raised.rub(rest, self.stiction.unknown, gaps, (gaps > 0.0) | ~going)
        hidden = raised.at(side, periods)
        threshold = self.detector.thresholds(hidden, raised.friction, theta_dot, dt)
        late = None if periods is None else periods > 1.5
        contacts = self.detector.step(self.residual.values[0], side, time_s, absent, late)
        self._show(q, q_dot, tau_M, threshold)
        sensing = going & (self.since <= SENSED_PERIODS * self.period_s)
        return self._estimate(contacts, flags, sensing)

    def _balance(
        self, q: Vector, q_dot: Vector, theta_dot: Vector, tau_M: Vector, rest: Vector, dt: Vector
    ) -> None:
        """Motor position and residual over the intervals dt (n,) [s] that end now; where dt is 0
        none does."""
        impulses = self.interval.step(dt)
        lasts = np.where(dt > 0.0, dt, 1.0)
        rotor, transmitted = impulses[_TORQUE_ROWS] / lasts
        advance = impulses[_ADVANCE_ROW]
        motion = np.array([q, q_dot, theta_dot, rest, tau_M, advance, rotor, transmitted])
        # Those without an interval: r is kept whether they are engaged or not.
        engaged = [
            float(not dt[i] or self.motor_position.step(i, dt[i], *motion[:, i]))
            for i in range(len(dt))
        ]
        errors = impulses[_RESIDUAL_ROWS]
        if self._correcting:
            t = self.transmission
            delta = penetration(q - np.asarray(self.motor_position.theta), t.half_gap)
            correction = t.contact_stiffness * delta + t.contact_damping * (q_dot - theta_dot)
            errors[self.residual.engaged] -= dt * self._corrected * correction
        self.residual.step(errors, np.array(engaged), dt)

    def _still(self, q: Vector, flags: Flag) -> Estimate:
        """Estimate without a velocity yet: no residual."""
        zero = np.zeros(self.model.n)
        for i in range(len(q)):
            self.motor_position.start(i, q[i])
        threshold = self.detector.thresholds(self._threshold_raise.most, 0.0, zero, self.period_s)
        self._show(q, zero, zero, threshold)
        return self._estimate((), flags, ~self._every)

    def _show(self, q: Vector, q_dot: Vector, tau_M: Vector, threshold: Vector) -> None:
        shown = self._shown
        shown[0], shown[1], shown[2], shown[3] = q, q_dot, tau_M, threshold

    def _estimate(
        self, contacts: tuple[Contact, ...], flags: Flag, sensing: NDArray[np.bool_]
    ) -> Estimate:
        position = self.motor_position
        q, q_dot, tau_M, threshold = self._shown.copy()
        residuals = self.residual.values.copy()
        theta = np.array(position.theta)
        thresholded = dead_band(residuals[0], threshold)
        return Estimate(
            q=q,
            q_dot=q_dot,
            theta=theta,
            phi=q - theta,
            phi_sigma=np.array(position.sigma),
            side=np.array(position.side, dtype=np.int8),
            tau_M=tau_M,
            residual=residuals[0],
            beside={name: residuals[row] for row, name in self._beside},
            threshold=threshold,
            thresholded=thresholded,
            level_share=np.ones(len(q)),
            uncorrected=residuals[0],
            contacts=contacts,
            touched_link=self._touched_link(residuals[0], threshold)
            if np.count_nonzero(thresholded)
            else "",
            flags=flags,
            wrench=np.zeros(0),
            sensing=sensing,
        )

    def _touched_link(self, residual: Vector, threshold: Vector) -> str:
        # A residual that stiction may explain near rest is no sign of a touch.
        link = touched_link(dead_band(residual, threshold - self._contact), self._contact)
        return "" if link is None else self.model.names[link]
