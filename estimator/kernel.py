# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""One tick of the estimator as a loop over joints; numbers in brackets are the paper's equations.

Ordinary Python, which runs as it is; `kernel.pxd` names the types for the compiler, decision 0037.
What is not finite raises nothing here: the tick is taken back, and everything starts anew.
"""

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from common.elementary import decay, smooth_sign
from estimator.contact_detector import ContactDetector
from estimator.doubt import FRICTION, GRAZED, Doubt
from estimator.dynamics import Dynamics, Place
from estimator.estimate import SENSED_PERIODS, Flag
from estimator.interval import Interval
from estimator.learning import Learning
from estimator.levels import Levels
from estimator.link_velocity import SAMPLES, Alignment
from estimator.motor_position import MotorPosition, Side
from estimator.residual import Residual
from estimator.settings import EstimatorSettings
from estimator.stiction import Stiction, displacement
from estimator.thresholds import Thresholds
from estimator.transmission import REST_VELOCITY, Transmission
from estimator.wrench import Wrench

# For the compiler.
_SAMPLES, _REST_VELOCITY = SAMPLES, REST_VELOCITY
_STOP = 0.01  # [rad]: nearer to the end of its range, a link may lean on its stop
_SETS_OUT = 0.01  # [rad/s]: a joint that is faster does not stand
_SIDE_GAP, _SIDE_UNKNOWN = int(Side.GAP), int(Side.UNKNOWN)
_SENSED_PERIODS = SENSED_PERIODS
_INVALID, _LATE, _RESTARTED = int(Flag.INVALID), int(Flag.LATE), int(Flag.RESTARTED)
_STARTING, _BRIDGED, _RAISED = int(Flag.STARTING), int(Flag.BRIDGED), int(Flag.RAISED)
_MOMENTUM, _ROTOR, _THETA, _THETA_DOT, _BETA = range(5)  # rows of `interval.TERMS`
_TAU_M, _MOTOR_FRICTION, _ENGAGED_LINK_FRICTION, _LINK_FRICTION, _GAP_FRICTION = range(5, 10)
_STICTION = 10
_GRAZED, _FRICTION = GRAZED, FRICTION
# An interval of so many periods is late; one of so many raises the levels of its joint: two samples
# were missing.
_LATE_PERIODS, _RAISED_PERIODS = 1.5, 2.5
# Over a longer gap nothing is bridged [periods]: Tustin's rule does not know what happened in it.
_BRIDGED_PERIODS = 5.5


class Kernel:
    """The parts of an estimator, and their step. The caller writes `alignment.samples`, and `came`
    (n,), 1 where a joint has a sample; and reads `shown` (10, n) and the parts."""

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
        self.interval = Interval(n)
        self._measured = s.motor_position == "measured"
        self.motor_position = MotorPosition(t, s.gap, self._measured)
        self.stiction = Stiction(n, s.presliding, t.least_stiction, t.most_stiction)
        self.residual = Residual((s.residual, *s.beside), s.gain, period_s, n)
        self.levels = Levels(t, thresholds, s)
        self.detector = ContactDetector(t.joints, self.levels, s.debounce)
        self.learning = Learning(thresholds, t.load_friction, t.load_friction_error)
        self.doubt = Doubt(n)
        self.learns = s.learning
        self.wrench = Wrench(dynamics, tool, s.gain, s.learning)
        # Ends of the links' ranges: what a stop carries, a residual does not show.
        self.lower, self.upper = np.full(n, -np.inf), np.full(n, np.inf)
        self.given_up = np.zeros(n, dtype=np.int64)  # how often learned friction was, of each joint
        self._always_acts = s.residual.kind != "backlash"
        self.frozen = 0  # 1: nothing is learned, whatever the residuals say
        if self.learns:
            for i in range(n):
                self._apply(i)
        self._period, self._per_width = period_s, 1.0 / t.sign_width
        self._K_c, self._B = t.torque_constant.copy(), t.rotor_inertia.copy()
        self._alpha, self._coulomb = t.half_gap.copy(), t.engaged_coulomb.copy()
        self._motor_coulomb, self._motor_viscous = t.motor_coulomb.copy(), t.motor_viscous.copy()
        self._link_coulomb, self._link_viscous = t.link_coulomb.copy(), t.link_viscous.copy()
        self._load = t.load_friction.copy()
        self._gap_coulomb, self._gap_viscous = t.gap_coulomb.copy(), t.gap_viscous.copy()
        self._K_phi_p, self._K_phi_d = t.contact_stiffness.copy(), t.contact_damping.copy()

        self.came = np.ones(n, dtype=np.int64)
        # Time since the sample of each joint that was used last, and between that and the one
        # before where it came in this tick, 0 where none did [s].
        self.since, self._gaps = np.zeros((2, n))
        # Joints whose interval has a beginning, and those that sense.
        self.going, self.sensing = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.uint8)
        self.begun = 0  # contacts that begin in this tick
        self.touched_link = -1  # index of its joint, -1 where none is, or not known
        self._pressed = 0  # joints whose thresholded residual is not zero
        # Joints that cross their gap in this tick, and how many left theirs.
        self._crossing, self._landed = np.zeros(n, dtype=np.int64), 0
        self.transmitted = np.zeros(n)  # by the gears, mean over the last interval [Nm]
        self.elapsed_s = 0.0
        # What the last link carries: mass [kg], and where in its joint's frame [m].
        self.payload = np.zeros(4)
        self.shown = np.zeros((10, n))
        self.q, self.q_dot, self._theta, self._phi = self.shown[:4]
        self._sigma, self.tau_M, self.threshold, self._thresholded, self._share = self.shown[4:9]
        self._uncorrected = self.shown[9]
        for i in range(n):
            self._still(i, 0.0)

    def step(self, dt: float) -> int:
        """Take the samples of one tick, dt [s] after the one before. Returns its `Flag`s; with
        INVALID, what is shown is of no use."""
        everything = dt
        for i in range(self.n):
            if self.came[i]:
                for row in range(4):
                    everything += self.alignment.samples[row, i]
        valid = everything - everything == 0.0 and dt > 0.0
        step = dt if dt > 0.0 and dt - dt == 0.0 else self._period
        for i in range(self.n):
            self.since[i] += step
        self.elapsed_s += step
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
            # The state would never become finite again.
            for i in range(self.n):
                self.restart(i)
                self._still(i, self.q[i])
            self.wrench.nothing()
        return flags

    def run(
        self,
        samples: NDArray[np.float64],
        came: NDArray[np.int64],
        dt: Vector,
        resets: NDArray[np.int64],
        shown: NDArray[np.float64],
        residuals: NDArray[np.float64],
        side: NDArray[np.int8],
        wrench: NDArray[np.float64],
        words: NDArray[np.int64],
    ) -> None:
        """Step through N ticks: samples (N, 4, n), came (N, n) and dt (N,), with a reset after a
        tick where `resets` (N,) is 1.

        What comes out goes to rows 1 to N of shown (N + 1, 10, n), residuals (N + 1, variants, n),
        side (N + 1, n), wrench (N + 1, WIDTH) and words (N + 1, 2): flags and touched link. Row 0
        is what was last; an INVALID tick repeats the row before.
        """
        for k in range(dt.shape[0]):
            for i in range(self.n):
                self.came[i] = came[k, i]
                for row in range(4):
                    self.alignment.samples[row, i] = samples[k, row, i]
            flags = self.step(dt[k])
            words[k + 1, 0] = flags
            if flags & _INVALID:
                words[k + 1, 0], words[k + 1, 1] = _INVALID, words[k, 1]
                shown[k + 1], residuals[k + 1], side[k + 1] = shown[k], residuals[k], side[k]
                wrench[k + 1] = wrench[k]
            else:
                words[k + 1, 1] = self.touched_link
                shown[k + 1], residuals[k + 1] = self.shown, self.residual.corrected
                side[k + 1], wrench[k + 1] = self.motor_position.side, self.wrench.shown
            if resets[k]:
                for i in range(self.n):
                    self.reset(i)

    def carry(self, payload: Vector) -> None:
        """Count another payload (4,) from now on. The residuals go on from what they are: momentum
        and beta at the beginning of each interval become those of the new model."""
        a, dynamics, begin = self.alignment.aligned, self._dynamics, self.interval.begin
        change = 0.0
        for k in range(4):
            change += abs(payload[k] - self.payload[k])
        if change == 0.0:
            return  # to the last bit
        dynamics.at(a[0], a[1])
        for i in range(self.n):
            begin[_MOMENTUM, i] -= self.going[i] * dynamics.momentum[i]
            begin[_BETA, i] -= self.going[i] * dynamics.beta[i]
        self.put_on(payload)
        dynamics.at(a[0], a[1])
        for i in range(self.n):
            begin[_MOMENTUM, i] += self.going[i] * dynamics.momentum[i]
            begin[_BETA, i] += self.going[i] * dynamics.beta[i]

    def put_on(self, payload: Vector) -> None:
        """Count the payload (4,) that the state written from outside already counts."""
        for k in range(4):
            self.payload[k] = payload[k]
        self._dynamics.carry(self.n - 1, payload[0], payload[1], payload[2], payload[3])

    def restart(self, i: int) -> None:
        """Forget all samples of joint i, and with them where its rotor is in its gap."""
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
        """Go on from a state that was written from outside."""
        self._pressed, self.touched_link = 0, -1
        for i in range(self.n):
            self.sensing[i] = 0
            self.residual.correct(i, self.learning.correction[i])
            if self.learns:
                self._apply(i)
            unknown = self._unknown(i) if self.learns else 0.0
            self.levels.add_up(i, unknown, abs(self.interval.begin[_THETA_DOT, i]))
            self._show(i)
        if self._pressed:
            self.touched_link = self.detector.touched_link(self.residual.corrected[0])

    def level_at(self, i: int, speed: float) -> float:
        """Contact level of joint i [Nm] that would be in force at a motor speed [rad/s], with what
        is known now. Changes nothing."""
        levels, at_rest, sign = self.levels, speed / _REST_VELOCITY, speed * self._per_width
        factor = self.motor_position.friction[i]
        unknown, rest = self.stiction.unknown_at_rest(i), decay(at_rest * at_rest)
        load = self._load_friction(i)
        above = levels.friction_at(i, rest, unknown * rest, factor, load)
        above += levels.unsure(i, self.motor_position.side[i] == _SIDE_UNKNOWN, False, False, 0.0)
        above += levels.share[i] * (levels.usual(i, speed) - levels.usual(i, 0.0))
        if self.learns:
            viscous = (self._motor_viscous[i] + self._link_viscous[i]) * speed
            slides = smooth_sign(sign)
            coulomb, load = self._coulomb[i] * slides, abs(self.transmitted[i]) * slides
            above += levels.share[i] * self.learning.unknown_at(i, coulomb, viscous, load)
        return float(levels.contact_at(i, above))

    def _take(self) -> int:
        """Put this tick's samples to those before; STARTING where they do for no joint yet."""
        flags, ready, counted = 0, False, True
        count = self.alignment.count
        for i in range(self.n):
            self._gaps[i] = 0.0
            if self.came[i]:
                self._gaps[i], self.since[i] = self.since[i], 0.0
                if self._gaps[i] > _LATE_PERIODS * self._period:
                    flags |= _LATE
                if self._gaps[i] > _BRIDGED_PERIODS * self._period and count[i] > 0:
                    flags |= _RESTARTED
                    self.restart(i)
                self.alignment.push(i, self._gaps[i])
            else:
                flags |= _BRIDGED
            ready = ready or count[i] >= _SAMPLES
            counted = counted and count[i] > 0
        return flags if ready and counted else flags | _STARTING

    def _still(self, i: int, q: float) -> None:
        """Joint i without a velocity yet: no residual, the highest threshold."""
        self.motor_position.start(i, q)
        most = self.levels.friction_at(i, 1.0, 1.0, 1.0, 0.0)
        most += self.levels.unsure(i, True, True, True, 0.0)
        self._put_in_force(i, most, 0.0, self._period)
        self.q[i], self.q_dot[i], self.tau_M[i] = q, 0.0, 0.0
        self.sensing[i] = 0
        self._show(i)

    def _advance(self, dt: float) -> int:
        """Estimate dt [s] after the one before; returns flags."""
        flags, bridged, everything = 0, False, 0.0
        self._landed = 0
        for i in range(self.n):
            self.wrench.before[i] = self.residual.corrected[0, i]
            if self.came[i]:
                self.alignment.align(i)
            elif self.since[i] <= _BRIDGED_PERIODS * self._period:  # no link goes on for ever
                self.alignment.carry(i, dt)
            if not self.going[i]:
                flags |= _STARTING
                self.motor_position.start(i, self.alignment.aligned[0, i])
                self._gaps[i] = 0.0
            if self._gaps[i] > _RAISED_PERIODS * self._period:
                flags |= _RAISED
            bridged = bridged or not self.came[i]
        self._dynamics.at(self.alignment.aligned[0], self.alignment.aligned[1])
        for i in range(self.n):
            everything += self._joint(i, self._gaps[i])
        for i in range(self.n):
            if self.learns and self.came[i]:
                self._hold_against(i, dt)
        for i in range(self.n):
            everything += self._judge(i, self._gaps[i], dt, bridged)
        if everything - everything != 0.0:
            return _INVALID
        for i in range(self.n):
            self.sensing[i] = self.going[i] and self.since[i] <= _SENSED_PERIODS * self._period
            self.going[i] = self.going[i] or self.alignment.count[i] >= _SAMPLES
            self.q[i], self.q_dot[i] = self.alignment.aligned[0, i], self.alignment.aligned[1, i]
            self._show(i)
        if self._pressed:
            self.touched_link = self.detector.touched_link(self.residual.corrected[0])
        self._weigh(dt)
        return flags

    def _weigh(self, dt: float) -> None:
        """Force at the tool, from all joints."""
        levels, moves = self.levels, False
        for i in range(self.n):
            share = levels.share[i]
            unlearned = share * self.learning.unknown[i] if self.learns else 0.0
            free = self.lower[i] + _STOP < self.q[i] < self.upper[i] - _STOP
            self.wrench.weigh(
                i, self.residual.corrected[0, i], dt, share * levels.usual(i, 0.0),
                levels.friction[i], levels.raised[i], unlearned, self.transmitted[i],
                self.sensing[i] != 0 and free,
            )  # fmt: skip
            moves = moves or abs(self.alignment.aligned[3, i]) > _REST_VELOCITY
        self.wrench.step(dt, self._pressed > 0, moves and not self.frozen)

    def _joint(self, i: int, gap: float) -> float:
        """From the aligned samples of joint i to its residuals. gap: since its last sample [s],
        0 without one. Returns a sum that is finite if everything is."""
        a, position, levels = self.alignment.aligned, self.motor_position, self.levels
        q, q_dot, current, theta_dot, theta = a[0, i], a[1, i], a[2, i], a[3, i], a[4, i]
        tau_M = self._K_c[i] * current
        at_rest = theta_dot / _REST_VELOCITY
        rest = decay(at_rest * at_rest)
        if self._measured:
            turned = theta - self.interval.begin[_THETA, i] if gap > 0.0 else 0.0
        else:
            moved = q - self.q[i] if self.going[i] else 0.0
            turned = displacement(theta_dot, q_dot, moved, self._alpha[i] > 0.0, gap)
        side = position.side[i]
        self._at_an_instant(i, q_dot, theta_dot, theta, tau_M, turned)
        self.tau_M[i] = tau_M
        load = self._load_friction(i)
        levels.rub(i, rest, self.stiction.unknown[i], position.friction[i], load)
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
        some joint are missing. Returns the level of contact [Nm]."""
        if self.learns:
            self._apply(i)
        unknown = self.motor_position.side[i] == _SIDE_UNKNOWN
        crossing, shaken = self._crossing[i] != 0, self._landed > 0
        unsure = self.levels.unsure(i, unknown, crossing, shaken, gap / self._period)
        self._put_in_force(i, unsure, abs(self.alignment.aligned[3, i]), dt)
        came = self.came[i] != 0
        waits = bridged or gap > _LATE_PERIODS * self._period
        begun = self.detector.step(i, self.residual.corrected[0, i], came, waits)
        if begun and self.motor_position.contradicted(i, self.alignment.aligned[3, i]):
            self.motor_position.start(i, self.alignment.aligned[0, i])
        self.begun += begun
        return float(self.threshold[i])

    def _hold_against(self, i: int, dt: float) -> None:
        """Hold the residual of joint i against what was learned; doubt that where they differ."""
        learning, levels, doubt = self.learning, self.levels, self.doubt
        q, velocity = self.alignment.aligned[0, i], self.alignment.aligned[3, i]
        corrected, raw = self.residual.corrected[0, i], self.residual.values[0, i]
        agree = corrected * raw > 0.0 or corrected == raw
        believed = min(abs(corrected), abs(raw)) if agree else 0.0
        usual = levels.usual(i, abs(velocity))
        unknown = self._unknown(i)
        above = levels.raised[i] + levels.friction[i]
        lowered = above + learning.level(i) * (usual + learning.unknown[i])
        stated = above + usual + unknown + learning.identified(i)
        verdict = doubt.step(
            i, self.detector.streak[0, i] != 0, q, velocity, corrected, believed,
            lowered, stated, dt,
        )  # fmt: skip
        if verdict == _FRICTION:
            learning.unsettle(i)
            if abs(raw) < abs(corrected):
                learning.give_up(i)
                self.given_up[i] += 1
        if verdict == _GRAZED:
            # What a load or a cable changes of one joint, it may change of all.
            for k in range(self.n):
                doubt.widen(k, k == i)

    def _lowered_share(self, i: int) -> float:
        """Share of the stated level of joint i that learning and contacts in doubt leave."""
        return float(min(self.learning.level(i) * (1.0 + self.doubt.margin[i]), 1.0))

    def _doubted(self, i: int) -> float:
        """Doubt of joint i where it is, 0 to 1."""
        return float(self.doubt.at(i, self.alignment.aligned[0, i]))

    def _unknown(self, i: int) -> float:
        """Uncertainty of the friction of joint i [Nm]; doubt adds the part that the raise near rest
        does not contain already."""
        learning, doubt = self.learning, self._doubted(i)
        if doubt <= 0.0:
            return float(learning.unknown[i])
        doubted = learning.doubted_at(i, doubt) - self.levels.friction[i]
        return float(max(learning.unknown[i], doubted))

    def _load_friction(self, i: int) -> float:
        """Friction that is known to come with what the gear of joint i transmits [Nm], at most:
        near rest its own friction may hold a part of the motor's torque."""
        own = self._coulomb[i] * self.motor_position.friction[i]
        share = self._load[i] + self.learning.load(i)
        return float(share * (abs(self.tau_M[i]) + own))

    def _put_in_force(self, i: int, unsure: float, speed: float, dt: float) -> None:
        """Levels of joint i, over dt [s]."""
        learning = self._unknown(i) if self.learns else 0.0
        self.threshold[i] = self.levels.put_in_force(i, learning, unsure, speed, dt)

    def _at_an_instant(
        self, i: int, q_dot: float, theta_dot: float, theta: float, tau_M: float, turned: float
    ) -> None:
        """Torques and momenta of joint i at the common instant: the parts of (5) and (6). Which of
        them act while rotor and link touch, and which in the gap, `residual` says. turned: way of
        the rotor since the instant before [rad]."""
        now = self.interval.now
        phi_dot = q_dot - theta_dot
        s_theta = smooth_sign(theta_dot * self._per_width)
        s_q = smooth_sign(q_dot * self._per_width)
        s_phi = smooth_sign(phi_dot * self._per_width)
        now[_MOMENTUM], now[_BETA] = self._dynamics.momentum[i], self._dynamics.beta[i]
        now[_ROTOR], now[_THETA], now[_THETA_DOT] = self._B[i] * theta_dot, theta, theta_dot
        now[_TAU_M] = tau_M
        now[_MOTOR_FRICTION] = self._motor_coulomb[i] * s_theta + self._motor_viscous[i] * theta_dot
        now[_ENGAGED_LINK_FRICTION] = (
            self._link_coulomb[i] * s_theta + self._link_viscous[i] * theta_dot
        )
        now[_LINK_FRICTION] = self._link_coulomb[i] * s_q + self._link_viscous[i] * q_dot
        now[_GAP_FRICTION] = self._gap_coulomb[i] * s_phi + self._gap_viscous[i] * phi_dot
        self.stiction.step(i, turned, s_theta)
        now[_STICTION] = self._coulomb[i] * self.stiction.held[i]

    def _balance(
        self, i: int, dt: float, q: float, q_dot: float, theta_dot: float, rest: float, tau_M: float
    ) -> None:
        """Motor position and residuals of joint i over its interval of dt [s] that ends now."""
        self.interval.integrate(i, dt)
        x, position = self.interval.impulse, self.motor_position
        advance = x[_THETA] if self._measured else x[_THETA_DOT]
        rubs = position.friction[i] * x[_MOTOR_FRICTION]
        transmitted = self.transmitted[i] = (x[_TAU_M] - x[_ROTOR] - rubs) / dt
        touched = self.motor_position.step(
            i, dt, q, q_dot, theta_dot, rest, tau_M, advance, x[_ROTOR] / dt, transmitted
        )
        slides = smooth_sign(theta_dot * self._per_width) + self.stiction.held[i]
        load = dt * abs(transmitted) * slides
        x[_MOTOR_FRICTION] += self._load[i] * load
        # (5): what a fit adds to tau_M while engaged, over the penetration delta.
        phi = q - self.motor_position.theta[i]
        delta = phi - min(max(phi, -self._alpha[i]), self._alpha[i])
        spring = self._K_phi_p[i] * delta + self._K_phi_d[i] * (q_dot - theta_dot)
        self.residual.step(i, x, dt * spring, touched, dt)
        self.levels.integrate(i, dt, self.residual.pole, self.residual.share)
        if self.learns:
            self._learn(i, dt, theta_dot, load, touched or self._always_acts)

    def _learn(self, i: int, dt: float, theta_dot: float, load: float, acts: bool) -> None:
        """Correct the residual of joint i by what was learned of friction, and learn; load: impulse
        of what its gear transmits, by the sign of its motion; acts: they did on the link."""
        x, learning, residual = self.interval.impulse, self.learning, self.residual
        viscous = (self._motor_viscous[i] + self._link_viscous[i]) * x[_THETA_DOT]
        coulomb = x[_MOTOR_FRICTION] + x[_ENGAGED_LINK_FRICTION] + x[_STICTION]
        coulomb -= viscous + self._load[i] * load
        some = 1.0 if acts else 0.0
        learning.step(
            i, some * coulomb, some * viscous, some * load, dt, residual.pole, residual.share
        )
        residual.correct(i, learning.correction[i])
        levels, speed = self.levels, abs(theta_dot)
        usual = levels.usual(i, speed)
        moving = acts and speed > _REST_VELOCITY
        self.doubt.moving[i] = moving
        if speed > _SETS_OUT and learning.stood(i):
            self.doubt.raise_all(i)
        doubt = self._doubted(i)
        learning.learn(
            i, residual.values[0, i], self.threshold[i] / (1.0 + self.doubt.margin[i]), usual,
            levels.friction[i], levels.raised[i], doubt, self.doubt.rubs[i] != 0,
            moving, self.frozen != 0, dt,
        )  # fmt: skip
        self._apply(i)

    def _apply(self, i: int) -> None:
        """Let the rest know what was learned of joint i."""
        self.motor_position.friction[i] = self.learning.friction(i)
        self.motor_position.friction_error[i] = self.learning.error(i)
        # While learning is suspended, levels are the stated ones: the lowered ones are of an arm
        # without the load that was recognised.
        doubt = 1.0 if self.frozen else self._doubted(i)
        share, crossing = self._lowered_share(i), self.learning.crossing_level(i)
        self.levels.share[i] = share + doubt * (1.0 - share)
        self.levels.crossing[i] = crossing + doubt * (1.0 - crossing)

    def _show(self, i: int) -> None:
        """Outputs of joint i from its state; the thresholded residual has no jump."""
        r, threshold = self.residual.corrected[0, i], self.threshold[i]
        self._theta[i], self._sigma[i] = self.motor_position.theta[i], self.motor_position.sigma[i]
        self._phi[i] = self.q[i] - self._theta[i]
        self._share[i], self._uncorrected[i] = self.levels.share[i], self.residual.values[0, i]
        self._thresholded[i] = r - min(max(r, -threshold), threshold)
        self._pressed += self._thresholded[i] != 0.0
