"""Rotor inertias for drives that step: mean current of whole periods, by the velocity loop in the
log.

A drive that takes a setpoint u as a step applies the current of an acceleration at once, and much
of it is over when it is sampled. How much, its own loop shows: of the velocity error e = u - v,

    current = k_p e + k_i integral(e) dt                     (fitted, with the current's filter)
    e(t) = e_1 + (e_0 - e_1) (exp(-w t) - E) / (1 - E),      E = exp(-w T), w = K_c k_p / (B + M)

falls in a period T from e_0, just after the step, to e_1 at the sample. The excess of its mean over
the sample is added, and B fitted again. To its motor a link, behind gap and gear, appears as about
half its inertia: half of the increase of B is its standard error.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from common.arrays import Matrix, Vector
from estimator.link_velocity import SAMPLES
from identification.log_intervals import Intervals
from identification.motion_log import SHORTEST, MotionLog

LEAST_R2 = 0.9
"""Share of a current's variance that its loop must explain."""
_LATER = 2  # samples from the tick of a setpoint to the end of the period in which it acts
_SLOW_S = 3.0  # slower changes are not compared: positions drift
_SEEN = 0.5  # share of a link's inertia that moves with its rotor within a period
_ROUNDS = 3
_SLOWEST, _FASTEST = 5.0, 1000.0  # w [rad/s]


def rotors_of_whole_periods(
    log: MotionLog,
    rows: Intervals,
    fitted: Vector,
    links: Vector,
    torque_constant: Vector,
    delay_s: float,
    refit: Callable[[Intervals], Vector],
) -> Vector:
    """Rotor inertias (n,) [kg m2]; NaN if the current does not follow such a loop.

    fitted: by the sampled current; links: inertias of the links about the joints (n,) [kg m2];
    delay_s: of the drives' current filter; refit: B (n,) of other intervals.
    """
    rotors = fitted
    for _ in range(_ROUNDS):
        inertia = np.maximum(rotors, 0.0) + _SEEN * links
        more, r2 = _missed(log, torque_constant / inertia, delay_s)
        rotors = refit(replace(rows, current=rows.current + more))
    return np.where(r2 >= LEAST_R2, rotors, np.nan)


def _missed(log: MotionLog, per_current: Vector, delay_s: float) -> tuple[Matrix, Vector]:
    """Mean current of each interval (N, n) beyond the sampled one [A], and the least R2 of each
    joint's loop over the stretches of the log."""
    parts, r2 = [], np.ones(log.n)
    for rows in log.stretches():
        if rows.stop - rows.start < SHORTEST:
            continue
        part = np.zeros((rows.stop - rows.start, log.n))
        for i in range(log.n):
            part[_LATER:, i], fits = _of_joint(log.select(rows), i, float(per_current[i]), delay_s)
            r2[i] = min(r2[i], fits)
        parts.append(part[SAMPLES:])
    return np.concatenate(parts), r2


def _of_joint(log: MotionLog, i: int, per_current: float, delay_s: float) -> tuple[Vector, float]:
    assert log.setpoint is not None
    period, v, u = log.period_s, log.motor_velocity[:, i], log.setpoint[:-_LATER, i]
    turned = np.cumsum(0.5 * (v + np.concatenate([v[:1], v[:-1]]))) * period
    if log.motor_position is not None:
        turned = log.motor_position[:, i]
    e_0, e_1 = u - v[_LATER - 1 : -1], u - v[_LATER:]
    integral = np.cumsum(u) * period - turned[_LATER:]
    measured = _quick(log.current[_LATER:, i], period)
    w, added, r2 = 100.0, np.zeros_like(u), 0.0
    for _ in range(_ROUNDS):
        mean, seen = _shares(w, period, delay_s)
        A = np.column_stack([_quick(e_1 + seen * (e_0 - e_1), period), _quick(integral, period)])
        gains = np.linalg.lstsq(A, measured, rcond=None)[0]
        left, total = float(np.var(measured - A @ gains)), float(np.var(measured))
        r2 = 1.0 - left / max(total, 1e-12)
        added = gains[0] * (mean - seen) * (e_0 - e_1)
        w = float(np.clip(gains[0] * per_current, _SLOWEST, _FASTEST))
    return added, r2


def _shares(w: float, period: float, delay_s: float) -> tuple[float, float]:
    """Mean over a period of an error that falls from 1 to 0 by exp(-w t), and its value at the end
    behind a current filter."""
    x, end = w * period, np.exp(-w * period)
    mean = 1.0 / x - end / (1.0 - end)
    if delay_s <= 0.0:
        return mean, 0.0
    t = np.linspace(0.0, period, 201)
    weight = np.exp((t - period) / delay_s) / delay_s
    falls = (np.exp(-w * t) - end) / (1.0 - end)
    return mean, float(np.trapezoid(falls * weight, t)) * (1.0 + np.exp(-period / delay_s))


def _quick(x: Vector, period: float) -> Vector:
    return np.asarray(x - uniform_filter1d(x, round(_SLOW_S / period)))
