"""Motions of `contactd identify`, as link positions (N, n) [rad], one row per period."""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector
from daemon.config.schema import Configuration
from estimator.model import Model
from identification.excitation import Bounds, Fourier, fourier_within, point_to_point, trajectory

SHARE = 0.7
"""Share of the limits' range, velocity and acceleration that excitations use."""
REPEATS_S = 32.0
"""Repetition period of excitations for masses, friction and levels [s]: a repetition adds no
information, and repeats systematic errors."""
SLOWEST_S = 8.0
"""Period of the slowest harmonic of an excitation [s]."""
HAND_S = 300.0
"""Time limit for moving one joint by hand [s]."""
WIRING_TRAVEL = 0.02
"""Travel of the link in each direction [rad]."""
WIRING_SPEED = 0.03  # [rad/s]
WIDEST_GUESS = 0.05
"""Largest half-gap up to which a motor moves further if its link does not follow [rad]."""


def bounds_of(c: Configuration) -> Bounds:
    """Configured limits as bounds of an excitation."""
    rows = [
        (j.limits.lower, j.limits.upper, j.limits.velocity, j.limits.acceleration) for j in c.joints
    ]
    return Bounds(*np.array(rows, dtype=np.float64).T)


@dataclass(frozen=True, slots=True)
class Excitation:
    """Excitation: a Fourier series for all joints, and a slow approach to it from any pose."""

    motion: Fourier
    slow: Bounds
    period_s: float

    def path(self, here: Vector, seconds: float) -> Matrix:
        """Path (N, n) [rad] from here to the series, then along it for `seconds`."""
        return trajectory(self.motion, here, self.slow, seconds, self.period_s)

    def approach_s(self, here: Vector) -> float:
        """Duration of the approach from here to the series [s]."""
        start = self.motion.at(np.zeros(1))[0][0]
        return self.period_s * len(point_to_point(here, start, self.slow, self.period_s))


def excitation(
    bounds: Bounds,
    model: Model,
    period_s: float,
    seed: int,
    repeats_s: float = REPEATS_S,
    slowest_s: float = SLOWEST_S,
) -> Excitation:
    """Random excitation within the bounds, reproducible by its seed, with repetition period
    repeats_s and slowest harmonic slowest_s."""
    rng, lowest = np.random.default_rng(seed), round(repeats_s / slowest_s)
    motion = fourier_within(bounds.shrunk(SHARE), model, rng, period_s=repeats_s, lowest=lowest)
    return Excitation(motion, slow(bounds), period_s)


def slow(bounds: Bounds) -> Bounds:
    """Bounds of a slow motion between two poses."""
    return Bounds(bounds.lower, bounds.upper, 0.3 * bounds.velocity, 0.3 * bounds.acceleration)


def wiring_motion(
    here: Vector, joint: int, half_gap: float, period_s: float, *, speeding_up: bool = False
) -> Matrix:
    """Motion of one joint's motor to and fro, twice: across its gap, and further by the travel of
    its link; `speeding_up` as in `strokes`."""
    length = 2.0 * half_gap + WIRING_TRAVEL
    return strokes(here, joint, length, WIRING_SPEED, 3, period_s, speeding_up=speeding_up)


def strokes(
    here: Vector,
    joint: int,
    way: float,
    speed: float,
    count: int,
    period_s: float,
    *,
    speeding_up: bool = False,
) -> Matrix:
    """Motion of one joint to and fro about here: `count` strokes of length `way` [rad] between two
    half strokes, with ramps of 0.2 s. With `speeding_up` each stroke accelerates throughout, which
    takes twice the time and pushes a link without load along, so that it cannot float ahead."""
    shape = _rising if speeding_up else _trapezium
    full = shape(way / speed, period_s)
    half = shape(0.5 * way / speed - 0.1, period_s)
    half *= 0.5 * full.sum() / half.sum()  # makes the motion end where it began
    signs = [1.0 if k % 2 else -1.0 for k in range(count)]
    speeds = np.concatenate([half, *(sign * full for sign in signs), -signs[-1] * half])
    path = np.tile(here, (len(speeds) + 1, 1))
    path[1:, joint] += np.cumsum(speeds) * speed * period_s
    return path


def _trapezium(length_s: float, period_s: float) -> Vector:
    t = np.arange(0.0, length_s + 0.4, period_s)
    return np.asarray(np.clip(np.minimum(t, length_s + 0.4 - t) / 0.2, 0.0, 1.0))


def _rising(length_s: float, period_s: float) -> Vector:
    """Speed profile over the distance of `_trapezium` that rises until 0.2 s before the end."""
    total_s = 2.0 * (length_s + 0.2)
    t = np.arange(0.0, total_s, period_s)
    return np.asarray(np.minimum(t / (total_s - 0.2), (total_s - t) / 0.2))


def stand(here: Vector) -> Matrix:
    """Motion without movement: two equal rows, for any interval."""
    return np.tile(here, (2, 1))
