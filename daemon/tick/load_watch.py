"""Watch on loads that nobody told: recognition in each tick, its news, and what it explains.

What is recognised is said, learning stands still as long as it lasts, and the controller holds
instead of being led by it. The model and the levels stay as they are.
"""

from typing import Final

from daemon.modes.table import SENSING, Mode
from daemon.protocol.messages import Notice
from daemon.tick.sensing import Sensing
from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.payload import Payload
from estimator.recognition import Recognition

#: What is found again is news if its mass is another by this share, or so many kg.
NEWS_SHARE, NEWS_KG = 0.15, 0.05
#: A place further than this from the tool point, along an axis, is part of the advice [m].
AWAY_M: Final = 0.01


class LoadWatch:
    """Loads of one arm, tick by tick."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._recognition = Recognition(estimator.model, estimator.period_s)
        self._told_kg = 0.0

    @property
    def found(self) -> Payload | None:
        """Load that is recognised, None without one."""
        return self._recognition.found

    def explains(self, estimate: Estimate) -> str:
        """The load that was recognised, in words, if it explains all that is felt; else empty."""
        recognition = self._recognition
        if recognition.found is None:
            return ""
        left = recognition.left(estimate.q, estimate.residual, estimate.threshold)
        return "" if left.any() else in_words(recognition.found)

    def step(self, mode: Mode, estimate: Estimate | None, sensing: Sensing) -> tuple[Notice, ...]:
        """Take the estimate of a tick that ended in `mode`; returns news."""
        recognition, before = self._recognition, self._recognition.found
        if estimate is None or mode not in SENSING:
            recognition.forget()
            self._told_kg = 0.0
        elif not sensing.sure:
            recognition.pause()
        else:
            touched = any(estimate.thresholded.tolist())
            recognition.step(
                estimate.q, estimate.q_dot, estimate.residual, estimate.threshold, touched=touched
            )
        found = recognition.found
        if (found is None) != (before is None):
            self._estimator.freeze_learning(found is not None)
        if found is None or before is not None:
            return ()
        if abs(found.mass - self._told_kg) <= max(NEWS_SHARE * found.mass, NEWS_KG):
            return ()
        self._told_kg = found.mass
        return (Notice(kind="mode", text=f"{in_words(found)}: {self.advice}"),)

    @property
    def advice(self) -> str:
        """What to do about it; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        place = self._estimator.model.tool_place.tolist()
        away = max(abs(x - y) for x, y in zip(found.com, place, strict=True)) > AWAY_M
        com = " --com " + " ".join(f"{x:.2f}" for x in found.com) if away else ""
        return f"`contactctl payload {found.mass:.2g}{com}`"

    def told(self) -> None:
        """Begin anew with another payload, or none."""
        self._recognition.forget()
        self._estimator.freeze_learning(False)
        self._told_kg = 0.0


def in_words(load: Payload) -> str:
    """A load that was recognised."""
    return f"looks like a load of {load.mass:.2g} kg at the hand"
