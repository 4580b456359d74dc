# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Levels in force on the residual, and debounce: from residuals to contacts and the touched link.

The configured levels are raised near rest, while the side of a joint's gap is unknown, and after
samples that were missing, by the torque that the residual cannot show, or may pretend, then.

A force on a link acts on its own joint and on those before it; the residuals of joints beyond the
contact stay small. So the touched link is that of the last joint whose residual is clear: at least
this one, and one further out only if the force has no lever about the joints in between.

Ordinary Python, which runs as it is; `contact_detector.pxd` names the types for the compiler,
decision 0037.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
from elementary import decay
from errors import ModelError
from estimator.contact import Contact
from estimator.settings import EstimatorSettings
from estimator.thresholds import LEVELS, Thresholds
from estimator.transmission import Transmission

# Of the contact level, for each sample that was missing beyond the first, and at most: what the
# mean of both ends may be wrong by over an interval in which a motor crossed its gap.
_MISSING_SHARE, _MISSING_MOST = 0.4, 1.2
# Shares of its contact level: what a residual does not reach by the model's errors alone, and below
# which it is clearly absent.
_CLEAR, _ABSENT = 0.35, 0.175
# Ticks for which a contact may wait where samples are missing.
_WAITS = 2


class ContactDetector:
    """Thresholds in force, debounce and events.

    A contact begins when |r| has been past a level on one side for `debounce` ticks in a row; it
    ends when r comes back or changes its sign, and only then may the level fire again.

    Raises ModelError for thresholds of another arm, and for a debounce below 1.
    """

    def __init__(
        self,
        joints: Sequence[str],
        transmission: Transmission,
        thresholds: Thresholds,
        settings: EstimatorSettings,
    ) -> None:
        n, s, t = len(joints), settings, transmission
        if thresholds.contact.shape != (n,):
            raise ModelError(f"thresholds for {thresholds.contact.size} joints, the arm has {n}")
        if s.debounce < 1:
            raise ModelError(f"debounce is {s.debounce} ticks; at least 1")
        self._n, self._joints = n, tuple(joints)
        self._gain, self._debounce = s.gain, s.debounce
        self._levels = np.stack([thresholds.contact, thresholds.collision])
        self._per_speed = thresholds.per_speed.copy()
        self._at_rest = s.stiction_share * t.engaged_coulomb
        self._held = t.stiction * t.engaged_coulomb
        self._unsure = s.unknown_side_share * thresholds.contact * (t.half_gap > 0.0)
        self.raised = np.zeros(n)
        self.above = np.zeros(n)  # what is added to both levels in this tick
        # Ticks in a row past each level, signed as the residual.
        self.streak = np.zeros((2, n), dtype=np.int64)
        # Ticks for which a contact has waited where samples were missing.
        self.waited = np.zeros((2, n), dtype=np.int64)
        self.begins = np.zeros((2, n), dtype=np.int64)

    def hidden(self, i: int, rest: float, unknown: float, unsure: bool, periods: float) -> float:
        """Torque of joint i [Nm] that stiction may hold near rest, and that an unknown side of its
        gap, or samples that were missing, may pretend.

        rest: `transmission.resting`; unknown: share of the stiction that may be anything; unsure:
        of the side; periods: since the sample before.
        """
        hidden = (self._held[i] * unknown + self._at_rest[i]) * rest
        if unsure:
            hidden += self._unsure[i]
        missing = max(periods - 2.0, 0.0)
        return float(hidden + min(missing * _MISSING_SHARE, _MISSING_MOST) * self._levels[0, i])

    def level_at(self, i: int, hidden: float, speed: float) -> float:
        """Contact level [Nm] that a raise by `hidden` [Nm] gives at a motor speed [rad/s]."""
        return float(self._levels[0, i] + hidden + self._per_speed[i] * speed)

    def put_in_force(self, i: int, hidden: float, speed: float, dt: float) -> float:
        """Levels of joint i for this tick; returns that of contact [Nm].

        After break-away friction still builds up while the residual forgets what stiction left in
        it, so the raise fades with half the residual's gain.
        """
        raised = max(self.raised[i] * decay(0.5 * self._gain * dt), hidden)
        self.raised[i] = raised
        self.above[i] = raised + self._per_speed[i] * speed
        return self.level_at(i, raised, speed)

    def step(self, i: int, residual: float, came: bool, waits: bool) -> int:
        """Count what is past the levels in force; returns how many contacts of joint i begin.

        Without a sample, unless it `came`, what counts is what counted before. A contact waits for
        the next tick, _WAITS times at most, beside a joint without a sample, which may not have
        gone on as it was taken to: what it did else is a torque on the others until it is known;
        and over an interval in which a sample was missing, whose mean may miss a knock in the gap.
        """
        begun = 0
        for k in range(2):
            level = self._levels[k, i] + self.above[i]
            past = 1 if residual > level else (-1 if residual < -level else 0)
            begins = False
            if came:
                streak = past + self.streak[k, i] if past * self.streak[k, i] > 0 else past
                begins = abs(streak) == self._debounce
                if begins and waits and self.waited[k, i] < _WAITS:
                    self.waited[k, i] += 1
                    begins = False
                else:
                    self.streak[k, i] = streak
            if past == 0 or begins:
                self.waited[k, i] = 0
            self.begins[k, i] = begins
            begun += begins
        return begun

    def begun(self, residual: Vector, side: NDArray[np.int8], time_s: float) -> tuple[Contact, ...]:
        """Contacts that begin in this tick, at most one per joint and level; residual [Nm] and side
        are (n,)."""
        contacts = []
        for k in range(2):
            for i in range(self._n):
                if self.begins[k, i]:
                    contact = Contact(
                        joint=self._joints[i],
                        torque=float(residual[i]),
                        threshold=float(self._levels[k, i] + self.above[i]),
                        level=LEVELS[k],
                        side=int(side[i]),
                        time_s=time_s,
                    )
                    contacts.append(contact)
        return tuple(contacts)

    def touched_link(self, residual: Vector) -> int:
        """Index of the joint whose link is touched, for a residual (n,) [Nm] that is past the level
        of at least one joint; what raises the levels is no sign of a touch.

        -1 where it cannot be decided: no residual is clear, or that of a joint further out is
        neither clear nor clearly absent.
        """
        for i in range(self._n - 1, -1, -1):
            strength = (abs(residual[i]) - self.above[i]) / self._levels[0, i]
            if strength > _CLEAR:
                return i
            if strength > _ABSENT:
                return -1
        return -1

    def touched(self) -> NDArray[np.bool_]:
        """Joints that are past their contact level now, debounced; shape (n,)."""
        touched: NDArray[np.bool_] = np.abs(self.streak[0]) >= self._debounce
        return touched

    def hit(self) -> NDArray[np.bool_]:
        """Joints that are past their collision level now, debounced; shape (n,)."""
        hit: NDArray[np.bool_] = np.abs(self.streak[1]) >= self._debounce
        return hit

    @property
    def collision(self) -> Vector:
        """Collision levels in force [Nm], shape (n,)."""
        in_force: Vector = np.add(self._levels[1], self.above)
        return in_force

    def reset(self, i: int) -> None:
        """Forget the raise and all contacts of joint i."""
        self.raised[i] = self.above[i] = 0.0
        for k in range(2):
            self.streak[k, i] = self.waited[k, i] = self.begins[k, i] = 0
