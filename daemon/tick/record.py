"""Record of one tick: what was measured, estimated, found and decided in it, and when.

Made once at the end of each tick and never changed, so that whatever is asked between two ticks
(status, arming, the published State) is asked of one moment.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
from daemon.faults.finding import Finding
from daemon.modes.table import Mode
from daemon.protocol.messages import Notice
from daemon.tick.controller import Decision
from drivers.answers import Samples
from estimator.estimate import Estimate
from estimator.payload import Payload


@dataclass(frozen=True, slots=True)
class Wakeup:
    """Wake-up of the loop for a tick: when it came, and how well it met its deadline."""

    monotonic_s: float = 0.0
    lateness_s: float = 0.0
    work_s: float = 0.0  # of the tick before
    missed: int = 0  # deadlines, since the start
    left_out: int = 0  # deadlines that this tick came too late for
    doors_s: float = 0.0  # what clients and the log took, after the tick before
    wall_s: float = 0.0  # Unix time


ON_TIME = Wakeup()


@dataclass(frozen=True, slots=True)
class TickRecord:
    """One tick. Nothing of it changes afterwards; arrays of shape (n,), SI at the link."""

    number: int
    time_s: float  # since the loop started
    wakeup: Wakeup
    samples: Samples
    interval_s: float  # since the tick before
    estimate: Estimate | None  # None until every joint had sent a sample
    sensing: NDArray[np.bool_]  # joints that sense contact
    sensing_since_s: Vector  # when that changed last [s]
    findings: tuple[Finding, ...]
    decision: Decision | None  # None as long as `estimate` is
    mode: Mode  # after the decision, like all that follows
    armed: bool
    cause: str  # of the mode
    moving: bool  # a trajectory runs, or goes on after this contact
    quiet_s: float  # since the last tick with a non-zero thresholded residual
    unproved: tuple[str, ...]  # joints that were told to stop and not seen to stand
    payload: Payload | None  # that the model counts
    recognised: Payload | None  # that nobody told; nothing is learned meanwhile
    silenced: bool  # the last stage of a stop: the drives hear nothing of us
    notices: tuple[Notice, ...]  # news of this tick, and of the requests before it
