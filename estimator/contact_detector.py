# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Contact detection: debounce of residuals beyond the levels in force, and the touched link.

A force on a link loads its own joint and those before it; the residuals of joints further out stay
small. So the touched link is that of the last joint with a clear residual: the contact is at least
that far out, and further out only if the force has no lever arm about the joints in between.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from common.errors import ModelError
from estimator.contact import Contact
from estimator.levels import Levels
from estimator.thresholds import LEVELS

# A residual is clear beyond the share _CLEAR of the configured contact level (or k, if less), which
# model errors alone do not reach; it is clearly absent below _ABSENT of that.
_CLEAR, _ABSENT = 0.35, 0.5
# Longest delay of a contact by missing samples [ticks].
_WAITS = 2


class ContactDetector:
    """Debounce and contact events.

    A contact begins when |r| has exceeded a level on one side for `debounce` consecutive ticks; it
    ends when r falls below the level or changes its sign, and only then may the level trigger
    again.

    Raises ModelError for a debounce below 1.
    """

    def __init__(self, joints: Sequence[str], levels: Levels, debounce: int) -> None:
        if debounce < 1:
            raise ModelError(f"debounce is {debounce} ticks; at least 1")
        n = self._n = len(joints)
        self._joints, self.levels, self._debounce = tuple(joints), levels, debounce
        # Consecutive ticks beyond each level, signed like the residual.
        self.streak = np.zeros((2, n), dtype=np.int64)
        # Ticks by which a contact was delayed by missing samples.
        self.waited = np.zeros((2, n), dtype=np.int64)
        self.begins = np.zeros((2, n), dtype=np.int64)

    def step(self, i: int, residual: float, arrived: bool, waits: bool) -> int:
        """Update the debounce of joint i; returns how many of its contacts begin.

        Without a new sample (`arrived`) the counts stay. With `waits` a contact is delayed to the
        next tick, at most _WAITS times: while a joint has no sample, its motion may differ from the
        extrapolated one, which looks like a torque on the others; and the mean over an interval
        with a missing sample may miss an impact in the gap.
        """
        begun = 0
        for k in range(2):
            level = self.levels.collision[i] if k else self.levels.contact[i]
            past = 1 if residual > level else (-1 if residual < -level else 0)
            begins = False
            if arrived:
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
        """Index of the joint whose link is touched, given a residual (n,) [Nm] beyond the level of
        at least one joint. Only what exceeds the additions to a level counts.

        -1 if undecidable: no residual is clear, or that of a joint further out is neither clear nor
        clearly absent.
        """
        for i in range(self._n - 1, -1, -1):
            clear = min(_CLEAR, self.levels.share[i]) * self.levels.configured(i, 0.0)
            beyond = abs(residual[i]) - self.levels.above[i]
            if beyond > clear:
                return i
            if beyond > _ABSENT * clear:
                return -1
        return -1

    def touched(self) -> NDArray[np.bool_]:
        """Joints beyond their contact level now, debounced; shape (n,)."""
        touched: NDArray[np.bool_] = np.abs(self.streak[0]) >= self._debounce
        return touched

    def hit(self) -> NDArray[np.bool_]:
        """Joints beyond their collision level now, debounced; shape (n,)."""
        hit: NDArray[np.bool_] = np.abs(self.streak[1]) >= self._debounce
        return hit

    def reset(self, i: int) -> None:
        """Forget all contacts of joint i."""
        for k in range(2):
            self.streak[k, i] = self.waited[k, i] = self.begins[k, i] = 0
