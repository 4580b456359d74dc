# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""One tick of the estimator as a loop over joints; numbers in brackets are the paper's equations.

Ordinary Python, which runs as it is; `kernel.pxd` names the types for the compiler, decision 0037.
What is not finite raises nothing here: the tick is taken back, and everything starts anew.
"""

import numpy as np

from arrays import Matrix
from estimator.dynamics import Dynamics
from estimator.elementary import decay, smooth_sign
from estimator.gap import Gap
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

INVALID, LATE, RESTARTED, STARTING, BRIDGED, RAISED = 1, 2, 4, 8, 16, 32  # `estimate.Flag`
SIDE_UNKNOWN = 2  # `motor_position.Side`
CREEP = 0.003
"""[rad/s]; a slower motor velocity may be noise and bias, and its integral nothing."""
LINK_REST = 0.01
"""[rad/s]; a link encoder's noise stays below it"""
REST_VELOCITY = 0.05  # [rad/s]
SHORTEST_S = 1e-9
#: A joint that was without a sample for longer senses nothing [periods]: its residual is old.
SENSED_PERIODS = 2.5
#: Over a longer gap nothing is bridged [periods]: Tustin's rule does not know what happened in it.
BRIDGED_PERIODS = 5.5
RAISED_PERIODS = 2.5
WAITS = 2
# Of the contact level, for each sample that was missing beyond the first, and at most: what the
# mean of both ends may be wrong by over an interval in which a motor crossed its gap.
MISSING_SHARE, MISSING_MOST = 0.4, 1.2
SAMPLES = 3  # positions needed before the first velocity
# Rows of `ends`, `interval.TERMS`: increments first.
MOMENTUM, ROTOR, THETA = 0, 1, 2
THETA_DOT, BETA, TAU_M, MOTOR_FRICTION, ENGAGED_LINK_FRICTION = 3, 4, 5, 6, 7
LINK_FRICTION, GAP_FRICTION, STICTION, TERMS = 8, 9, 10, 11


