"""Half-gap from slow ramps of torque against a clamped link."""

import itertools

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from common.arrays import Vector
from identification.gap_result import SMALLEST, GapResult, GapVerdict, Limit, refused, smoothed

_FLAT = 0.15  # of the outer stiffness: largest slope inside a clear dead zone
_RAMP_WIDTH = 0.003  # [rad/s] over which friction changes its sign in slow ramps
_RASTER_S = 0.02  # resampling period, whatever that of the log
_VELOCITY_S = 0.2  # over which the velocity is averaged: ramps last seconds
_END = 0.1  # of phi's range: so close to an end, the direction of friction is known
_POINTS = 400  # along the path, per range of phi
_FEWEST_BINS = 3
_LEFT = 0.1  # of the torque's variance: if more is unexplained, it is not a gap
_UNSURE = 0.15  # error of the bending, which is not quite in proportion to the torque


def from_ramps(name: str, time_s: Vector, phi: Vector, torque: Vector) -> GapResult:
    """Half-gap by a bounded, robust fit of torque = -k delta(phi - c) + F sign(theta_dot), with a
    check of how flat the torque is inside the gap found. (Unbounded, a third of real files
    diverge.)

    The first ramp counts from its end on, as the direction of its initial friction is unknown.
    """
    x, tau, v = _from_the_first_end(*_rastered(time_s, -phi, torque))
    fit = _dead_zone(x, v, tau)
    alpha, center, stiffness, _ = fit.tolist()
    slope, coulomb = _inside(x, tau, center, alpha)
    blocks = np.array_split(np.arange(len(x)), 10)
    left_out = [
        _dead_zone(np.delete(x, b), np.delete(v, b), np.delete(tau, b), fit)[0] for b in blocks
    ]
    error = float(np.sqrt(0.9 * np.square(left_out - np.mean(left_out)).sum()))  # jackknife
    error *= float(student.ppf(0.975, len(blocks) - 1))
    left = _missed(fit, x, v, tau)
    bent = float(np.percentile(_beyond(x, center, alpha), 99.0))
    hidden = float(left.std()) / max(stiffness, 1e-9)
    found = GapResult(
        joint=name,
        verdict=GapVerdict.CLEAR,
        reason=f"the torque rises by {slope:.3g} Nm/rad inside the gap, "
        f"and by {stiffness:.3g} Nm/rad outside",
        half_gap=alpha,
        confidence=float(np.linalg.norm([error, hidden, _UNSURE * bent])),
        coulomb=coulomb,
        stiffness=stiffness,
    )
    fits = Limit("share of the torque not explained", float(left.var() / tau.var()), _LEFT,
                 "", "a link that was not clamped, too slow a log, or another current")  # fmt: skip
    if alpha < SMALLEST and fits.kept and hidden < SMALLEST:
        return GapResult(
            joint=name,
            verdict=GapVerdict.NONE,
            reason=found.reason,
            half_gap=0.0,
            confidence=hidden,
        )
    limits = [
        fits,
        Limit("slope inside over slope outside", slope / stiffness, _FLAT, "",
              "preloaded or elastic gear: torque passes at once"),
        Limit("interval of alpha", 1e3 * found.confidence, 1e3 * alpha, "mrad",
              "too few ramps: make two or more, in both directions"),
    ]  # fmt: skip
    return refused(found, GapVerdict.UNCLEAR, limits)


def _rastered(time_s: Vector, x: Vector, tau: Vector) -> tuple[Vector, Vector, Vector]:
    """theta (up to a constant), torque and velocity every `_RASTER_S`. A slow log has few samples
    within the gap, while the ramp continues between them."""
    width = round(0.05 / float(np.median(np.diff(time_s))))
    raster = np.arange(time_s[0], time_s[-1], _RASTER_S)
    x, tau = (np.interp(raster, time_s, smoothed(values, width)) for values in (x, tau))
    return x, tau, np.gradient(smoothed(x, round(_VELOCITY_S / _RASTER_S)), raster)


def _from_the_first_end(x: Vector, tau: Vector, v: Vector) -> tuple[Vector, Vector, Vector]:
    place = (x - x.min()) / max(float(np.ptp(x)), 1e-12)
    begin = int(np.argmax((place < _END) | (place > 1.0 - _END)))
    return x[begin:], tau[begin:], v[begin:]


def _dead_zone(x: Vector, v: Vector, tau: Vector, start: Vector | None = None) -> Vector:
    """alpha, center, stiffness and Coulomb friction, bounded by the range of the data."""
    span, height = float(np.ptp(x)), float(np.ptp(tau))

    def missed(p: Vector) -> Vector:
        return _missed(p, x, v, tau)

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


def _missed(p: Vector, x: Vector, v: Vector, tau: Vector) -> Vector:
    """Torque by alpha, center, stiffness and Coulomb friction p, minus the measured one [Nm]."""
    delta = np.sign(x - p[1]) * _beyond(x, p[1], p[0])
    return np.asarray(p[2] * delta + p[3] * np.tanh(v / _RAMP_WIDTH) - tau)


def _beyond(x: Vector, center: float, alpha: float) -> Vector:
    """Bending of the gear [rad]: distance beyond its border, 0 inside the gap."""
    return np.maximum(np.abs(x - center) - alpha, 0.0)


def _inside(x: Vector, tau: Vector, center: float, alpha: float) -> tuple[float, float]:
    """Slope of the mean torque of both directions, and half their difference, in the inner 60 % of
    the gap; infinite and NaN if it was hardly passed in both. A sharp gap is crossed within few
    instants, so the mean is taken over points at equal distances along the path."""
    steps = np.abs(np.diff(x))
    path = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(0.0, path[-1], float(np.ptp(x)) / _POINTS)
    here = np.clip(np.searchsorted(path, at, side="right") - 1, 0, len(x) - 2)
    upwards = np.diff(x)[here] > 0.0
    x, tau = np.interp(at, path, x), np.interp(at, path, tau)
    edges = np.linspace(center - 0.6 * alpha, center + 0.6 * alpha, 13)
    middle, mean, half = [], [], []
    for a, b in itertools.pairwise(edges):
        inner = (x >= a) & (x < b)
        strokes = [inner & upwards, inner & ~upwards]
        if all(one.any() for one in strokes):
            up, down = (float(tau[one].mean()) for one in strokes)
            middle.append(0.5 * (a + b))
            mean.append(0.5 * (up + down))
            half.append(0.5 * (up - down))
    if len(middle) < _FEWEST_BINS:
        return float("inf"), float("nan")
    return float(np.polyfit(middle, mean, 1)[0]), float(np.median(half))
