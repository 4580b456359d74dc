"""Shares of missing samples of each joint, and of ticks with late answers; notices if one is high.

Single missing samples are bridged and have no effect, but indicate a bad cable or a loaded bus.
Pure.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.protocol.state import Notice

WITHIN_S: Final = 10.0
"""Time constant of the share [s]."""
#: Share above which losses are reported, and share below which they are over.
MANY, FEW = 0.1, 0.02
_NONE = 1e-4


class SampleLosses:
    """Losses of an arm of n joints, as of the last `step`."""

    def __init__(self, names: Sequence[str], period_s: float) -> None:
        """names: of the joints, (n,)."""
        self.share: Vector = np.zeros(len(names))
        """Share of recent samples that are missing, (n,)"""
        self._names = tuple(names)
        self._weight = period_s / WITHIN_S
        self._any = False
        self._reported: set[int] = set()
        self._late, self._late_reported = 0.0, False

    def step(self, arrived: NDArray[np.bool_], *, complete: bool) -> tuple[Notice, ...]:
        """Process one tick: `arrived` is True for joints with a sample (n,); `complete` if all
        are of this tick. Returns notices."""
        if complete and not self._any:
            return ()
        self.share += (~arrived - self.share) * self._weight
        self._late += ((not complete and bool(arrived.all())) - self._late) * self._weight
        self._any = max(self.share.max(), self._late) > _NONE
        many = set(np.flatnonzero(self.share > MANY).tolist()) - self._reported
        self._reported = {i for i in self._reported if self.share[i] > FEW} | many
        texts = []
        if many:
            missing = self.in_words(sorted(many))
            texts.append(f"samples go missing: {missing}: cable, terminator, bus load?")
        if self._late > MANY and not self._late_reported:
            texts.append(
                f"answers come later than usual in {self._late:.0%} of ticks, and count as missing,"
                " which raises levels: a loaded computer, another adapter?"
            )
        self._late_reported = self._late > (FEW if self._late_reported else MANY)
        return tuple(Notice(kind="mode", text=text) for text in texts)

    def in_words(self, joints: Sequence[int]) -> str:
        """Shares of these joints, as text."""
        return ", ".join(f"{self._names[i]} {self.share[i]:.0%}" for i in joints)
