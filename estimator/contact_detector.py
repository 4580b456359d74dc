# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Contacts: debounce of what is past the levels in force, and the touched link.

A force on a link acts on its own joint and on those before it; the residuals of joints beyond the
contact stay small. So the touched link is that of the last joint whose residual is clear: at least
this one, and one further out only if the force has no lever about the joints in between.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from common.errors import ModelError
from estimator.contact import Contact
from estimator.levels import Levels
from estimator.thresholds import LEVELS

# Of its configured contact level, or of the share of that which is in force: what a residual does
# not reach by the model's errors alone; and of that, below which it is clearly absent.
_CLEAR, _ABSENT = 0.35, 0.5
# Ticks for which a contact may wait where samples are missing.
_WAITS = 2


class ContactDetector:
    """Debounce and events.

    A contact begins when |r| has been past a level on one side for `debounce` ticks in a row; it
    ends when r comes back or changes its sign, and only then may the level fire again.

    Raises ModelError for a debounce below 1.
    """

    def __init__(self, joints: Sequence[str], levels: Levels, debounce: int) -> None:
        if debounce < 1:
            raise ModelError(f"debounce is {debounce} ticks; at least 1")
        n = self._n = len(joints)
        self._joints, self.levels, self._debounce = tuple(joints), levels, debounce
        # Ticks in a row past each level, signed as the residual.
        self.streak = np.zeros((2, n), dtype=np.int64)
        # Ticks for which a contact has waited where samples were missing.
        self.waited = np.zeros((2, n), dtype=np.int64)
        self.begins = np.zeros((2, n), dtype=np.int64)

    def step(self, i: int, residual: float, came: bool, waits: bool) -> int:
        """Count what is past the levels in force; returns how many contacts of joint i begin.

        Without a sample, unless it `came`, what counts is what counted before. A contact waits for
        the next tick, _WAITS times at most, beside a joint without a sample, which may not have
        gone on as it was taken to: what it did else is a torque on the others until it is known;
        and over an interval in which a sample was missing, whose mean may miss a knock in the gap.
        """
        begun = 0
        for k in range(2):
            level = self.levels.collision[i] if k else self.levels.contact[i]
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
                        threshold=float((self.levels.collision if k else self.levels.contact)[i]),
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
            clear = min(_CLEAR, self.levels.share[i]) * self.levels.usual(i, 0.0)
            beyond = abs(residual[i]) - self.levels.above[i]
            if beyond > clear:
                return i
            if beyond > _ABSENT * clear:
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

    def reset(self, i: int) -> None:
        """Forget all contacts of joint i."""
        for k in range(2):
            self.streak[k, i] = self.waited[k, i] = self.begins[k, i] = 0
