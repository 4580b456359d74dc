"""Notices about learning: learned friction that was discarded, friction of load that was not
identified, and places of repeated contact."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from daemon.protocol.state import Notice
from estimator.estimator import Estimator

#: Number of contacts in doubt at one place that is reported, and that makes the arm hold: without a
#: hand, it would be interrupted forever.
OFTEN: Final = 3
TOO_OFTEN: Final = 5
#: Contacts with less time between them [s], or while the arm yields to the first, are one push.
APART_S: Final = 1.0
#: Learned friction per transmitted torque, beyond the identified interval, that is reported: if
#: there is none, at most 0.05 is learned. It is checked once in LOOKS_TICKS. Changes while a hand
#: leads the arm do not count.
LOAD, LOOKS_TICKS = 0.1, 50


class LearningNotices:
    """News of one arm, tick by tick."""

    def __init__(self, estimator: Estimator, names: Sequence[str]) -> None:
        self._estimator, self._names = estimator, tuple(names)
        self._given_up = [0] * len(self._names)
        self._met = [0] * len(self._names)
        self._pushes, self._in_push = [0] * len(self._names), set[int]()  # at the present places
        self._met_s, self._yields = 0.0, False
        self._ticks, self._reported_load, self._led = 0, False, False
        self._load, self._by_hand = np.zeros((2, len(self._names)))

    @property
    def too_often(self) -> str:
        """Description of a joint interrupted TOO_OFTEN at the same place; empty without one."""
        interrupted = self._estimator.interrupted.tolist()
        if (times := max(interrupted)) < TOO_OFTEN:
            return ""
        i = interrupted.index(times)
        return f"{self._names[i]}: interrupted at the same place {times} times, {self._near(i)}"

    @property
    def load(self) -> str:
        """Joints with more load-dependent friction than identified, with advice; may be empty."""
        estimator = self._estimator
        learned = (estimator.learned().load - self._by_hand).tolist()
        known = estimator.transmission.load_friction_error.tolist()
        found = [
            f"{name} by {rubs:.2f} per Nm"
            for name, rubs, error in zip(self._names, learned, known, strict=True)
            if rubs - error > LOAD
        ]
        if not found:
            return ""
        return (
            f"friction grows with load, more than identified: {', '.join(found)}: "
            "`contactd identify friction`, as learned values are lost when the daemon ends"
        )

    def _near(self, i: int) -> str:
        return f"near {self._estimator.place(i):.2f} rad"

    def step(self, time_s: float, *, led: bool = False) -> tuple[Notice, ...]:
        """Notices of this tick, usually none; led: a hand may have led the arm in it."""
        estimator = self._estimator
        if led > self._yields or (not led and time_s - self._met_s > APART_S):
            self._in_push.clear()
        self._yields = led
        self._ticks, self._led = self._ticks + 1, self._led or led
        if self._ticks % LOOKS_TICKS == 0:
            before, self._load = self._load, estimator.learned().load
            self._by_hand += self._led * (self._load - before)
            self._led = led
            if not self._reported_load and (load := self.load):
                self._reported_load = True
                return (Notice(kind="mode", text=load),)
        given_up, met = estimator.given_up.tolist(), estimator.met.tolist()
        if given_up == self._given_up and met == self._met:
            return ()
        texts = [
            f"{name}: the learned friction is discarded, the residual is smaller without it"
            for name, before, now in zip(self._names, self._given_up, given_up, strict=True)
            if now > before
        ]
        texts += [
            f"{self._names[i]}: contact at the same place {OFTEN} times, {self._near(i)}: "
            "a cable, a hose, or something in the way?"
            for i, (before, now) in enumerate(zip(self._met, met, strict=True))
            if before != now and self._count(i, anew=now < before) == OFTEN
        ]
        self._given_up, self._met, self._met_s = given_up, met, time_s
        return tuple(Notice(kind="mode", text=text) for text in texts)

    def _count(self, i: int, *, anew: bool) -> int:
        """Number of pushes at the place of joint i if this contact begins one, else 0; anew: the
        place has changed, or is forgotten."""
        begins = not anew and i not in self._in_push
        self._pushes[i] = 0 if anew else self._pushes[i] + begins
        (self._in_push.discard if anew else self._in_push.add)(i)
        return self._pushes[i] * begins
