"""Watch on loads that nobody told: recognition in each tick, its news, and what it explains.

What is recognised is said, learning stands still as long as it lasts, and once it is confirmed the
controller holds instead of being led by it. The model and the levels stay as they are. When a load
is told, what the residual still shows of it for some 0.1 s is no contact.

An arm that yields hardly moves, and recognises nothing. What pulls at it like a load, and what
keeps it from its trajectory again and again, is said within seconds (`hint`), and changes nothing.
"""

from typing import Final

import numpy as np

from arrays import Vector
from daemon.modes.table import GUIDED, SENSING, YIELDING, Mode
from daemon.protocol.messages import Notice
from daemon.tick.sensing import Sensing
from estimator.contact import dead_band
from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.payload import Payload
from estimator.recognition import Recognition
from estimator.steady_pull import SteadyPull

#: What is found again is news if its mass is another by this share, or so many kg.
NEWS_SHARE, NEWS_KG = 0.15, 0.05
#: A place further than this from the tool point, along an axis, is part of the advice [m].
AWAY_M: Final = 0.01
#: A trajectory that contacts interrupt so often within so long [s] does not get on.
OFTEN, OFTEN_S = 3, 12.0
_LED: Final = GUIDED | YIELDING
_UNDER_WAY: Final = frozenset({Mode.TRACKING, Mode.RETURNING})
# Of a change of the payload, what the residual shows counts until less than this is left.
_FADED: Final = 0.01


class LoadWatch:
    """Loads of one arm, tick by tick."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._recognition = Recognition(estimator.model, estimator.period_s)
        self._pull = SteadyPull(estimator.model, estimator.period_s)
        self._interruptions = Interruptions(estimator.period_s)
        self._hinted_kg = 0.0
        self._mode = Mode.OFF
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
        """The load that was recognised and confirmed, in words, if it explains all that is felt;
        else empty: in doubt it is a person."""
        recognition = self._recognition
        if not recognition.confirmed:
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
        often = self._interruptions.often
        self._left *= self._fades
        self._interruptions.step(self._mode, mode)
        self._mode = mode
        if estimate is None or mode not in SENSING:
            recognition.forget()
            self._pull.forget()
            self._said_kg = 0.0
        elif not sensing.sure:
            recognition.pause()
            self._pull.pause()
        else:
            touched = any(estimate.thresholded.tolist())
            seen = (estimate.q, estimate.q_dot, estimate.residual, estimate.threshold)
            recognition.step(*seen, touched=touched)
            self._pull.step(*seen, touched=touched)
        found = recognition.found
        if (found is None) != (before is None):
            self._estimator.freeze_learning(found is not None)
        return self._news(before, often=often)

    def _news(self, before: Payload | None, *, often: bool) -> tuple[Notice, ...]:
        """What this tick found that the one before it had not, and that was not said."""
        found, pulls = self.found, self._pull.mass
        if not self._pull.lasts:
            self._hinted_kg = 0.0
        if found is not None:
            if found == before or not _is_other(found.mass, self._said_kg):
                return ()
            self._said_kg = found.mass
            return (Notice(kind="mode", text=f"{self.words}: {self.advice}"),)
        if pulls and _is_other(pulls, self._hinted_kg):
            self._hinted_kg = pulls
        elif self._hinted_kg or often or not self._interruptions.often:
            return ()
        return (Notice(kind="mode", text=self.hint),)

    @property
    def words(self) -> str:
        """The load that was recognised; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        if self._payload is None:
            return f"looks like a load of {found.mass:.2g} kg at the hand"
        return f"looks like {found.mass:.2g} kg more at the hand than {self._told}"

    @property
    def advice(self) -> str:
        """What to do about it; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        load = found if self._payload is None else together(self._payload, found)
        place = self._estimator.model.tool_place.tolist()
        away = max(abs(x - y) for x, y in zip(load.com, place, strict=True)) > AWAY_M
        com = " --com " + " ".join(f"{x:z.2f}" for x in load.com) if away else ""
        return f"{self._stop}`contactctl payload {load.mass:.2g}{com}`"

    @property
    def hint(self) -> str:
        """What may be a load and is not recognised, in words, with what to do; empty without it."""
        pulls = self._pull.mass
        if self.found is not None or not (pulls or self._interruptions.often):
            return ""
        if not pulls:
            return (
                f"contacts interrupted the trajectory {OFTEN} times in {OFTEN_S:g} s: if the hand "
                f"carries something, {self._stop}`contactctl payload MASS` with what it weighs"
            )
        more = f" more than {self._told}" if self._payload else ""
        return (
            f"something pulls straight down at the hand, like some {pulls:.2g} kg{more}: if it is "
            f"a load, {self._stop}`contactctl payload MASS` with what it weighs"
        )

    @property
    def _stop(self) -> str:
        """What comes before `payload`, which is refused while the arm is led."""
        return "`contactctl stop`, then " if self._mode in _LED else ""

    @property
    def _told(self) -> str:
        return f"the {self._payload.mass:.3g} kg told" if self._payload else ""

    def told(self, payload: Payload | None) -> None:
        """Begin anew with another payload, or none."""
        self._recognition.begin()
        self._pull.forget()
        self._interruptions.forget()
        self._estimator.freeze_learning(False)
        self._change = self._left * self._change + _moments(payload) - _moments(self._payload)
        self._left = self._fades  # by the tick that comes
        self._payload, self._said_kg = payload, 0.0


class Interruptions:
    """Interruptions of the trajectory by contacts; `often` while the last OFTEN came within
    OFTEN_S, and the last of them is no longer ago."""

    def __init__(self, period_s: float) -> None:
        self.often = False
        self._within = round(OFTEN_S / period_s)
        self._ago = [self._within] * OFTEN  # ticks since each, the latest last

    def forget(self) -> None:
        """Forget those that were."""
        self.often = False
        self._ago[:] = [self._within] * OFTEN

    def step(self, before: Mode, mode: Mode) -> None:
        """Take the mode before and after a tick."""
        ago = self._ago
        for k in range(OFTEN):
            ago[k] += 1
        if before in _UNDER_WAY and mode in YIELDING:
            self.often = ago[1] <= self._within  # it is the first of OFTEN now
            ago[:-1] = ago[1:]
            ago[-1] = 0
        elif self.often and ago[-1] >= self._within:
            self.often = False


def together(one: Payload, other: Payload) -> Payload:
    """Both as one point mass."""
    mass = one.mass + other.mass
    com = [(one.mass * x + other.mass * y) / mass for x, y in zip(one.com, other.com, strict=True)]
    return Payload(mass=mass, com=com)


def _is_other(mass: float, said: float) -> bool:
    """True if it is news beside a mass that was said; both in kg."""
    return abs(mass - said) > max(NEWS_SHARE * mass, NEWS_KG)


def _moments(payload: Payload | None) -> Vector:
    """Mass, and mass times place (4,) [kg, kg m]."""
    return np.array([1.0, *payload.com]) * payload.mass if payload else np.zeros(4)
