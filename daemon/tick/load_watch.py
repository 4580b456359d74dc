"""Watch on loads that nobody told: recognition in each tick, its news, and what it explains.

What is recognised is said, learning stands still as long as it lasts, and the controller holds
instead of being led by it. The model and the levels stay as they are. When a load is told, what
the residual still shows of it for some 0.1 s is no contact.
"""

from typing import Final

import numpy as np

from arrays import Vector
from daemon.modes.table import SENSING, Mode
from daemon.protocol.messages import Notice
from daemon.tick.sensing import Sensing
from estimator.contact import dead_band
from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.payload import Payload
from estimator.recognition import Recognition

#: What is found again is news if its mass is another by this share, or so many kg.
NEWS_SHARE, NEWS_KG = 0.15, 0.05
#: A place further than this from the tool point, along an axis, is part of the advice [m].
AWAY_M: Final = 0.01
# Of a change of the payload, what the residual shows counts until less than this is left.
_FADED: Final = 0.01


class LoadWatch:
    """Loads of one arm, tick by tick."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._recognition = Recognition(estimator.model, estimator.period_s)
        self._payload: Payload | None = None  # that the model counts
        self._said_kg = 0.0
        # Mass and mass times place (4,) by which the model was changed, and what of it r still is.
        self._change, self._left = np.zeros(4), 0.0
        self._fades = float(np.exp(-estimator.settings.gain * estimator.period_s))

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
        return "" if left.any() else self.words

    def settles(self, estimate: Estimate) -> bool:
        """True if all that is felt is what the residual still shows of a load told just now."""
        if self._left <= _FADED:
            return False
        model = self._estimator.model
        by_mass, by_place = model.payload_torques(estimate.q, model.down)
        change = self._left * self._change
        shown = change[0] * by_mass + by_place @ change[1:]
        return not dead_band(estimate.residual - shown, estimate.threshold).any()

    def step(self, mode: Mode, estimate: Estimate | None, sensing: Sensing) -> tuple[Notice, ...]:
        """Take the estimate of a tick that ended in `mode`; returns news."""
        recognition, before = self._recognition, self._recognition.found
        self._left *= self._fades
        if estimate is None or mode not in SENSING:
            recognition.forget()
            self._said_kg = 0.0
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
        if abs(found.mass - self._said_kg) <= max(NEWS_SHARE * found.mass, NEWS_KG):
            return ()
        self._said_kg = found.mass
        return (Notice(kind="mode", text=f"{self.words}: {self.advice}"),)

    @property
    def words(self) -> str:
        """The load that was recognised; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        if self._payload is None:
            return f"looks like a load of {found.mass:.2g} kg at the hand"
        told = f"the {self._payload.mass:.3g} kg told"
        return f"looks like {found.mass:.2g} kg more at the hand than {told}"

    @property
    def advice(self) -> str:
        """What to do about it; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        load = found if self._payload is None else together(self._payload, found)
        place = self._estimator.model.tool_place.tolist()
        away = max(abs(x - y) for x, y in zip(load.com, place, strict=True)) > AWAY_M
        com = " --com " + " ".join(f"{x:z.2f}" for x in load.com) if away else ""
        return f"`contactctl payload {load.mass:.2g}{com}`"

    def told(self, payload: Payload | None) -> None:
        """Begin anew with another payload, or none."""
        self._recognition.begin()
        self._estimator.freeze_learning(False)
        self._change = self._left * self._change + _moments(payload) - _moments(self._payload)
        self._left = self._fades  # by the tick that comes
        self._payload, self._said_kg = payload, 0.0


def together(one: Payload, other: Payload) -> Payload:
    """Both as one point mass."""
    mass = one.mass + other.mass
    com = [(one.mass * x + other.mass * y) / mass for x, y in zip(one.com, other.com, strict=True)]
    return Payload(mass=mass, com=com)


def _moments(payload: Payload | None) -> Vector:
    """Mass, and mass times place (4,) [kg, kg m]."""
    return np.array([1.0, *payload.com]) * payload.mass if payload else np.zeros(4)
