"""Detection of unannounced payloads: recognition, reports, and contacts attributed to them.

A recognised payload is reported, learning is suspended as long as it lasts, and once it is
confirmed the controller holds instead of yielding to it. The model and the levels stay as they are.
When a payload is announced, the residual that still shows it for some 0.1 s is not a contact.

While the arm yields, it hardly moves, and no payload is recognised. A steady pull like that of a
payload, and contacts that interrupt the trajectory again and again, are only reported, within
seconds (`hint`).
"""

from typing import Final

import numpy as np

from common.arrays import Vector
from daemon.modes.table import GUIDED, SENSING, YIELDING, Mode
from daemon.protocol.state import Notice
from daemon.tick.sensing import Sensing
from estimator.contact import dead_band
from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.payload import Payload
from estimator.recognition import Recognition
from estimator.steady_pull import SteadyPull

#: A recognised payload is reported again if its mass changed by this share, and this many kg.
NEWS_SHARE, NEWS_KG = 0.15, 0.05
#: Distance from the tool point, along an axis, from which on a place is part of the advice [m].
AWAY_M: Final = 0.01
#: Number of interruptions within a time [s] from which on a trajectory is considered stuck.
OFTEN, OFTEN_S = 3, 12.0
_LED: Final = GUIDED | YIELDING
_UNDER_WAY: Final = frozenset({Mode.TRACKING, Mode.RETURNING})
# Share of a change of the payload below which its remainder in the residual is neglected.
_FADED: Final = 0.01


class LoadWatch:
    """Payload detection of one arm, tick by tick."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._recognition = Recognition(estimator.model, estimator.period_s)
        self._pull = SteadyPull(estimator.model, estimator.period_s)
        self._interruptions = Interruptions(estimator.period_s)
        self._hinted_kg = 0.0
        self._mode = Mode.OFF
        self._payload: Payload | None = None  # in the model
        self._reported_kg = 0.0
        # Mass and mass times place (4,) by which the model was changed, and the share of this
        # change that r still shows.
        self._change, self._left = np.zeros(4), 0.0
        self._fades = float(np.exp(-estimator.settings.gain * estimator.period_s))

    @property
    def found(self) -> Payload | None:
        """Recognised load, None without one."""
        return self._recognition.found

    def explains(self, estimate: Estimate) -> str:
        """Description of the load that was recognised and confirmed, if it explains the whole
        residual; otherwise empty: in doubt it is a person."""
        recognition = self._recognition
        if not recognition.confirmed:
            return ""
        left = recognition.left(estimate.q, estimate.residual, estimate.threshold)
        return "" if left.any() else self.words

    def settles(self, estimate: Estimate) -> bool:
        """True if the transient of a payload that was just announced explains the residual."""
        if self._left <= _FADED:
            return False
        model = self._estimator.model
        by_mass, by_place = model.payload_torques(estimate.q, model.down)
        change = self._left * self._change
        shown = change[0] * by_mass + by_place @ change[1:]
        return not dead_band(estimate.residual - shown, estimate.threshold).any()

    def step(self, mode: Mode, estimate: Estimate | None, sensing: Sensing) -> tuple[Notice, ...]:
        """Process the estimate of a tick that ended in `mode`; returns notices."""
        recognition, before = self._recognition, self._recognition.found
        often = self._interruptions.often
        self._left *= self._fades
        self._interruptions.step(self._mode, mode)
        self._mode = mode
        if estimate is None or mode not in SENSING:
            recognition.forget()
            self._pull.forget()
            self._reported_kg = 0.0
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
        """Notices about findings that are new in this tick and not yet reported."""
        found, pulls = self.found, self._pull.mass
        if not self._pull.lasts:
            self._hinted_kg = 0.0
        if found is not None:
            if found == before or not _differs(found.mass, self._reported_kg):
                return ()
            self._reported_kg = found.mass
            return (Notice(kind="mode", text=f"{self.words}: {self.advice}"),)
        if pulls and _differs(pulls, self._hinted_kg):
            self._hinted_kg = pulls
        elif self._hinted_kg or often or not self._interruptions.often:
            return ()
        return (Notice(kind="mode", text=self.hint),)

    @property
    def words(self) -> str:
        """Description of the recognised load; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        if self._payload is None:
            return f"looks like a load of {found.mass:.2g} kg at the hand"
        return f"looks like {found.mass:.2g} kg more at the hand than {self._announced}"

    @property
    def advice(self) -> str:
        """Command that announces the recognised load; empty without one."""
        if (found := self._recognition.found) is None:
            return ""
        load = found if self._payload is None else together(self._payload, found)
        place = self._estimator.model.tool_place.tolist()
        away = max(abs(x - y) for x, y in zip(load.com, place, strict=True)) > AWAY_M
        com = " --com " + " ".join(f"{x:z.2f}" for x in load.com) if away else ""
        return f"{self._stop}`contactctl payload {load.mass:.2g}{com}`"

    @property
    def hint(self) -> str:
        """Report of a possible but not recognised load, with advice; empty without one."""
        pulls = self._pull.mass
        if self.found is not None or not (pulls or self._interruptions.often):
            return ""
        if not pulls:
            return (
                f"contacts interrupted the trajectory {OFTEN} times in {OFTEN_S:g} s: if the hand "
                f"carries a load, {self._stop}`contactctl payload MASS` with its mass"
            )
        more = f" more than {self._announced}" if self._payload else ""
        return (
            f"something pulls straight down at the hand, like some {pulls:.2g} kg{more}: if it is "
            f"a load, {self._stop}`contactctl payload MASS` with its mass"
        )

    @property
    def _stop(self) -> str:
        """Command needed before `payload`, which is refused while the arm is led."""
        return "`contactctl stop`, then " if self._mode in _LED else ""

    @property
    def _announced(self) -> str:
        return f"the {self._payload.mass:.3g} kg announced" if self._payload else ""

    def announce(self, payload: Payload | None) -> None:
        """Restart the detection with another payload in the model, or none."""
        self._change = self._left * self._change + _moments(payload) - _moments(self._payload)
        self._recognition.begin()
        self._pull.forget()
        self._interruptions.forget()
        self._estimator.freeze_learning(False)
        self._left = self._fades  # by the next tick
        self._payload = payload


