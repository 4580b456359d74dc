"""Trajectory: a path around an anchor, run along a path time that starts and stops softly.

The path is a function of a path time s. Pausing, stopping and resuming change how fast s runs,
never the path itself, so the setpoint cannot leave it. A path consists of displacements:
after a person has moved the arm, the same path is anchored anew where the arm stands. Only a path
to a pose changes with its starting point.
"""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector


class JointPath(Protocol):
    """Path: a displacement of every joint as a function of path time; vectors of shape (n,)."""

    @property
    def name(self) -> str:
        """Name for messages."""

    @property
    def duration(self) -> float:
        """Path time at its end [s]; infinite if it has none."""

    @property
    def begin(self) -> Vector | None:
        """Pose required at s = 0 [rad], NaN for a joint that may be anywhere; None if the path may
        begin from any pose."""

    @property
    def motors_only(self) -> bool:
        """True if the motors follow the slope and no loop closes over the links."""

    @property
    def halts_at_contact(self) -> bool:
        """True if a contact halts the arm on this path when there is no other reaction, that is
        while it is not armed."""

    def continued_from(self, q: Vector) -> "JointPath":
        """Path that continues from q (n,) [rad], to which the arm was led: itself if it consists of
        displacements; a new one from there if it leads to a pose."""

    def offset(self, s: float) -> Vector:
        """Displacement from the anchor's origin [rad] at path time s [s]."""

    def slope(self, s: float) -> Vector:
        """d offset / d s [rad/s]."""

    def extent(self, s: float) -> tuple[Vector, Vector]:
        """Lowest and highest offset [rad] from path time s on."""

    def fastest(self, s: float) -> Vector:
        """Largest |slope| [rad/s] from path time s on; (n,)."""


@dataclass(frozen=True, slots=True)
class Sinusoids:
    """Sinusoids: offset(s) = amplitude sin(omega s), per joint; zero amplitude holds."""

    amplitude: Vector
    omega: Vector
    name: str = "sinusoids"
    duration: float = math.inf
    begin: Vector | None = None
    motors_only: bool = False
    halts_at_contact: bool = False

    def continued_from(self, q: Vector) -> "Sinusoids":
        """Itself: it swings around any pose."""
        del q
        return self

    def offset(self, s: float) -> Vector:
        """Displacement [rad] at path time s [s]."""
        joints = zip(self.amplitude.tolist(), self.omega.tolist(), strict=True)
        return np.array([a * math.sin(omega * s) for a, omega in joints])

    def slope(self, s: float) -> Vector:
        """d offset / d s [rad/s]."""
        joints = zip(self.amplitude.tolist(), self.omega.tolist(), strict=True)
        return np.array([a * omega * math.cos(omega * s) for a, omega in joints])

    def extent(self, s: float) -> tuple[Vector, Vector]:
        """Lowest and highest offset [rad]: the amplitudes, as the motion does not end."""
        return -self.amplitude, self.amplitude

    def fastest(self, s: float) -> Vector:
        """Largest speed [rad/s], which recurs in every period."""
        return np.abs(self.amplitude * self.omega)


# Tolerance for sums of rounded numbers; far below the resolution of any drive [rad].
ROUNDING = 1e-9

# Path time before the end at which a Follower counts as finished, because of rounding [s].
LEFT_S = 1e-13


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of the position loop: q (n,) [rad] and its velocity (n,) [rad/s]."""

    q: Vector
    velocity: Vector


def stands(path: JointPath) -> bool:
    """True for sinusoids of no joint, as in an empty configuration: they would run forever, and
    move nothing."""
    return isinstance(path, Sinusoids) and not path.amplitude.any()


@dataclass(frozen=True, slots=True)
class PathPoint:
    """Point of a path, from which a Follower can run it."""

    path: JointPath
    s: float = 0.0

    def continued_from(self, q: Vector) -> "PathPoint":
        """Point at which the path continues from q (n,) [rad]."""
        path = self.path.continued_from(q)
        return self if path is self.path else PathPoint(path)

    def leaves_limits(self, q: Vector, lower: Vector, upper: Vector) -> NDArray[np.bool_]:
        """Mask (n,) of joints whose path from here on, continued from q, leaves [lower, upper]; a
        joint that holds does not."""
        first, last = self.continued_from(q).room(lower, upper)
        return (q < first - ROUNDING) | (q > last + ROUNDING)

    def room(self, lower: Vector, upper: Vector) -> tuple[Vector, Vector]:
        """Lowest and highest pose (n,) [rad] from which the path from here on stays within [lower,
        upper]; the lowest is above the highest if it fits nowhere. Infinite for a joint that
        holds."""
        offset, (low, high) = self.path.offset(self.s), self.path.extent(self.s)
        moves = self.path.fastest(self.s) > 0.0
        first = np.where(moves, lower - low + offset, -np.inf)
        return first, np.where(moves, upper - high + offset, np.inf)

    def nearest(self, q: Vector, lower: Vector, upper: Vector, inside: float = 0.0) -> Vector:
        """Pose (n,) [rad] nearest to q from which the path from here on stays within [lower,
        upper] with a margin of `inside` [rad], or centred if there is less room; NaN for a joint
        whose path fits nowhere."""
        first, last = self.continued_from(q).room(lower, upper)
        room = last - first
        margin = np.minimum(inside, 0.5 * room)
        nearest = np.minimum(np.maximum(q, first + margin), last - margin)
        return np.where(room < 0.0, np.nan, nearest)

    def off_start(self, q: Vector, tolerance: float) -> NDArray[np.bool_]:
        """Mask (n,) of joints further than `tolerance` [rad] from the pose where the path begins;
        all false if it continues from a later place."""
        begin = self.path.begin
        if begin is None or self.s > 0.0:
            return np.zeros(len(q), dtype=np.bool_)
        return np.abs(q - begin) > tolerance  # false for NaN


@dataclass(slots=True)
class Follower:
    """Follower of one path: its point, its rate, and the origin that the path is anchored to."""

    place: PathPoint
    ramp_s: float
    _rate: float = 0.0  # ds/dt: 0 at standstill, 1 at full speed
    _origin: Vector = field(default_factory=lambda: np.zeros(0))

    @property
    def finished(self) -> bool:
        """True at the end of the path."""
        return self.place.s >= self.place.path.duration

    def anchor(self, q: Vector) -> None:
        """Anchor the path at q (n,) [rad] for the present path time, at standstill; a path that
        leads to a pose begins there."""
        self._rate = 0.0
        self.place = self.place.continued_from(q)
        self._origin = q - self.place.path.offset(self.place.s)

    def step(self, dt: float) -> Reference:
        """Advance by dt [s] and return the reference there.

        ds/dt rises linearly to 1 within `ramp_s`, and falls at the same rate before the path's end.
        """
        path, s = self.place.path, self.place.s
        room = max(path.duration - s, 0.0)
        rate = min(1.0, self._rate + dt / self.ramp_s, _braking_rate(room, dt, self.ramp_s))
        s += 0.5 * (self._rate + rate) * dt
        if path.duration - s < LEFT_S:
            s = path.duration
        self._rate, self.place = rate, PathPoint(path, s)
        return Reference(self._origin + path.offset(s), path.slope(s) * rate)


def _braking_rate(room: float, dt: float, ramp_s: float) -> float:
    """Largest ds/dt from which path time still stops within `room` [s], falling by 1 in `ramp_s`:
    r dt + r^2 ramp / 2 = room."""
    return (math.sqrt(dt * dt + 2.0 * ramp_s * room) - dt) / ramp_s
