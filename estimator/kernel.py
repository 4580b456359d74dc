# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""One tick of the estimator as a loop over joints; numbers in brackets are the paper's equations.

Values that are not finite raise nothing here: the tick is discarded, and everything restarts.
"""

import numpy as np

from common.elementary import decay
from estimator.adaptation import Adaptation
from estimator.arrivals import Arrivals
from estimator.contact_detector import ContactDetector
from estimator.doubt import Doubt
from estimator.dynamics import Dynamics, Place
from estimator.estimate import Flag
from estimator.interval import Interval
from estimator.learning import Learning
from estimator.levels import Levels
from estimator.link_velocity import SAMPLES, Alignment
from estimator.motor_position import MotorPosition, Side
from estimator.residual import Residual
from estimator.settings import EstimatorSettings
from estimator.stiction import Stiction, displacement
from estimator.thresholds import Thresholds
from estimator.torques import Torques
from estimator.transmission import REST_VELOCITY, Transmission
from estimator.wrench import Wrench

# For the compiler.
_SAMPLES, _REST_VELOCITY = SAMPLES, REST_VELOCITY
_STOP = 0.01  # [rad]; nearer to the end of its range a link may rest on its stop
_SIDE_GAP, _SIDE_UNKNOWN = int(Side.GAP), int(Side.UNKNOWN)
_INVALID, _STARTING, _RESTARTED = int(Flag.INVALID), int(Flag.STARTING), int(Flag.RESTARTED)
_ROTOR, _THETA, _THETA_DOT, _TAU_M, _MOTOR_FRICTION = 1, 2, 3, 5, 6  # rows of `interval.TERMS`


class Kernel:
    """Parts of an estimator, and their step. The caller writes `alignment.samples`, and `arrived`
    (n,), 1 for a joint with a sample; and reads `shown` (10, n) and the parts."""

    def __init__(
        self,
        dynamics: Dynamics,
        transmission: Transmission,
        settings: EstimatorSettings,
        thresholds: Thresholds,
        period_s: float,
        tool: Place,
    ) -> None:
        t, s = transmission, settings
        n = self.n = t.n
        self._dynamics = dynamics
        self.alignment = Alignment(n, s, period_s)
        self.arrivals = Arrivals(self.alignment, n, period_s)
        self.arrived, self.since = self.arrivals.arrived, self.arrivals.since
        self.interval = Interval(n)
        self._measured = s.motor_position == "measured"
        self.motor_position = MotorPosition(t, s.gap, self._measured)
        self.stiction = Stiction(n, s.presliding, t.least_stiction, t.most_stiction)
        self.residual = Residual((s.residual, *s.beside), s.gain, period_s, n)
        self.levels = Levels(t, thresholds, s)
        self.detector = ContactDetector(t.joints, self.levels, s.debounce)
        self.torques = Torques(dynamics, self.stiction, self.interval, t)
        self.learning = Learning(thresholds, t.load_friction, t.load_friction_error)
        self.doubt = Doubt(n)
        self.learns = s.learning
        self.adaptation = Adaptation(
            self.learns, self.learning, self.doubt, self.alignment, self.interval, self.torques,
            self.motor_position, self.residual, self.levels, self.detector,
        )  # fmt: skip
        self.wrench = Wrench(dynamics, tool, s.gain, s.learning)
        # Position limits: a residual does not show what a mechanical stop carries.
        self.lower, self.upper = np.full(n, -np.inf), np.full(n, np.inf)
        self._always_acts = not s.residual.engages
        for i in range(n):
            self.adaptation.apply(i)
        self._period = period_s
        # Joints whose interval has a beginning, and joints that sense.
        self.going, self.sensing = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.uint8)
        self.begun = 0  # contacts that begin in this tick
        self.touched_link = -1  # index of its joint, -1 if none or unknown
        self._pressed = 0  # joints whose thresholded residual is not zero
        # Joints that cross their gap in this tick, and the number of those that left it.
        self._crossing, self._landed = np.zeros(n, dtype=np.int64), 0
        self.transmitted = np.zeros(n)  # torque, mean over the last interval [Nm]
        self.elapsed_s = 0.0
        self.shown = np.zeros((10, n))
        self.q, self.q_dot, self._theta, self._phi = self.shown[:4]
        self._sigma, self.tau_M, self.threshold, self._thresholded, self._share = self.shown[4:9]
        self._uncorrected = self.shown[9]
        for i in range(n):
            self._still(i, 0.0)

    def step(self, dt: float) -> int:
        """Process the samples of one tick, dt [s] after the previous one. Returns its `Flag`s; with
        INVALID, the outputs are not valid."""
        valid = self.arrivals.tick(dt)
        self.elapsed_s += self.arrivals.step(dt)
        self.begun = self._pressed = 0
        self.touched_link = -1
        if not valid:
            return _INVALID
        flags = self._take()
        if flags & _STARTING:
            for i in range(self.n):
                known = self.alignment.samples[3, i]
                self._still(i, known if known - known == 0.0 else self.q[i])
            self.wrench.nothing()
            return flags
        flags |= self._advance(dt)
        if flags & _INVALID:
            # The state would stay non-finite.
            for i in range(self.n):
                self.restart(i)
                self._still(i, self.q[i])
            self.wrench.nothing()
        return flags

    def restart(self, i: int) -> None:
        """Forget all samples of joint i, and with them its rotor's position in the gap."""
        self.reset(i)
        self.alignment.restart(i)
        self.interval.restart(i)
        self.stiction.restart(i)
        self.going[i] = 0

    def reset(self, i: int) -> None:
        """Forget external torque and contacts of joint i."""
        self.residual.reset(i)
        self.levels.reset(i)
        self.detector.reset(i)
        self.learning.reset(i)
        self.doubt.reset(i)

    def resume(self) -> None:
        """Recompute the outputs from a state that was written from outside."""
        self._pressed, self.touched_link = 0, -1
        for i in range(self.n):
            self.sensing[i] = 0
            self.residual.correct(i, self.learning.correction[i])
            self.adaptation.apply(i)
            speed = abs(self.interval.begin[_THETA_DOT, i])
            self.levels.add_up(i, self.adaptation.unlearned(i), speed)
            self._show(i)
        if self._pressed:
            self.touched_link = self.detector.touched_link(self.residual.corrected[0])

    def _take(self) -> int:
        """Append this tick's samples to the history; returns flags, STARTING while too few."""
        flags = 0
        for i in range(self.n):
            flag = self.arrivals.gap(i)
            if flag & _RESTARTED:
                self.restart(i)
            if self.arrived[i]:
                self.alignment.push(i, self.arrivals.gaps[i])
            flags |= flag
        return flags | self.arrivals.starting()

    def _still(self, i: int, q: float) -> None:
        """Set joint i, which has no velocity yet, to zero residual and the highest threshold."""
        self.motor_position.start(i, q)
        most = self.levels.friction_at(i, 1.0, 1.0, 1.0, 0.0)
        most += self.levels.uncertainty(i, True, True, True, 0.0)
        self._put_in_force(i, most, 0.0, self._period)
        self.q[i], self.q_dot[i], self.tau_M[i] = q, 0.0, 0.0
        self.sensing[i] = 0
        self._show(i)

    def _advance(self, dt: float) -> int:
        """Estimate dt [s] after the previous tick; returns flags."""
        flags, bridged, everything = 0, False, 0.0
        self._landed = 0
        for i in range(self.n):
            self.wrench.before[i] = self.residual.corrected[0, i]
            if self.arrived[i]:
                self.alignment.align(i)
            elif self.arrivals.bridged(i):  # extrapolation is limited
                self.alignment.carry(i, dt)
            if not self.going[i]:
                flags |= _STARTING
                self.motor_position.start(i, self.alignment.aligned[0, i])
                self.arrivals.gaps[i] = 0.0
            flags |= self.arrivals.raised(i)
            bridged = bridged or not self.arrived[i]
        self._dynamics.at(self.alignment.aligned[0], self.alignment.aligned[1])
        for i in range(self.n):
            everything += self._joint(i, self.arrivals.gaps[i])
        for i in range(self.n):
            if self.arrived[i]:
                self.adaptation.compare(i, dt)
        for i in range(self.n):
            everything += self._judge(i, self.arrivals.gaps[i], dt, bridged)
        if everything - everything != 0.0:
            return _INVALID
        for i in range(self.n):
            self.sensing[i] = self.going[i] and self.arrivals.senses(i)
            self.going[i] = self.going[i] or self.alignment.count[i] >= _SAMPLES
            self.q[i], self.q_dot[i] = self.alignment.aligned[0, i], self.alignment.aligned[1, i]
            self._show(i)
        if self._pressed:
            self.touched_link = self.detector.touched_link(self.residual.corrected[0])
        self._weigh(dt)
        return flags

    def _weigh(self, dt: float) -> None:
        """Estimate the force at the tool from all joints."""
        levels, moves = self.levels, False
        for i in range(self.n):
            share = levels.share[i]
            unlearned = share * self.learning.unknown[i] if self.learns else 0.0
            free = self.lower[i] + _STOP < self.q[i] < self.upper[i] - _STOP
            self.wrench.weigh(
                i, self.residual.corrected[0, i], dt, share * levels.configured(i, 0.0),
                levels.friction[i], levels.raised[i], unlearned, self.transmitted[i],
                self.sensing[i] != 0 and free,
            )  # fmt: skip
            moves = moves or abs(self.alignment.aligned[3, i]) > _REST_VELOCITY
        self.wrench.step(dt, self._pressed > 0, moves and not self.adaptation.frozen)

    def _joint(self, i: int, gap: float) -> float:
        """Residuals of joint i from its aligned samples. gap: since its last sample [s], 0 without
        one. Returns a sum that is finite if everything is."""
        a, position, levels = self.alignment.aligned, self.motor_position, self.levels
        q, q_dot, current, theta_dot, theta = a[0, i], a[1, i], a[2, i], a[3, i], a[4, i]
        tau_M = self.torques.K_c[i] * current
        at_rest = theta_dot / _REST_VELOCITY
        rest = decay(at_rest * at_rest)
        if self._measured:
            turned = theta - self.interval.begin[_THETA, i] if gap > 0.0 else 0.0
        else:
            moved = q - self.q[i] if self.going[i] else 0.0
            turned = displacement(theta_dot, q_dot, moved, self.torques.alpha[i] > 0.0, gap)
        side = position.side[i]
        self.torques.at(i, q_dot, theta_dot, theta, tau_M, turned)
        self.tau_M[i] = tau_M
        load = self.adaptation.load_friction(i, tau_M)
        levels.set_friction(i, rest, self.stiction.unknown[i], position.friction[i], load)
        if gap > 0.0:
            self._balance(i, gap, q, q_dot, theta_dot, rest, tau_M)
        if gap > 0.0 or not self.going[i]:
            self.interval.end(i)
            levels.end(i)
        in_gap, came_from = position.side[i] == _SIDE_GAP, side == _SIDE_GAP
        self._crossing[i] = in_gap or position.side[i] != side
        self._landed += came_from and not in_gap
        everything = q + q_dot + tau_M + position.theta[i] + position.sigma[i]
        return float(everything + self.residual.sum(i))

    def _judge(self, i: int, gap: float, dt: float, bridged: bool) -> float:
        """Levels and contacts of joint i, once all joints have their residuals. bridged: samples of
        some joint are missing. Returns the contact level [Nm]."""
        self.adaptation.apply(i)
        unknown = self.motor_position.side[i] == _SIDE_UNKNOWN
        crossing, shaken = self._crossing[i] != 0, self._landed > 0
        uncertainty = self.levels.uncertainty(i, unknown, crossing, shaken, gap / self._period)
        self._put_in_force(i, uncertainty, abs(self.alignment.aligned[3, i]), dt)
        arrived = self.arrived[i] != 0
        waits = bridged or self.arrivals.late(i)
        begun = self.detector.step(i, self.residual.corrected[0, i], arrived, waits)
        if begun and self.motor_position.contradicted(i, self.alignment.aligned[3, i]):
            self.motor_position.start(i, self.alignment.aligned[0, i])
        self.begun += begun
        return float(self.threshold[i])

    def _put_in_force(self, i: int, uncertainty: float, speed: float, dt: float) -> None:
        """Update the levels of joint i, over dt [s]."""
        unknown = self.adaptation.unlearned(i)
        self.threshold[i] = self.levels.put_in_force(i, unknown, uncertainty, speed, dt)

    def _balance(
        self, i: int, dt: float, q: float, q_dot: float, theta_dot: float, rest: float, tau_M: float
    ) -> None:
        """Advance motor position and residuals of joint i over the interval of dt [s] that ends
        now."""
        self.interval.integrate(i, dt)
        x, position = self.interval.impulse, self.motor_position
        advance = x[_THETA] if self._measured else x[_THETA_DOT]
        rubs = position.friction[i] * x[_MOTOR_FRICTION]
        transmitted = self.transmitted[i] = (x[_TAU_M] - x[_ROTOR] - rubs) / dt
        touched = self.motor_position.step(
            i, dt, q, q_dot, theta_dot, rest, tau_M, advance, x[_ROTOR] / dt, transmitted
        )
        load = dt * abs(transmitted) * self.torques.slides(i, theta_dot)
        x[_MOTOR_FRICTION] += self.torques.load[i] * load
        spring = self.torques.spring(i, q - position.theta[i], q_dot - theta_dot)
        self.residual.step(i, x, dt * spring, touched, dt)
        self.levels.integrate(i, dt, self.residual.pole, self.residual.share)
        acts = touched or self._always_acts
        self.adaptation.learn(i, dt, theta_dot, load, self.threshold[i], acts)

    def _show(self, i: int) -> None:
        """Write the outputs of joint i from its state; the thresholded residual is continuous."""
        r, threshold = self.residual.corrected[0, i], self.threshold[i]
        self._theta[i], self._sigma[i] = self.motor_position.theta[i], self.motor_position.sigma[i]
        self._phi[i] = self.q[i] - self._theta[i]
        self._share[i], self._uncorrected[i] = self.levels.share[i], self.residual.values[0, i]
        self._thresholded[i] = r - min(max(r, -threshold), threshold)
        self._pressed += self._thresholded[i] != 0.0
