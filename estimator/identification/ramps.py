"""The half-gap, from slow ramps of torque against a clamped link."""

import itertools

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from arrays import Vector
from estimator.identification.gap_result import SMALLEST, GapResult, GapVerdict, smoothed

_FLAT = 0.15  # of the outer stiffness: slope inside a clear dead zone
_RAMP_WIDTH = 0.002  # [rad/s] over which friction changes its sign in slow ramps


def from_ramps(name: str, time_s: Vector, phi: Vector, torque: Vector) -> GapResult:
    """A bounded, robust fit of torque = -k delta(phi - c) + F sign(theta_dot), and how flat the
    torque really is inside the gap it found. (Unbounded, a third of real files diverge.)"""
    period = float(np.median(np.diff(time_s)))
    x = smoothed(-phi, round(0.05 / period))  # theta, but for a constant
    tau = smoothed(torque, round(0.05 / period))
    every = max(1, round(0.06 / period))
    x, tau, time_s = x[::every], tau[::every], time_s[::every]
    v = np.gradient(x, time_s)
    whole = _dead_zone(x, v, tau)
    alpha, center, stiffness, _ = whole
    slope, coulomb = _inside(x, v, tau, center, alpha)
    blocks = np.array_split(np.arange(len(x)), 10)
    left_out = [
        _dead_zone(np.delete(x, b), np.delete(v, b), np.delete(tau, b), whole)[0] for b in blocks
    ]
    error = float(np.sqrt(0.9 * np.square(left_out - np.mean(left_out)).sum()))  # jackknife
    confidence = error * float(student.ppf(0.975, len(blocks) - 1))
    about = (
        f"inside, the torque rises with {slope:.3g} Nm/rad; outside, with {stiffness:.3g} Nm/rad"
    )
    clear = slope < _FLAT * stiffness and confidence < alpha
    if alpha < SMALLEST:
        return GapResult(joint=name, verdict=GapVerdict.NONE, reason=about, half_gap=0.0)
    if not clear:
        return GapResult(joint=name, verdict=GapVerdict.UNCLEAR, reason=about)
    return GapResult(joint=name, verdict=GapVerdict.CLEAR, reason=about, half_gap=float(alpha),
               confidence=confidence, coulomb=coulomb, stiffness=float(stiffness))  # fmt: skip


def _dead_zone(x: Vector, v: Vector, tau: Vector, start: Vector | None = None) -> Vector:
    """alpha, center, stiffness and Coulomb friction, bounded by what the data span."""
    span, height = float(np.ptp(x)), float(np.ptp(tau))
    rub = np.tanh(v / _RAMP_WIDTH)

    def missed(p: Vector) -> Vector:
        delta = x - p[1]
        delta = delta - np.clip(delta, -p[0], p[0])
        return np.asarray(p[2] * delta + p[3] * rub - tau)

    low = [0.0, float(x.min()), 0.0, 0.0]
    high = [0.5 * span, float(x.max()), 1e3 * height / span, height]
    middle = 0.5 * float(x.min() + x.max())
    starts = [np.array([share * span, middle, 2 * height / span, 0.05 * height])
              for share in (0.1, 0.25, 0.4)] if start is None else [start]  # fmt: skip
    fits = [
        least_squares(missed, np.clip(p, low, high), bounds=(low, high), loss="soft_l1",
                      f_scale=0.02 * height, x_scale=[span, span, height / span, height])
        for p in starts
    ]  # fmt: skip
    return np.asarray(min(fits, key=lambda fit: float(fit.cost)).x)


def _inside(x: Vector, v: Vector, tau: Vector, center: float, alpha: float) -> tuple[float, float]:
    """Slope of the mean of both directions, and half their difference, in the inner 60 %."""
    edges = np.linspace(center - 0.6 * alpha, center + 0.6 * alpha, 13)
    middle, mean, half = [], [], []
    for a, b in itertools.pairwise(edges):
        here = (x >= a) & (x < b)
        ways = [here & (v > _RAMP_WIDTH), here & (v < -_RAMP_WIDTH)]
        if all(way.any() for way in ways):
            up, down = (np.average(tau[way], weights=np.abs(v[way])) for way in ways)
            middle.append(0.5 * (a + b))
            mean.append(0.5 * (up + down))
            half.append(0.5 * (up - down))
    if len(middle) < 3:
        return float("inf"), float("nan")
    return float(np.polyfit(middle, mean, 1)[0]), float(np.median(half))