class Kernel:
    """State of the estimator, and its step. The caller writes `samples` (4, n): current, motor
    velocity, motor position, link position; and `came` (n,), 1 where a joint has a sample."""

    def __init__(
        self,
        transmission: Transmission,
        settings: EstimatorSettings,
        thresholds: Thresholds,
        dynamics: Dynamics,
        rotors: Gap,
        *,
        period_s: float,
        ages: tuple[float, float, float, float],
        always: Matrix,
        engaged: Matrix,
        corrected: Matrix,
    ) -> None:
        """ages [s]: of link position, current, motor velocity and motor position at the common
        instant; always, engaged: weights of TERMS in each variant's e(k), (variants, TERMS), at any
        time and while engaged; corrected: (variants,), 1 where a fit corrects tau_M."""
        t, s = transmission, settings
        n = self.n = t.n
        self._dynamics, self.rotors = dynamics, rotors
        self._period, self._gain, self._debounce = period_s, s.gain, s.debounce
        self._back, self._current_age, self._velocity_age, self._position_age = ages
        self._measured = s.motor_position == "measured"
        self._per_width, self._per_presliding = 1.0 / t.sign_width, 1.0 / s.presliding
        self._K_c, self._B = t.torque_constant.copy(), t.rotor_inertia.copy()
        self._alpha = t.half_gap.copy()
        self._motor_coulomb, self._motor_viscous = t.motor_coulomb.copy(), t.motor_viscous.copy()
        self._link_coulomb, self._link_viscous = t.link_coulomb.copy(), t.link_viscous.copy()
        self._gap_coulomb, self._gap_viscous = t.gap_coulomb.copy(), t.gap_viscous.copy()
        self._held = t.stiction * t.engaged_coulomb
        self._K_phi_p, self._K_phi_d = t.contact_stiffness.copy(), t.contact_damping.copy()
        self._contact, self._collision = thresholds.contact.copy(), thresholds.collision.copy()
        self._per_speed = thresholds.per_speed.copy()
        self._raise_at_rest = s.stiction_share * t.engaged_coulomb
        self._raise_unsure = s.unknown_side_share * thresholds.contact * (t.half_gap > 0.0)
        self._always, self._engaged, self._corrected = always, engaged, corrected
        self._variants = len(corrected)

        self.samples, self.came = np.zeros((4, n)), np.ones(n, dtype=np.int64)
        self._gaps = np.zeros(n)
        self.since = np.zeros(n)
        self.count, self.going, self.sensing = np.zeros((3, n), dtype=np.int64)
        self.interval, self.interval_before = np.full((2, n), period_s)
        # Three samples, newest first, of the rows of `samples`.
        self.history = np.zeros((SAMPLES, 4, n))
        self.aligned = np.zeros((5, n))  # link position and velocity, current, theta_dot, theta
        self.ends = np.zeros((TERMS, n))
        self._now, self._impulse = np.zeros((2, TERMS))
        self.stiction = np.repeat([[-1.0], [1.0]], n, axis=1)
        self.residual = np.zeros((len(corrected), n))
        self.raised, self.above = np.zeros((2, n))
        self.streak, self.waited, self.begins = np.zeros((3, 2, n), dtype=np.int64)
        shown = np.zeros((8, n))
        self.shown = shown
        self.q, self.q_dot, self._theta, self._phi = shown[:4]
        self._sigma, self.tau_M, self.threshold, self._thresholded = shown[4:]

    def step(self, dt: float) -> int:
        """Take the samples of one tick, dt [s] after the one before. Returns its `Flag`s; with
        INVALID, what is shown is of no use."""
        everything = dt
        for i in range(self.n):
            if self.came[i]:
                for row in range(4):
                    everything += self.samples[row, i]
        valid = everything - everything == 0.0 and dt > 0.0
        step = dt if dt > 0.0 and dt - dt == 0.0 else self._period
        for i in range(self.n):
            self.since[i] += step
        if not valid:
            return INVALID
        flags = self._take()
        if flags & STARTING:
            for i in range(self.n):
                known = self.samples[3, i]
                self.still(i, known if known - known == 0.0 else self.q[i])
            return flags
        flags |= self._advance(dt)
        if flags & INVALID:
            # The state would never become finite again.
            for i in range(self.n):
                self.restart(i)
                self.still(i, self.q[i])
        return flags

    def _take(self) -> int:
        """Put this tick's samples to those before; STARTING where they do for no joint yet."""
        flags, ready, counted = 0, False, True
        for i in range(self.n):
            self._gaps[i] = 0.0
            if self.came[i]:
                self._gaps[i], self.since[i] = self.since[i], 0.0
                if self._gaps[i] > 1.5 * self._period:
                    flags |= LATE
                if self._gaps[i] > BRIDGED_PERIODS * self._period and self.count[i] > 0:
                    flags |= RESTARTED
                    self.restart(i)
                self._push(i, self._gaps[i])
            else:
                flags |= BRIDGED
            ready = ready or self.count[i] >= SAMPLES
            counted = counted and self.count[i] > 0
        return flags if ready and counted else flags | STARTING

    def restart(self, i: int) -> None:
        """Forget all samples of joint i, and with them where its rotor is in its gap."""
        self.reset(i)
        self.count[i] = self.going[i] = 0
        for row in range(4):
            for k in range(SAMPLES):
                self.history[k, row, i] = 0.0
        for row in range(5):
            self.aligned[row, i] = 0.0
        for row in range(TERMS):
            self.ends[row, i] = 0.0
        self.stiction[0, i], self.stiction[1, i] = -1.0, 1.0

    def reset(self, i: int) -> None:
        """Forget external torque and contacts of joint i."""
        for row in range(self._variants):
            self.residual[row, i] = 0.0
        self.raised[i] = self.above[i] = 0.0
        self.streak[0, i] = self.streak[1, i] = 0
        self.waited[0, i] = self.waited[1, i] = 0

    def still(self, i: int, q: float) -> None:
        """Joint i without a velocity yet: no residual, the highest threshold."""
        self.rotors.start(i, q)
        most = self._raise_at_rest[i] + self._held[i] + self._raise_unsure[i]
        self._raise(i, most, 0.0, self._period)
        self.q[i], self.q_dot[i], self.tau_M[i] = q, 0.0, 0.0
        self.sensing[i] = self.begins[0, i] = self.begins[1, i] = 0
        self._show(i)

    def resume(self) -> None:
        """Go on from a state that was written from outside."""
        for i in range(self.n):
            self.above[i], self.sensing[i] = self.raised[i], 0
            self._show(i)

    def _show(self, i: int) -> None:
        """What follows from the state of joint i; the thresholded residual has no jump."""
        r, threshold = self.residual[0, i], self.threshold[i]
        self._theta[i], self._sigma[i] = self.rotors.theta[i], self.rotors.sigma[i]
        self._phi[i] = self.q[i] - self._theta[i]
        self._thresholded[i] = r - min(max(r, -threshold), threshold)

    def _push(self, i: int, dt: float) -> None:
        """Take the sample of joint i, dt [s] after the one before."""
        for row in range(4):
            for k in range(SAMPLES - 1, 0, -1):
                self.history[k, row, i] = self.history[k - 1, row, i]
            self.history[0, row, i] = self.samples[row, i]
        self.interval_before[i] = self.interval[i]
        self.interval[i] = dt
        if self.count[i] == 0:
            # As if the link had moved with its motor before.
            self.interval[i] = self.interval_before[i] = self._period
            for k in range(1, SAMPLES):
                turned = k * self._period * self.samples[1, i]
                self.history[k, 0, i], self.history[k, 1, i] = (
                    self.samples[0, i],
                    self.samples[1, i],
                )
                self.history[k, 2, i] = self.samples[2, i] - turned
                self.history[k, 3, i] = self.samples[3, i] - turned
        self.count[i] = min(self.count[i] + 1, SAMPLES)

    def _align(self, i: int, dt: float) -> None:
        """Bring the samples of joint i to the common instant, `link_velocity`; without one it goes
        on as it did, but not for ever."""
        a = self.aligned
        if not self.came[i]:
            if self.since[i] <= BRIDGED_PERIODS * self._period:
                a[0, i] += a[1, i] * dt
                a[4, i] += a[3, i] * dt
            return
        # Newton's form of the parabola: slope of the last interval, and the curvature.
        h, before, back = self.interval[i], self.interval_before[i], self._back
        newest, second, third = self.history[0, 3, i], self.history[1, 3, i], self.history[2, 3, i]
        slope = (newest - second) / h
        curvature = (slope - (second - third) / before) / (h + before)
        a[0, i] = newest - back * slope - back * (h - back) * curvature
        a[1, i] = slope + (h - 2.0 * back) * curvature
        a[2, i] = self._earlier(i, 0, self._current_age / h)
        a[3, i] = self._earlier(i, 1, self._velocity_age / h)
        a[4, i] = self._earlier(i, 2, self._position_age / h)

    def _earlier(self, i: int, row: int, share: float) -> float:
        """A signal this share of the last interval before its newest sample."""
        newest = self.history[0, row, i]
        return float(newest + (self.history[1, row, i] - newest) * share)

    def _advance(self, dt: float) -> int:
        """Estimate dt [s] after the one before; returns flags."""
        flags, beside = 0, False
        for i in range(self.n):
            self._align(i, dt)
            if not self.going[i]:
                flags |= STARTING
                self.rotors.start(i, self.aligned[0, i])
                self._gaps[i] = 0.0
            if self._gaps[i] > RAISED_PERIODS * self._period:
                flags |= RAISED
            beside = beside or not self.came[i]
        self._dynamics.at(self.aligned[0], self.aligned[1])
        everything = 0.0
        for i in range(self.n):
            everything += self._joint(i, self._gaps[i], dt, beside)
        if everything - everything != 0.0:
            return INVALID
        for i in range(self.n):
            going = self.going[i] and self.since[i] <= SENSED_PERIODS * self._period
            self.sensing[i] = going
            self.going[i] = self.going[i] or self.count[i] >= SAMPLES
            self.q[i], self.q_dot[i] = self.aligned[0, i], self.aligned[1, i]
            self._show(i)
        return flags

    def _joint(self, i: int, gap: float, dt: float, beside: bool) -> float:
        """From the aligned samples of joint i to its residuals, levels and contacts. gap: since its
        last sample [s], 0 without one. Returns a sum that is finite if everything is."""
        a, now = self.aligned, self._now
        q, q_dot, theta_dot, theta = a[0, i], a[1, i], a[3, i], a[4, i]
        tau_M = self._K_c[i] * a[2, i]
        at_rest = theta_dot / REST_VELOCITY
        rest = decay(at_rest * at_rest)
        sign = smooth_sign(theta_dot * self._per_width)
        z = self._presliding(i, gap, q - self.q[i])

        # Torques and momenta at the common instant, (6) in its parts.
        now[MOMENTUM], now[BETA] = self._dynamics.momentum[i], self._dynamics.beta[i]
        now[ROTOR], now[THETA], now[THETA_DOT] = self._B[i] * theta_dot, theta, theta_dot
        now[TAU_M] = tau_M
        now[MOTOR_FRICTION] = self._motor_coulomb[i] * sign + self._motor_viscous[i] * theta_dot
        now[ENGAGED_LINK_FRICTION] = (
            self._link_coulomb[i] * sign + self._link_viscous[i] * theta_dot
        )
        now[LINK_FRICTION] = (
            self._link_coulomb[i] * smooth_sign(q_dot * self._per_width)
            + self._link_viscous[i] * q_dot
        )
        phi_dot = q_dot - theta_dot
        now[GAP_FRICTION] = (
            self._gap_coulomb[i] * smooth_sign(phi_dot * self._per_width)
            + self._gap_viscous[i] * phi_dot
        )
        now[STICTION] = self._held[i] * (z - sign)
        if gap > 0.0:
            self._balance(i, gap, q, q_dot, theta_dot, rest, tau_M)
        if gap > 0.0 or not self.going[i]:
            for row in range(TERMS):
                self.ends[row, i] = now[row]

        # What friction, an unknown side and missing samples may hide or pretend.
        unknown = 0.5 * (self.stiction[1, i] - self.stiction[0, i])
        hidden = (self._held[i] * unknown + self._raise_at_rest[i]) * rest
        if self.rotors.side[i] == SIDE_UNKNOWN:
            hidden += self._raise_unsure[i]
        missing = max(gap / self._period - 2.0, 0.0)
        hidden += min(missing * MISSING_SHARE, MISSING_MOST) * self._contact[i]
        self._raise(i, hidden, abs(theta_dot), dt)
        self._detect(i, beside)
        self.tau_M[i] = tau_M
        everything = q + q_dot + tau_M + self.rotors.theta[i] + self.rotors.sigma[i]
        for row in range(self._variants):
            everything += self.residual[row, i]
        return float(everything + self.threshold[i])

    def _presliding(self, i: int, gap: float, moved: float) -> float:
        """z of joint i, `stiction`, after the displacement of its rotor: as measured, or that of
        its link, `moved` [rad], where both creep or there is no gap: an encoder does not drift."""
        theta_dot, q_dot = self.aligned[3, i], self.aligned[1, i]
        if self._measured:
            turned = self.aligned[4, i] - self.ends[THETA, i] if gap > 0.0 else 0.0
        elif self._alpha[i] > 0.0 and (abs(theta_dot) > CREEP or abs(q_dot) > LINK_REST):
            turned = theta_dot * gap
        else:
            turned = moved if self.going[i] else 0.0
        for end in range(2):
            z = self.stiction[end, i] + turned * self._per_presliding
            self.stiction[end, i] = min(max(z, -1.0), 1.0)
        return float(0.5 * (self.stiction[0, i] + self.stiction[1, i]))

    def _balance(
        self,
        i: int,
        dt: float,
        q: float,
        q_dot: float,
        theta_dot: float,
        rest: float,
        tau_M: float,
    ) -> None:
        """Motor position and residuals of joint i over its interval of dt [s] that ends now."""
        x, rotors = self._impulse, self.rotors
        for row in range(TERMS):
            if row <= THETA:
                x[row] = self._now[row] - self.ends[row, i]
            else:
                x[row] = 0.5 * dt * (self._now[row] + self.ends[row, i])
        before = rotors.gap[i]
        advance = x[THETA] if self._measured else x[THETA_DOT]
        transmitted = (x[TAU_M] - x[ROTOR] - x[MOTOR_FRICTION]) / dt
        rotors.step(i, dt, q, q_dot, theta_dot, rest, tau_M, advance, x[ROTOR] / dt, transmitted)
        # (5): what a fit adds to tau_M while engaged, over the penetration delta.
        phi = q - rotors.theta[i]
        delta = phi - min(max(phi, -self._alpha[i]), self._alpha[i])
        spring = dt * (self._K_phi_p[i] * delta + self._K_phi_d[i] * (q_dot - theta_dot))
        TK = self._gain * dt
        # Beyond TK = 2 the pole stays at zero: the residual is the mean of the interval.
        pole = max((2.0 - TK) / (2.0 + TK), 0.0)
        share = min(2.0 * self._gain / (2.0 + TK), 1.0 / max(dt, SHORTEST_S))
        for k in range(self._variants):
            e, engaged = 0.0, -self._corrected[k] * spring
            for row in range(TERMS):
                e += self._always[k, row] * x[row]
                engaged += self._engaged[k, row] * x[row]
            # In the gap only if at both ends of the interval.
            if not (before and rotors.gap[i]):
                e += engaged
            self.residual[k, i] = pole * self.residual[k, i] + share * e  # (13)

    def _raise(self, i: int, hidden: float, speed: float, dt: float) -> None:
        """Levels of joint i in force: raised by what is `hidden` [Nm]. After break-away friction
        still builds up while the residual forgets, so the raise fades with half its gain."""
        self.raised[i] = max(self.raised[i] * decay(0.5 * self._gain * dt), hidden)
        self.above[i] = self.raised[i] + self._per_speed[i] * speed
        self.threshold[i] = self._contact[i] + self.above[i]

    def _detect(self, i: int, beside: bool) -> None:
        """Count the samples of joint i in a row past each level, signed; mark contacts that begin.
        Without a sample what counted before stays. `beside` a missing sample a contact waits."""
        r = self.residual[0, i]
        for k in range(2):
            level = self.above[i] + (self._contact[i] if k == 0 else self._collision[i])
            past = 1 if r > level else (-1 if r < -level else 0)
            begins = False
            if self.came[i]:
                streak = past
                if past * self.streak[k, i] > 0:
                    streak += self.streak[k, i]
                begins = abs(streak) == self._debounce
                if begins and beside and self.waited[k, i] < WAITS:
                    self.waited[k, i] += 1
                    begins = False
                else:
                    self.streak[k, i] = streak
            if past == 0 or begins:
                self.waited[k, i] = 0
            self.begins[k, i] = begins
