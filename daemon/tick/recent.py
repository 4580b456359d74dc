"""History of late ticks and contacts, which the record of a single tick does not contain.

Pure; time is an argument.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from daemon.faults.finding import Finding
from estimator.estimate import Estimate

# Late ticks that are tolerated within a second: on a busy machine single ones occur, and are
# harmless.
LATE_TICKS = 2


class RecentEvents:
    """Latest late ticks of an arm of n joints, and the last touch of each joint."""

    def __init__(self, n: int) -> None:
        self.late_s: deque[float] = deque(maxlen=LATE_TICKS + 1)
        """times of the latest late ticks [s]"""
        self.touched_s: Vector = np.full(n, -np.inf)
        """time at which each joint was last above its threshold (n,) [s]"""

    def step(self, findings: Sequence[Finding], estimate: Estimate | None, time_s: float) -> None:
        """Record whether this tick is late, and which joints are above their thresholds."""
        if estimate is not None and any(estimate.thresholded.tolist()):
            self.touched_s[estimate.thresholded != 0.0] = time_s
        if any(finding.check == "loop" for finding in findings):
            self.late_s.append(time_s)
