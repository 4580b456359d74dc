"""Rivals of the daemon's stream of targets: Ruckig on the targets as they come, Ruckig behind the
playout, and a low-pass.

Ruckig (L. Berscheid and T. Kroeger, 2021) is a library of time-optimal motion within velocity,
acceleration and jerk; it is no dependency of contactd, and tried where it is installed.
"""

import importlib
import time
from typing import Any, Final

import numpy as np

from bench.study.streamed import Arrival, Track
from common.arrays import Vector
from daemon.motion.limits import Limits
from daemon.motion.playout import Playout
from daemon.motion.target_stream import STREAM_SHARE
from daemon.motion.tracker import JERK_S

LOW_PASS_S: Final = 0.04  # time constant
RIVALS: Final = ("ruckig", "ruckig behind the playout", "low-pass")


def rival(
    name: str, limits: Limits, coming: list[Arrival], seconds: float, period_s: float
) -> tuple[Track, float] | None:
    """Track of a rival, and the longest time that it took in a tick [s]; None where its library is
    not installed."""
    first = coming[0].target
    playout = Playout(first, 0.0)
    follower: Any
    if name == "low-pass":
        follower = _LowPass(first.q, period_s)
    else:
        try:
            library = importlib.import_module("ruckig")
        except ImportError:
            return None
        follower = _Ruckig(library, limits, first.q, period_s)
    rows, k, begun_s, longest_s = [], 0, coming[0].at_s, 0.0
    newest = first.q
    for tick in range(1, round(seconds / period_s)):
        now_s = begun_s + tick * period_s
        while k < len(coming) and coming[k].at_s <= now_s:
            if playout.put(coming[k].target, now_s - begun_s):
                newest = coming[k].target.q
            k += 1
        playout.step(now_s - begun_s, period_s)
        goal, speed = playout.read() if "playout" in name else (newest, np.zeros_like(newest))
        before_s = time.perf_counter()
        q, velocity = follower.step(goal, np.clip(speed, -limits.velocity, limits.velocity))
        longest_s = max(longest_s, time.perf_counter() - before_s)
        rows.append((now_s, q, velocity, 0.0))
    time_s, qs, velocities, delay_s = zip(*rows, strict=True)
    track = Track(np.array(time_s), np.array(qs), np.array(velocities), np.array(delay_s))
    return track, longest_s


class _LowPass:
    """First-order low-pass of the targets, without limits."""

    def __init__(self, q: Vector, period_s: float) -> None:
        self._q, self._share, self._period_s = q, period_s / LOW_PASS_S, period_s

    def step(self, goal: Vector, _speed: Vector) -> tuple[Vector, Vector]:
        before = self._q
        self._q = before + min(self._share, 1.0) * (goal - before)
        return self._q, (self._q - before) / self._period_s


class _Ruckig:
    """Ruckig, asked anew in each tick, with the limits of the daemon's stream."""

    def __init__(self, library: Any, limits: Limits, q: Vector, period_s: float) -> None:
        n = len(q)
        self._otg = library.Ruckig(n, period_s)
        self._input, self._output = library.InputParameter(n), library.OutputParameter(n)
        acceleration = STREAM_SHARE * limits.acceleration
        self._input.max_velocity = limits.velocity.tolist()
        self._input.max_acceleration = acceleration.tolist()
        self._input.max_jerk = (acceleration / JERK_S).tolist()
        self._input.current_position = q.tolist()
        self._input.current_velocity = [0.0] * n
        self._input.current_acceleration = [0.0] * n
        self._input.target_acceleration = [0.0] * n

    def step(self, goal: Vector, speed: Vector) -> tuple[Vector, Vector]:
        self._input.target_position = goal.tolist()
        self._input.target_velocity = speed.tolist()
        self._otg.update(self._input, self._output)
        self._output.pass_to_input(self._input)
        return np.array(self._output.new_position), np.array(self._output.new_velocity)
