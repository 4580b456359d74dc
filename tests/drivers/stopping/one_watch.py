"""Watch on a drive commanded to stop: ticks of 10 ms, 10 rad/s2, and 0.24 rad to stop in."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from hypothesis import strategies as st

from drivers.api import DriveCondition
from drivers.stopping.stop_watch import Stage, StopBounds, StopReading, StopWatch

T = 0.01
ON, STOPS = DriveCondition.OPERATING, DriveCondition.STOPPED
LIMP = DriveCondition.OFF
BOUNDS = StopBounds(
    deceleration=10.0, current=2.0, travel=0.24, play=0.0, master_timeout_s=0.1, ticks=3, period_s=T
)
RUNS = StopReading(ON, 1.0, 0.0, 0.0)


def commanded(
    speed: float = 0.0,
    stage: Stage = Stage.SETPOINT,
    position: float = 0.0,
    bounds: StopBounds = BOUNDS,
) -> StopWatch:
    """Commanded to stop at `speed`; one that stands has stood there for a second."""
    watch = StopWatch(bounds)
    watch.witness.take(0.0 if speed else -1.0, speed, math.nan, position)
    watch.begin(0.0, stage, speed)
    return watch


def readings(states: Iterable[DriveCondition]) -> st.SearchStrategy[StopReading | None]:
    """Readings of drives in one of these states, or nothing fresh."""
    return st.none() | st.builds(
        StopReading,
        st.sampled_from(sorted(states, key=str)),
        st.floats(-3.0, 3.0) | st.just(math.nan),
        st.floats(-2.0, 2.0) | st.just(math.nan),
        st.floats(-1.0, 1.0) | st.just(math.nan),
    )


@dataclass
class Course:
    """Motion of a drive after it was commanded to stop at 1 rad/s, and what came of it."""

    velocity_at: Callable[[float], float]
    current: float = 0.0
    ticks: int = 100
    start: float = 0.0
    condition: DriveCondition = STOPS
    stage: Stage = Stage.SETPOINT
    bounds: StopBounds = BOUNDS
    watch: StopWatch = field(init=False)
    begun: list[Stage] = field(default_factory=list, init=False)
    runs_on: list[int] = field(default_factory=list, init=False)  # ticks in which it did
    cut: list[int] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.watch = commanded(1.0, self.stage, self.start, self.bounds)
        position = self.start
        for k in range(1, self.ticks):
            velocity = self.velocity_at(k * T)
            position += velocity * T
            seen = StopReading(self.condition, velocity, self.current, position)
            if stage := self.watch.step(k * T, seen):
                self.begun.append(stage)
            self.runs_on += [k] if self.watch.runs_on else []
            self.cut += [k] if self.watch.cut else []
