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
        self._ticks, self._reported_load, self._led = 0, False, False
        self._load, self._by_hand = np.zeros((2, len(self._names)))

    @property
    def too_often(self) -> str:
        """Description of a joint interrupted TOO_OFTEN at the same place; empty without one."""
        interrupted = self._estimator.interrupted.tolist()
        if max(interrupted) < TOO_OFTEN:
            return ""
        for i, (name, times) in enumerate(zip(self._names, interrupted, strict=True)):
            if times >= TOO_OFTEN:
                return (
                    f"{name}: interrupted at the same place {times} times, near {self._at(i)} rad"
                )
        return ""

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

    def _at(self, i: int) -> str:
        return f"{self._estimator.place(i):.2f}"

    def step(self, *, led: bool = False) -> tuple[Notice, ...]:
        """Notices of this tick, usually none; led: a hand may have led the arm in it."""
        estimator = self._estimator
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
            f"{name}: contact at the same place {OFTEN} times, near {self._at(i)} rad: "
            "a cable, a hose, or something in the way?"
            for i, (name, before, now) in enumerate(zip(self._names, self._met, met, strict=True))
            if before < OFTEN <= now
        ]
        self._given_up, self._met = given_up, met
        return tuple(Notice(kind="mode", text=text) for text in texts)
