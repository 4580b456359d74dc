# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Adaptation: learned friction and contact levels put into effect, weighted by the doubt in them.

Learned friction is subtracted from the residual and passed to the gap test; the level that a joint
needs lowers its level in force. After a contact that raised doubt, both return to the stated ones.
"""

import numpy as np

from common.elementary import smooth_sign
from estimator.contact_detector import ContactDetector
from estimator.doubt import FRICTION, GRAZED, Doubt
from estimator.interval import Interval
from estimator.learning import Learning
from estimator.levels import Levels
from estimator.link_velocity import Alignment
from estimator.motor_position import MotorPosition
from estimator.residual import Residual
from estimator.torques import Torques
from estimator.transmission import REST_VELOCITY

_REST_VELOCITY = REST_VELOCITY
_SETS_OUT = 0.01  # [rad/s]; above it a joint has left standstill
# Rows of `interval.TERMS`.
_THETA_DOT, _BETA, _MOTOR_FRICTION, _ENGAGED_LINK_FRICTION, _STICTION = 3, 4, 6, 7, 10
_GRAZED, _FRICTION = GRAZED, FRICTION
# `contested` counts from the share _STATED of the configured level on, up to _MOST of that level.
_STATED, _MOST = 0.8, 0.5


class Adaptation:
    """Learning and doubt of all joints, and their effect on the other parts of the estimator; none
    if `learns` is False."""

    def __init__(
        self,
        learns: bool,
        learning: Learning,
        doubt: Doubt,
        alignment: Alignment,
        interval: Interval,
        torques: Torques,
        motor_position: MotorPosition,
        residual: Residual,
        levels: Levels,
        detector: ContactDetector,
    ) -> None:
        self._learns, self.learning, self.doubt = learns, learning, doubt
        self._alignment, self._interval, self._torques = alignment, interval, torques
        self._motor_position, self._residual = motor_position, residual
        self._levels, self._detector = levels, detector
        self.frozen = 0  # 1: learning is suspended
        n = self._n = len(np.asarray(torques.coulomb))
        self.given_up = np.zeros(n, dtype=np.int64)  # times that learned friction was discarded

    def unknown(self, i: int) -> float:
        """Uncertainty of the friction of joint i [Nm]; in doubt, at least what the friction term of
        its level does not cover already."""
        if not self._learns:
            return 0.0
        learning, doubt = self.learning, self._doubted(i)
        if doubt <= 0.0:
            return float(learning.unknown[i])
        doubted = learning.doubted_at(i, doubt) - self._levels.friction[i]
        return float(max(learning.unknown[i], doubted))

    def contested(self, i: int) -> float:
        """Part of the residual of joint i [Nm] that the friction correction alone creates, counted
        as far as the level is the stated one: a cable learned as friction still pulls after a
        reversal."""
        learned = self.learning.correction[i]
        if self._residual.corrected[0, i] > 0.0:
            learned = -learned
        most = _MOST * self._levels.configured(i, 0.0)
        stated = max((self._share(i) - _STATED) / (1.0 - _STATED), 0.0)
        return float(min(max(learned, 0.0), most) * stated) if self._learns else 0.0

    def unlearned(self, i: int) -> float:
        """Torque [Nm] that uncertain friction adds to the level of joint i."""
        return self.unknown(i) + self.contested(i)

    def unknown_at(self, i: int, speed: float, transmitted: float) -> float:
        """Uncertainty of the friction of joint i [Nm] at a motor speed [rad/s] and transmitted
        load."""
        if not self._learns:
            return 0.0
        torques, slides = self._torques, smooth_sign(speed * self._torques.per_width)
        coulomb, load = torques.coulomb[i] * slides, abs(transmitted) * slides
        return float(self.learning.unknown_at(i, coulomb, torques.viscous[i] * speed, load))

    def load_friction(self, i: int, tau_M: float) -> float:
        """Known load friction of joint i [Nm], as an upper bound: near rest its gear may transmit
        as much as the motor torque plus the gear's own friction."""
        own = self._torques.coulomb[i] * self._motor_position.friction[i]
        share = self._torques.load[i] + self.learning.load(i)
        return float(share * (abs(tau_M) + own))

    def learn(
        self, i: int, dt: float, theta_dot: float, load: float, level: float, acts: bool
    ) -> None:
        """Correct the residual of joint i by the learned friction, then learn, over its interval of
        dt [s]. load: impulse of the transmitted torque, signed by the motion [Nm s]; level: contact
        level in force [Nm]; acts: friction and load acted on the link."""
        if not self._learns:
            return
        x, learning, residual = self._interval.impulse, self.learning, self._residual
        viscous = self._torques.viscous[i] * x[_THETA_DOT]
        coulomb = x[_MOTOR_FRICTION] + x[_ENGAGED_LINK_FRICTION] + x[_STICTION]
        coulomb -= viscous + self._torques.load[i] * load
        some = 1.0 if acts else 0.0
        learning.step(
            i, some * coulomb, some * viscous, some * load, dt, residual.pole, residual.share
        )
        residual.correct(i, learning.correction[i])
        levels, speed = self._levels, abs(theta_dot)
        moving = acts and speed > _REST_VELOCITY
        self.doubt.moving[i] = moving
        if speed > _SETS_OUT and learning.stood(i):
            self.doubt.raise_all(i)
        doubt = self._doubted(i)
        level -= self.contested(i)
        learning.needed.carry(i, self._interval.now[_BETA], levels.configured(i, speed))
        learning.learn(
            i, residual.values[0, i], level / (1.0 + self.doubt.margin[i]),
            levels.configured(i, speed), levels.friction[i], levels.raised[i], doubt,
            self.doubt.rubs[i] != 0, moving, self.frozen != 0, dt,
        )  # fmt: skip
        self.apply(i)

    def compare(self, i: int, dt: float) -> None:
        """Check the residual of joint i against what was learned; raise doubt where they
        disagree."""
        if not self._learns:
            return
        learning, levels, doubt = self.learning, self._levels, self.doubt
        q, velocity = self._alignment.aligned[0, i], self._alignment.aligned[3, i]
        corrected, raw = self._residual.corrected[0, i], self._residual.values[0, i]
        agree = corrected * raw > 0.0 or corrected == raw
        believed = min(abs(corrected), abs(raw)) if agree else 0.0
        configured = levels.configured(i, abs(velocity))
        unknown = self.unknown(i)
        above = levels.raised[i] + levels.friction[i]
        lowered = above + learning.needed.level(i) * (configured + learning.unknown[i])
        stated = above + configured + unknown + learning.identified(i)
        verdict = doubt.step(
            i, self._detector.streak[0, i] != 0, q, velocity, corrected, believed,
            lowered, stated, dt,
        )  # fmt: skip
        if verdict == _FRICTION:
            learning.reset_uncertainty(i)
            if abs(raw) < abs(corrected):
                learning.give_up(i)
                self.given_up[i] += 1
        if verdict == _GRAZED:
            # A load or a cable that affects one joint may affect all.
            for k in range(self._n):
                doubt.widen(k, k == i)

    def apply(self, i: int) -> None:
        """Pass what was learned of joint i to the other parts."""
        if not self._learns:
            return
        self._motor_position.friction[i] = self.learning.friction(i)
        self._motor_position.friction_error[i] = self.learning.error(i)
        # While learning is suspended the stated levels are in force: the lowered ones were learned
        # without the load that was recognised.
        doubt = 1.0 if self.frozen else self._doubted(i)
        crossing = self.learning.needed.crossing_level(i)
        self._levels.share[i] = 1.0 if self.frozen else self._share(i)
        self._levels.crossing[i] = crossing + doubt * (1.0 - crossing)

    def _doubted(self, i: int) -> float:
        """Doubt of joint i at its present position, 0 to 1."""
        return float(self.doubt.at(i, self._alignment.aligned[0, i]))

    def _share(self, i: int) -> float:
        """Share of the configured level of joint i in force after learning, margin and doubt."""
        share = min(self.learning.needed.level(i) * (1.0 + self.doubt.margin[i]), 1.0)
        return float(share + self._doubted(i) * (1.0 - share))
