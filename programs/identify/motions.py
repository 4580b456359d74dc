"""Motions of `contactd identify`, as link positions (N, n) [rad] every period."""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector
from daemon.config.schema import Configuration
from estimator.model import Model
from identification.excitation import Bounds, Fourier, fourier_within, point_to_point, trajectory

SHARE = 0.7
"""Share of the range, velocity and acceleration that the limits allow."""
REPEATS_S = 32.0
"""Period of an excitation for masses, friction and levels [s]: a repetition adds no information,
and repeats its errors, too."""
SLOWEST_S = 8.0
"""Period of its slowest harmonic [s]."""
HAND_S = 300.0
"""Time that a hand has for one joint [s]."""
WIRING_TRAVEL = 0.02
"""Travel of the link, each way [rad]."""
WIRING_SPEED = 0.03
WIDEST_GUESS = 0.05
"""Largest half-gap for which a motor goes on when its link does not follow it [rad]."""


def bounds_of(c: Configuration) -> Bounds:
    """Configured limits as bounds of an excitation."""
    rows = [
        (j.limits.lower, j.limits.upper, j.limits.velocity, j.limits.acceleration) for j in c.joints
    ]
    return Bounds(*np.array(rows, dtype=np.float64).T)


@dataclass(frozen=True, slots=True)
class Excitation:
    """Excitation: a Fourier series for all joints, and a slow way to it from anywhere."""

    motion: Fourier
    slow: Bounds
    period_s: float

    def path(self, here: Vector, seconds: float) -> Matrix:
        """Path (N, n) [rad] from here to the series, and along it for so many seconds."""
        return trajectory(self.motion, here, self.slow, seconds, self.period_s)

    def approach_s(self, here: Vector) -> float:
        """Time that the way from here to the series takes [s]."""
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
    """Random excitation within the bounds, that repeats after so long, with a slowest harmonic of
    so long; the same for the same seed."""
    rng, lowest = np.random.default_rng(seed), round(repeats_s / slowest_s)
    motion = fourier_within(bounds.shrunk(SHARE), model, rng, period_s=repeats_s, lowest=lowest)
    return Excitation(motion, slow(bounds), period_s)


def slow(bounds: Bounds) -> Bounds:
    """Bounds of a way from one place to another."""
    return Bounds(bounds.lower, bounds.upper, 0.3 * bounds.velocity, 0.3 * bounds.acceleration)


def wiring_motion(
    here: Vector, joint: int, half_gap: float, period_s: float, *, speeding_up: bool = False
) -> Matrix:
    """Motion of one joint's motor to and fro, twice: through its gap, and further by the travel of
    its link; `speeding_up` as in `strokes`."""
    way = 2.0 * half_gap + WIRING_TRAVEL
    return strokes(here, joint, way, WIRING_SPEED, 3, period_s, speeding_up=speeding_up)


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
    """Motion of one joint to and fro about here, `count` times from end to end of a way [rad],
    between two halves; with ramps of a fifth of a second, or speeding up all along each way, which
    takes twice the time and carries a link that nothing else holds: it cannot float ahead."""
    shape = _rising if speeding_up else _trapezium
    whole = shape(way / speed, period_s)
    half = shape(0.5 * way / speed - 0.1, period_s)
    half *= 0.5 * whole.sum() / half.sum()  # so that the last ends where the first began
    signs = [1.0 if k % 2 else -1.0 for k in range(count)]
    speeds = np.concatenate([half, *(sign * whole for sign in signs), -signs[-1] * half])
    path = np.tile(here, (len(speeds) + 1, 1))
    path[1:, joint] += np.cumsum(speeds) * speed * period_s
    return path


def _trapezium(length_s: float, period_s: float) -> Vector:
    t = np.arange(0.0, length_s + 0.4, period_s)
    return np.asarray(np.clip(np.minimum(t, length_s + 0.4 - t) / 0.2, 0.0, 1.0))


def _rising(length_s: float, period_s: float) -> Vector:
    """Speed over the way of `_trapezium` that rises until a fifth of a second before the end."""
    whole_s = 2.0 * (length_s + 0.2)
    t = np.arange(0.0, whole_s, period_s)
    return np.asarray(np.minimum(t / (whole_s - 0.2), (whole_s - t) / 0.2))


def stand(here: Vector) -> Matrix:
    """Motion that stays here: two rows, at any interval."""
    return np.tile(here, (2, 1))
