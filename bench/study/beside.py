"""Daemon while another process runs beside it: its loop's figures, and what that process takes."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.rigs.processes import Pair
from daemon.protocol.state import State

Figures = dict[str, float]


def watch(both: Pair, seconds: float) -> list[State]:
    """States of so many seconds."""
    client, _, states = both.subscribed()
    with client:
        first = next(states)
        found = [first]
        while found[-1].time_s - first.time_s < seconds:
            found.append(next(states))
    return found


def p99_us(states: list[State]) -> Figures:
    """p99 of the tick's work, of the doors, and of both together [us]."""
    both = [s.timing.work_us + s.timing.doors_us for s in states]
    return {
        "both": float(np.percentile(both, 99)),
        "tick": float(np.percentile([s.timing.work_us for s in states], 99)),
        "doors": float(np.percentile([s.timing.doors_us for s in states], 99)),
    }


def median_ratio(beside: Sequence[Figures], without: Sequence[Figures], what: str) -> float:
    """Median over rounds of a figure with the other process over that without it."""
    pairs = zip(beside, without, strict=True)
    return float(np.median([there[what] / here[what] for there, here in pairs]))


def cpu_s(pid: int) -> float:
    """Processor time that a process has taken [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def peak_mb(pid: int) -> float:
    """Most memory that a process has had [MB]."""
    return _memory_mb(pid, "VmHWM")


def resident_mb(pid: int) -> float:
    """Memory that a process has now [MB]."""
    return _memory_mb(pid, "VmRSS")


def _memory_mb(pid: int, what: str) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith(what))
