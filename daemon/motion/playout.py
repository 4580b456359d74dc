"""Playout buffer of a stream of targets: the sender's motion, smoothed, at a steady delay.

Targets come late, early, twice, out of order, or not at all. Each carries its sender's time, so its
lateness shows. The buffer is read some tens of milliseconds behind the sender: by its period, by
the largest lateness of the last seconds, and by half of the window over which the motion is
averaged. Nearly every target is thus received before it is due, and interpolated, not predicted.

The mean of a piecewise linear motion over a window is a quadratic spline: position and velocity are
smooth, and steps of a coarse encoder do not become jerks.

Pure: the receiver's time is an argument. Times in s, positions in rad, vectors of shape (n,).
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from common.arrays import Vector

# Size of the buffer: targets of the longest delay and window, at 300 Hz.
KEPT: Final = 80
# Shortest time between two targets; some targets of a faster sender are dropped [s].
LEAST_SPACING_S: Final = 1e-3
# Smallest half width of the window [s].
LEAST_HALF_WINDOW_S: Final = 0.025
# Longest delay behind the sender [s].
LONGEST_DELAY_S: Final = 0.15
# A target this late is dropped, as the arm is past it [s].
TOO_LATE_S: Final = 0.15
# Time after the last target for which its velocity is extrapolated [s].
HOLDOVER_S: Final = 0.15
# Shortest time over which the velocity at the last target is measured [s].
VELOCITY_S: Final = 0.02
# Time by which a target may come earlier than the earliest one [s]: a sender's clock that jumps
# further forwards restarts the buffer; one that does not count in seconds does so at each target.
EARLY_S: Final = 0.25
# Share of real time by which reading may run fast or slow, to change its delay smoothly.
SLEW: Final = 0.1
# Time constant with which lateness is forgotten [s], and clock drift that is followed [s/s].
FORGET_S: Final = 2.0
DRIFT: Final = 1e-3
# Weight of the newest spacing in the sender's period, and longest spacing that counts [s].
PERIOD_WEIGHT: Final = 0.05
LONGEST_PERIOD_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class Target:
    """Target: pose q (n,) [rad], its velocity (n,) [rad/s] or None, and its number and time [s], as
    given by the sender."""

    number: int
    sent_s: float
    q: Vector
    velocity: Vector | None = None


@dataclass(frozen=True, slots=True)
class _Node:
    """Target in the buffer, with the integral (n,) [rad s] of the motion up to it."""

    sent_s: float
    q: Vector
    integral: Vector


@dataclass(slots=True)
class Playout:
    """Buffer of one sender's targets, beginning with the first one, received at `now_s`."""

    first: Target
    now_s: float
    period_s: float = 0.0  # of the sender, as estimated; 0 before the second target
    jitter_s: float = 0.0  # largest lateness of the last seconds
    lost: int = 0  # targets never received, by their numbers
    dropped: int = 0  # targets out of order, repeated or too late
    jumps: int = 0  # of the sender's clock, forwards
    newest: Target = field(init=False)
    _velocity: Vector = field(init=False)  # at the newest
    _nodes: list[_Node] = field(init=False)
    _base_s: float = field(init=False)  # receiver's time minus sender's, of the earliest arrivals
    _at_s: float = field(init=False)  # sender's time in the middle of the window

    def __post_init__(self) -> None:
        self._begin(self.first, self.now_s)

    def _begin(self, target: Target, now_s: float) -> None:
        self.newest = target
        self._velocity = np.zeros_like(target.q)
        self._nodes = [_Node(target.sent_s, target.q, np.zeros_like(target.q))]
        self._base_s = now_s - target.sent_s
        self._at_s = target.sent_s - self.delay_s

    @property
    def speed(self) -> Vector:
        """Velocity (n,) [rad/s] at the newest target."""
        return self._velocity

    @property
    def half_window_s(self) -> float:
        """Half width of the averaging window [s]: half a period, or more."""
        return max(0.5 * self.period_s, LEAST_HALF_WINDOW_S)

    @property
    def delay_s(self) -> float:
        """Desired delay behind the sender [s]."""
        return min(self.period_s + self.jitter_s + self.half_window_s, LONGEST_DELAY_S)

    def put(self, target: Target, now_s: float) -> bool:
        """Add a target received at now_s. False if it is dropped (out of order, repeated, sent
        before or hardly after the previous one, too late), or if it restarts the buffer."""
        newest = self.newest
        late_s = now_s - target.sent_s - self._base_s
        soon = target.sent_s < newest.sent_s + LEAST_SPACING_S
        if target.number <= newest.number or soon or late_s > TOO_LATE_S:
            self.dropped += 1
            return False
        if late_s < -EARLY_S:
            self.jumps += 1
            self._begin(target, now_s)
            return False
        self._base_s += min(late_s, 0.0)
        self.jitter_s = max(self.jitter_s, late_s)
        count, elapsed_s = target.number - newest.number, target.sent_s - newest.sent_s
        self.lost += count - 1
        spacing_s = min(elapsed_s / count, LONGEST_PERIOD_S)
        weight = PERIOD_WEIGHT if self.period_s else 1.0
        self.period_s += weight * (spacing_s - self.period_s)
        self._velocity = self._slope_to(target) if target.velocity is None else target.velocity
        last = self._nodes[-1]
        integral = last.integral + 0.5 * elapsed_s * (last.q + target.q)
        self._nodes.append(_Node(target.sent_s, target.q, integral))
        if len(self._nodes) > KEPT:
            del self._nodes[0]
        self.newest = target
        return True

    def _slope_to(self, target: Target) -> Vector:
        """Velocity (n,) [rad/s] to a target, from the latest one at least VELOCITY_S before it."""
        before = self._nodes[0]
        for node in reversed(self._nodes):
            if target.sent_s - node.sent_s >= VELOCITY_S:
                before = node
                break
        slope: Vector = (target.q - before.q) / (target.sent_s - before.sent_s)
        return slope

    def step(self, now_s: float, dt: float) -> None:
        """Advance the time of reading by dt [s], slightly more or less to adjust the delay."""
        self.now_s = now_s
        self.jitter_s -= dt / FORGET_S * self.jitter_s
        self._base_s += DRIFT * dt
        error_s = now_s - self._base_s - self.delay_s - self._at_s - dt
        # Further behind than any delay, as the sender's clock runs too fast: skip the past.
        most_s = error_s if error_s > EARLY_S else SLEW * dt
        self._at_s += dt + min(max(error_s, -SLEW * dt), most_s)

    def read(self, ahead_s: float = 0.0) -> tuple[Vector, Vector]:
        """Means over the window: pose (n,) [rad] now, and velocity (n,) [rad/s] `ahead_s` later."""
        half_s = self.half_window_s
        _, after = self._at(self._at_s + half_s)
        _, before = self._at(self._at_s - half_s)
        q_after, _ = self._at(self._at_s + ahead_s + half_s)
        q_before, _ = self._at(self._at_s + ahead_s - half_s)
        return (after - before) / (2.0 * half_s), (q_after - q_before) / (2.0 * half_s)

    def _at(self, s: float) -> tuple[Vector, Vector]:
        """Pose (n,) [rad], and its integral (n,) [rad s], at the sender's time s."""
        nodes = self._nodes
        last = nodes[-1]
        if s >= last.sent_s:
            ahead_s = s - last.sent_s
            moving_s = min(ahead_s, HOLDOVER_S)
            travel = moving_s * self._velocity
            integral = last.integral + ahead_s * (last.q + travel) - 0.5 * moving_s * travel
            return last.q + travel, integral
        for i in range(len(nodes) - 2, -1, -1):
            node, later = nodes[i], nodes[i + 1]
            if s >= node.sent_s:
                ahead_s = s - node.sent_s
                q = node.q + ahead_s / (later.sent_s - node.sent_s) * (later.q - node.q)
                return q, node.integral + 0.5 * ahead_s * (node.q + q)
        first = nodes[0]
        return first.q, first.integral + (s - first.sent_s) * first.q