class Interruptions:
    """Interruptions of the trajectory by contacts; `often` while the last OFTEN occurred within
    OFTEN_S, and the latest at most OFTEN_S ago."""

    def __init__(self, period_s: float) -> None:
        self.often = False
        self._within = round(OFTEN_S / period_s)
        self._ago = [self._within] * OFTEN  # ticks since each, the latest last

    def forget(self) -> None:
        """Forget all interruptions."""
        self.often = False
        self._ago[:] = [self._within] * OFTEN

    def step(self, before: Mode, mode: Mode) -> None:
        """Process the modes before and after a tick."""
        ago = self._ago
        for k in range(OFTEN):
            ago[k] += 1
        if before in _UNDER_WAY and mode in YIELDING:
            self.often = ago[1] <= self._within  # the first of the latest OFTEN
            ago[:-1] = ago[1:]
            ago[-1] = 0
        elif self.often and ago[-1] >= self._within:
            self.often = False


def together(one: Payload, other: Payload) -> Payload:
    """Both payloads as one point mass."""
    mass = one.mass + other.mass
    com = [(one.mass * x + other.mass * y) / mass for x, y in zip(one.com, other.com, strict=True)]
    return Payload(mass=mass, com=com)


def _differs(mass: float, reported: float) -> bool:
    """True if a mass differs enough from the last reported one for a new report [kg]."""
    return abs(mass - reported) > max(NEWS_SHARE * mass, NEWS_KG)


def _moments(payload: Payload | None) -> Vector:
    """Mass, and mass times place (4,) [kg, kg m]."""
    return np.array([1.0, *payload.com]) * payload.mass if payload else np.zeros(4)
