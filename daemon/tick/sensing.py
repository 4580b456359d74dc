"""State of contact sensing: which joints sense now, since when, and whether this is reliable.

Pure; time is an argument.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.protocol.state import Notice
from estimator.estimate import Estimate, Flag

#: Time constants of the residual until one that restarted at zero has settled.
SETTLED: Final = 4.0
#: Uninterrupted time after which a joint counts as sensing again [s].
AGAIN_S: Final = 0.5
#: Flags with which an estimate is still valid: true intervals were used, missing samples bridged.
HARMLESS: Final = Flag.LATE | Flag.BRIDGED
_UNSETTLED: Final = ~(HARMLESS | Flag.RAISED)


class Sensing:
    """Sensing of an arm of n joints, as of the last `step`."""

    def __init__(self, n: int, gain: float) -> None:
        """gain: of the residual [1/s]."""
        self.joints: NDArray[np.bool_] = np.zeros(n, dtype=np.bool_)
        """True for joints that sense contact (n,)"""
        self.since_s: Vector = np.zeros(n)
        """Time of the last change of that, for each joint (n,) [s]"""
        self.settled = False
        """True if no residual is still rising from a restart at zero"""
        self.sure = False
        """True if every joint senses, settled, at levels not raised for missing samples"""
        self._each = [False] * n  # `joints`
        self._settles_s = SETTLED / gain
        self._unsettled_s = self._raised_s = -np.inf

    def begin_anew(self, time_s: float) -> None:
        """Restart after the residuals were reset to zero: they do not show a contact yet."""
        self.since_s = np.full_like(self.since_s, time_s)
        self._unsettled_s = time_s
        self.settled = self.sure = False

    def step(self, time_s: float, estimate: Estimate | None) -> None:
        """Process the estimate of this tick; None while there is none."""
        if estimate is None:
            return
        if estimate.flags:
            if estimate.flags & _UNSETTLED:
                self._unsettled_s = time_s
            if Flag.RAISED in estimate.flags:
                self._raised_s = time_s
        now = estimate.sensing.tolist()
        if now != self._each:
            self.since_s = np.where(estimate.sensing != self.joints, time_s, self.since_s)
            self.joints, self._each = estimate.sensing, now
        self.settled = time_s - self._unsettled_s > self._settles_s
        # Raised levels decay with half the residual's gain.
        raised = time_s - self._raised_s <= 2.0 * self._settles_s
        self.sure = self.settled and not raised and all(now)


class SensingNotices:
    """Notices about joints that do not sense contact: one at the start, and one at the end. Changes
    with every burst of losses are not reported each time."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: of the joints, (n,)."""
        self._names = tuple(names)
        self._deaf_s: dict[int, float] = {}  # start time by joint that was reported

    def step(
        self, time_s: float, sensing: Sensing, findings: Sequence[Finding]
    ) -> tuple[Notice, ...]:
        """Notices of one tick; findings: all of this tick."""
        notices: list[Notice] = []
        for finding in findings:
            if finding.condition is Condition.NOT_SENSING:
                new = set(np.flatnonzero(~sensing.joints).tolist()) - self._deaf_s.keys()
                self._deaf_s |= {i: float(sensing.since_s[i]) for i in new}
                if new:
                    notices.append(Notice(kind="fault", text=str(finding)))
        again = [
            i
            for i in sorted(self._deaf_s)
            if sensing.joints[i] and time_s - sensing.since_s[i] >= AGAIN_S
        ]
        if again:
            lost_s = {i: sensing.since_s[i] - self._deaf_s.pop(i) for i in again}
            joints = ", ".join(f"{self._names[i]} after {lost_s[i]:.2f} s" for i in again)
            text = f"sensing contact again for {AGAIN_S:g} s: {joints}"
            notices.append(Notice(kind="mode", text=text))
        return tuple(notices)
