"""Figures of the daemon's loop while another process runs beside it."""

from collections.abc import Sequence

import numpy as np

from bench.rigs.processes import Pair
from daemon.protocol.state import State

Figures = dict[str, float]


def watch(both: Pair, seconds: float) -> list[State]:
    """States of so many seconds."""
    client, _, states = both.subscribed()
    with client:
        found = [next(states)]
        while found[-1].time_s - found[0].time_s < seconds:
            found.append(next(states))
    return found


def p99_us(states: list[State]) -> Figures:
    """p99 of the tick's work, of the doors, and of both together [us]."""
    tick, doors = np.array([(s.timing.work_us, s.timing.doors_us) for s in states]).T
    parts = {"both": tick + doors, "tick": tick, "doors": doors}
    return {name: float(np.percentile(part, 99)) for name, part in parts.items()}


def median_ratio(beside: Sequence[Figures], without: Sequence[Figures], what: str) -> float:
    """Median over rounds of a figure with the other process over that without it."""
    pairs = zip(beside, without, strict=True)
    return float(np.median([there[what] / here[what] for there, here in pairs]))
