"""Excitation that separates friction, rotor inertia and gravity: bounded Fourier series, chosen for
good conditioning, that begin and end at rest."""

from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import ModelError
from estimator.model import Model

HARMONICS = 6
_SAMPLES = 200  # per period of the slowest harmonic, to check bounds and conditioning


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of a motion, each of shape (n,): rad, rad/s, rad/s2."""

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector

    def shrunk(self, share: float) -> "Bounds":
        """Bounds with a share of the range about its middle, and of velocity and acceleration."""
        middle, half = 0.5 * (self.lower + self.upper), 0.5 * share * (self.upper - self.lower)
        return Bounds(
            middle - half, middle + half, share * self.velocity, share * self.acceleration
        )


@dataclass(frozen=True, slots=True)
class Fourier:
    """q(s) = center + sum over k >= lowest of sine_k sin(k w s) + cosine_k cos(k w s),
    w = 2 pi / period."""

    center: Vector
    """(n,) [rad]"""
    sine: Matrix
    """(harmonics, n) [rad]"""
    cosine: Matrix
    """(harmonics, n) [rad]"""
    period_s: float
    lowest: int = 1
    """Number of the first harmonic: so many of its periods fit into `period_s`"""

    def at(self, s: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """q, dq/ds and d2q/ds2 at path times s (N,), each of shape (N, n)."""
        w = 2.0 * np.pi / self.period_s * (self.lowest + np.arange(len(self.sine)))
        angle = s[:, None] * w
        sin, cos = np.sin(angle), np.cos(angle)
        return (
            self.center + sin @ self.sine + cos @ self.cosine,
            (cos * w) @ self.sine - (sin * w) @ self.cosine,
            -(sin * w**2) @ self.sine - (cos * w**2) @ self.cosine,
        )


def fourier_within(
    bounds: Bounds,
    model: Model,
    rng: np.random.Generator,
    *,
    period_s: float = 8.0,
    lowest: int = 1,
    restarts: int = 100,
    sign_width: float = 0.02,
) -> Fourier:
    """Best conditioned of `restarts` random series that use the bounds as far as possible.

    lowest: number of the slowest harmonic in `period_s`; the fastest is HARMONICS times as fast.

    Raises ModelError if a joint has no room to move.
    """
    for name, room in zip(model.names, bounds.upper - bounds.lower, strict=True):
        if not room > 0.0:
            raise ModelError(f"{name} has no room for an excitation")
    candidates = (_random_series(bounds, rng, period_s, lowest) for _ in range(restarts))
    return min(candidates, key=lambda f: float(condition(f, model, sign_width).max()))


def condition(motion: Fourier, model: Model, sign_width: float) -> Vector:
    """Condition number (n,) of each joint's scaled columns: Coulomb, viscous, rotor, gravity."""
    s = np.linspace(0.0, motion.period_s, motion.lowest * _SAMPLES, endpoint=False)
    q, v, a = motion.at(s)
    g = np.array([model.gravity(row) for row in q])
    columns = np.stack([np.tanh(v / sign_width), v, a, g, np.ones_like(g)], axis=2)
    scale = np.sqrt(np.square(columns).mean(axis=0))
    # An axis along gravity has no gravity column; that is no lack of excitation.
    columns = columns / np.where(scale > 1e-6, scale, np.inf)
    values = np.linalg.svd(np.moveaxis(columns, 1, 0), compute_uv=False)
    smallest = np.where(values > 1e-6 * values[:, :1], values, np.inf).min(axis=1)
    return np.asarray(values[:, 0] / smallest)


def _random_series(
    bounds: Bounds, rng: np.random.Generator, period_s: float, lowest: int
) -> Fourier:
    n, number = len(bounds.lower), np.arange(lowest, HARMONICS * lowest + 1)
    fade = np.sqrt(1.0 / number)[:, None]
    sine, cosine = rng.standard_normal((2, len(number), n)) * fade
    raw = Fourier(np.zeros(n), sine, cosine, period_s, lowest)
    q, v, a = raw.at(np.linspace(0.0, period_s, lowest * _SAMPLES))
    low, high = q.min(axis=0), q.max(axis=0)
    scale = np.minimum.reduce(
        [
            (bounds.upper - bounds.lower) / (high - low),
            bounds.velocity / np.abs(v).max(axis=0),
            bounds.acceleration / np.abs(a).max(axis=0),
        ]
    )
    # Centred in the range, if the motion is smaller.
    center = 0.5 * (bounds.lower + bounds.upper - scale * (low + high))
    return Fourier(center, scale * sine, scale * cosine, period_s, lowest)


def smooth_path_times(length_s: float, ramp_s: float, dt: float) -> Vector:
    """Path times (N,) every dt from 0 to length_s, whose rate rises from 0 to 1 and falls back
    along s-curves of ramp_s."""
    ramp_s = min(ramp_s, length_s)
    t = np.append(np.arange(0.0, length_s + ramp_s, dt), length_s + ramp_s)

    def rate_integral(x: Vector) -> Vector:
        """Integral of 3 x^2 - 2 x^3 from 0 to x, then of 1."""
        inside = np.clip(x, 0.0, 1.0)
        return inside**3 - 0.5 * inside**4 + np.maximum(x - 1.0, 0.0)

    s = ramp_s * (rate_integral(t / ramp_s) - rate_integral((t - length_s) / ramp_s))
    return np.minimum(s, length_s)


def point_to_point(start: Vector, end: Vector, bounds: Bounds, dt: float) -> Matrix:
    """Straight line in joint space, from rest to rest by a quintic, as fast as the bounds allow."""
    distance = np.abs(end - start)
    # Peaks of the quintic of length 1 in time 1: speed 1.875, acceleration 5.774.
    duration = max(
        float((1.875 * distance / bounds.velocity).max()),
        float(np.sqrt(5.774 * distance / bounds.acceleration).max()),
        dt,
    )
    x = np.clip(np.arange(0.0, duration + dt, dt) / duration, 0.0, 1.0)
    return start + np.outer(x**3 * (10.0 - 15.0 * x + 6.0 * x**2), end - start)


def trajectory(
    motion: Fourier, here: Vector, bounds: Bounds, seconds: float, dt: float, ramp_s: float = 2.0
) -> Matrix:
    """Link positions (N, n) every dt: from `here` to the beginning of the motion, and `seconds` of
    it, rounded up to whole periods, with a soft start and stop."""
    periods = max(1, int(np.ceil(seconds / motion.period_s - 1e-9)))
    path, _, _ = motion.at(smooth_path_times(periods * motion.period_s, ramp_s, dt))
    return np.vstack([point_to_point(here, path[0], bounds, dt), path[1:]])
