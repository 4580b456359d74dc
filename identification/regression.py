"""Columns, weights and bounded least squares of one joint's friction, (8) to (11)."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from common.arrays import Matrix, Vector
from estimator.link_velocity import SAMPLES
from estimator.transmission import Transmission, coulomb_viscous, penetration, resting, smooth_sign
from identification.log_intervals import Intervals, Located, Mask, around, low_pass, memory
from identification.sticking import sticking_share
from identification.touches import touches

GAIN = 25.0
"""K_r [1/s]. The paper's 100 passes so much noise of theta_ddot that the inertia of a light rotor
comes out 15 to 30 % low; with 8, gravity and acceleration cannot be separated any more."""
NORMAL_95 = 1.96
"""Standard errors in half of a 95 % interval."""
HELD_OUT = 0.3
"""Share of the motion, at its end, on which R2 is measured with coefficients fitted to the rest.
The coefficients returned are fitted to all of it."""
LASTS_S = 0.3
"""Averaging time for R2: masses, springs and hoses act as long as the motion lasts, while noise,
and a gap that no encoder shows, average out."""
BLOCK_S = 1.0
IMPACT_S = 0.05
"""Time before and after rotor and link meet, or part, that does not count: they bounce faster than
drives sample, and the rotor of a light joint would come out 6 % too small."""

COLUMNS = (
    *("K_theta_s", "K_theta_v", "B"),
    *("K_q_s", "K_q_v", "K_phi_s", "K_phi_v"),
    *("K_phi_p", "K_phi_d"),
    "K_load",
)
_ENGAGED, _LINK, _RELATIVE, _SPRING = slice(0, 3), slice(3, 5), slice(5, 7), slice(7, 9)
LOAD = slice(9, 10)
LOAD_SURE = 0.03
"""Standard error of load friction above which it counts as unknown."""
_LOADED = 0.1  # of Coulomb friction: a smaller variation of gravity does not show load friction
_SLOW = 0.1  # [rad/s] up to which friction may be more than Coulomb's, as Stribeck's is
_OFFSET = 1  # column of the nuisance
_WORTH = 0.005  # gain of held-out R2 for which a doubtful pair of columns is used
_LEAVES = 0.95  # factor on what is not explained there, for which load friction is used
_APART = 10.0  # condition number up to which the gap separates the two link frictions
_REWEIGHTED = 20
_GAP_SHARE = 0.02  # least share of the time in the gap that shows anything


@dataclass(frozen=True, slots=True)
class Regression:
    """Measurements and columns of the least squares, all filtered alike: r_nl (N, n) [Nm], columns
    (N, n, 10), nuisance columns (N, n, 3), friction of slow motion (N, n), and accelerations that
    drives were asked for (N, n) [rad/s2]."""

    r_nl: Matrix
    columns: Matrix
    nuisance: Matrix
    slow: Matrix
    asked: Matrix


@dataclass(frozen=True, slots=True)
class Solution:
    """Fit of one joint, by `COLUMNS`; unused columns are zero with an error of NaN."""

    coefficients: Vector
    errors: Vector
    r2: float
    condition: float
    """Condition number of the three columns that count while engaged"""
    gravity: float
    """Share of the model's gravity in the motor's torque, by its constant: 1 if they agree"""
    offset: float
    """Constant torque [Nm] in the current that nothing explains"""
    touched: Mask
    """(N,) True where something other than friction acted"""
    stiction: float
    """Share of the Coulomb friction that sticks, and its standard error"""
    stiction_error: float
    falls: Vector
    """Change of the coefficients beside friction that falls with speed"""
    load_bound: float
    """Upper end of the 95 % interval of load friction, used or not"""
    left: Vector
    """(N,) [Nm] that this friction does not explain, and the weight of each row, (N,)"""
    weight: Vector


def regression(
    rows: Intervals, t: Transmission, where: Located, held: Matrix, gain: float = GAIN
) -> Regression:
    """(8)-(10) as corrected in docs/estimator.md: friction columns carry a minus, springs start at
    the border, and every column passes the filter of r_nl. Beyond the paper, Coulomb friction grows
    with the torque that the gear transmits to the link.

    held (N, n): z - s(theta_dot) of `sticking.held`. The nuisance columns absorb errors of masses,
    an offset of the current, and stiction, so that friction and rotor do not: a share of gravity,
    as far as the motor carries it, a constant, and what is held after a reversal.
    """
    phi, apart = where.phi, where.gap.astype(np.float64)
    together = 1.0 - apart

    def sign(v: Matrix) -> Matrix:
        return smooth_sign(v, t.sign_width)

    phi_dot = rows.q_dot - rows.theta_dot
    rubs = coulomb_viscous(t.link_coulomb, t.link_viscous, rows.q_dot, t.sign_width)
    transmitted = low_pass(rows.inertial + rubs, rows, gain)
    columns = [
        *(-sign(rows.theta_dot) * together, -rows.theta_dot * together),
        -rows.theta_ddot * together,
        *(-sign(rows.q_dot) * apart, -rows.q_dot * apart),
        *(-sign(phi_dot) * apart, -phi_dot * apart),
        *(penetration(phi, t.half_gap) * together, phi_dot * together),
        -np.abs(transmitted) * sign(rows.theta_dot) * together,
    ]
    slow = sign(rows.theta_dot) * np.exp(-np.square(rows.theta_dot / _SLOW))
    r_nl = rows.inertial - t.torque_constant * rows.current * together
    nuisance = np.stack([rows.gravity * together, -together, -held * together], axis=2)
    return Regression(
        low_pass(r_nl, rows, gain),
        low_pass(np.stack(columns, axis=2), rows, gain),
        low_pass(nuisance, rows, gain),
        low_pass(slow * together, rows, gain),
        low_pass(rows.asked * together, rows, gain),
    )


def solve_joint(
    i: int,
    found: Regression,
    rows: Intervals,
    half_gap: float,
    where: Located,
    cut: Mask,
    spoilt: Mask,
    unknown: Matrix,
) -> Solution:
    """Coefficients of joint i. cut (N, n): samples whose current was at its limit; spoilt (N,):
    those near a touch, which are not fitted; unknown (N, n): uncertainty of what is held near rest,
    0 to 1.

    Columns of the gap are used if the joint was in its gap; those of K_phi, the spring and load
    only if they improve the fit on held-out motion, that of load only if its share is sure, too.
    """
    y, A, N = found.r_nl[:, i], found.columns[:, i], found.nuisance[:, i]
    gap = where.gap[:, i]
    clean = weights_of(rows, i, where, cut[:, i], resting(rows.theta_dot[:, i]))
    weight = clean * ~spoilt
    train = np.arange(len(y)) < (1.0 - HELD_OUT) * len(y)
    used = np.zeros(len(COLUMNS), dtype=np.bool_)
    used[_ENGAGED] = True
    candidates = []
    if float(weight @ gap) > _GAP_SHARE * weight.sum() > 0.0:
        used[_LINK] = _condition(A[:, _LINK], weight) < _APART
        candidates.append(_RELATIVE)
    if half_gap > 0.0:
        candidates.append(_SPRING)
    r2 = _held_out(A, N, y, weight, used, train)
    # A gear bends in proportion to gravity: its spring would stand in for a wrong torque constant.
    _, beside = _lsq(A, N, y, weight, used)
    for pair in candidates:
        more = used.copy()
        more[pair] = True
        if (better := _held_out(A, N, y, weight, more, train)) > r2 + _WORTH:
            used, r2 = more, better
    more = used.copy()
    more[LOAD] = True
    # Load friction is small, and shows in what the other columns leave, where a gear that differs
    # between driving and being driven leaves a share of gravity.
    without, left_over = (
        1.0 - _held_out(A, N, y, weight, which, train, gravity=True) for which in (used, more)
    )
    used = more if left_over < _LEAVES * without else used
    r2 = _held_out(A, N, y, weight, used, train, mean=max(1, round(LASTS_S / rows.period_s)))
    coefficients, errors, condition = solve(A, N, y, weight, more, rows.time_s)
    load_bound = float(coefficients[-1] + NORMAL_95 * errors[-1])
    loaded = rows.gravity[:, i].std() > _LOADED * coefficients[0]
    if not (used[LOAD] and loaded and errors[LOAD] < LOAD_SURE):
        used[LOAD] = False
        coefficients, errors, condition = solve(A, N, y, weight, used, rows.time_s)
    falling, _ = _lsq(A, np.column_stack([N, found.slow[:, i]]), y, weight, used)
    left = _unexplained(A, N, y, weight, used)
    touched = touches(rows, left, clean, float(coefficients[0]))
    # Fitted again with the rows near rest, which were left out so far.
    _, nuisance = _lsq(A, N, y, weight, used)
    stiction, stiction_error = sticking_share(
        y - A @ coefficients - N[:, :2] @ nuisance[:2],
        coefficients[0] * N[:, 2],
        weights_of(rows, i, where, cut[:, i], unknown[:, i]) * ~spoilt,
        rows.time_s,
    )
    return Solution(
        coefficients=coefficients, errors=errors, r2=r2, condition=condition,
        gravity=1.0 - float(beside[0]), offset=float(beside[_OFFSET]), touched=touched,
        stiction=stiction, stiction_error=stiction_error, load_bound=load_bound,
        falls=np.abs(falling - coefficients), left=left, weight=weight,
    )  # fmt: skip


def weights_of(rows: Intervals, i: int, where: Located, cut: Mask, rest: Vector) -> Vector:
    """Weight of each row (N,), 0 to 1: reduced by `rest` (N,), where Coulomb friction may have any
    value; 0 around a meeting of rotor and link, while the current is at its limit, and while the
    filter remembers any of these."""
    gap = where.gap[:, i]
    met = where.unclear[:, i] | np.diff(gap, prepend=gap[0])
    # The link's velocity is a difference of positions: over its span it spreads an impact, compared
    # with which friction in the gap is negligible.
    spread = around(rows, met, (SAMPLES - 1) * rows.period_s)
    shaken = around(rows, met, IMPACT_S) & ~gap
    doubt = np.maximum(rest, spread | shaken | cut | rows.first)
    # doubt[k] = max(doubt[k], memory * doubt[k - 1]), in logarithms.
    forgotten = np.log(max(memory(rows, GAIN), 1e-3)) * np.arange(len(doubt))
    with np.errstate(divide="ignore"):
        doubt = np.exp(np.maximum.accumulate(np.log(doubt) - forgotten) + forgotten)
    return np.asarray(1.0 - doubt)


def _lsq(A: Matrix, N: Matrix, y: Vector, weight: Vector, used: Mask) -> tuple[Vector, Vector]:
    """Bounded least squares: coefficients of A (10, unused ones 0, used ones >= 0), and of N."""
    X = np.hstack([A[:, used], N]) * weight[:, None]
    scale = np.sqrt(np.square(X).mean(axis=0))
    scale[scale < 1e-12] = np.inf
    lower = np.where(np.arange(X.shape[1]) < used.sum(), 0.0, -np.inf)
    # Reduced to as many rows as columns: X = Q R, R from the eigenvectors of X^T X.
    values, vectors = np.linalg.eigh((X / scale).T @ (X / scale))
    kept = values > 1e-12 * values[-1]
    R = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    b = vectors[:, kept].T @ ((X / scale).T @ (y * weight)) / np.sqrt(values[kept])
    with np.errstate(invalid="ignore"):  # a joint that stood has columns of about 0
        solution = lsq_linear(R, b, (lower, np.inf)).x / scale
    full = np.zeros(A.shape[1])
    full[used] = solution[: used.sum()]
    return full, solution[used.sum() :]


def _unexplained(A: Matrix, N: Matrix, y: Vector, weight: Vector, used: Mask) -> Vector:
    """Remainder of y after a fit of least absolute deviations (by reweighting): unlike that of
    least squares it does not bend towards a touch, which would then hide."""
    smallest = 1e-3 * float(np.abs(y).max()) + 1e-12
    left, steep = y, np.ones_like(y)
    for _ in range(_REWEIGHTED):
        coefficients, nuisance = _lsq(A, N, y, weight * steep, used)
        left = y - A @ coefficients - N @ nuisance
        steep = 1.0 / np.sqrt(np.maximum(np.abs(left), smallest))
    return left


def _held_out(
    A: Matrix, N: Matrix, y: Vector, weight: Vector, used: Mask, train: Mask, *,
    gravity: bool = False, mean: int = 1,
) -> float:  # fmt: skip
    """R2 of the friction alone, (14), on held-out rows averaged over `mean`; an offset of the
    current does not count against it, nor, with `gravity`, a share of gravity."""
    w2, rest = np.square(weight[~train]), y[~train]
    if w2.sum() < 10.0 or weight[train].sum() < 10.0:
        return float("-inf")
    solution, nuisance = _lsq(A[train], N[train], y[train], weight[train], used)
    beside = slice(0 if gravity else _OFFSET, _OFFSET + 1)
    explained = A[~train] @ solution + N[~train, beside] @ nuisance[beside]
    count = np.maximum(np.convolve(w2, np.ones(mean), "same"), 1e-12)
    spread, missed = (
        float(w2 @ np.square(np.convolve(w2 * x, np.ones(mean), "same") / count))
        for x in (rest - np.average(rest, weights=w2), rest - explained)
    )
    return 1.0 - missed / spread if spread > 0.0 else float("-inf")


def solve(
    A: Matrix, N: Matrix, y: Vector, weight: Vector, used: Mask, time_s: Vector
) -> tuple[Vector, Vector, float]:
    """Coefficients (10,), their standard errors, NaN for unused columns, and the condition number
    while engaged, from the whole motion."""
    errors = np.full(A.shape[1], np.nan)
    X = np.hstack([A[:, used], N]) * weight[:, None]
    scale = np.sqrt(np.square(X).mean(axis=0))
    seen = scale > 1e-12
    count = int(used.sum())
    if weight.sum() < 50.0 or not seen[:count].all():
        return np.zeros(A.shape[1]), errors, float("inf")
    coefficients, _ = _lsq(A, N, y, weight, used)
    X = X[:, seen] / scale[seen]
    # Residuals are correlated over time: standard errors are from blocks (sandwich estimator).
    inverse = np.linalg.pinv(X.T @ X)
    left = (y * weight - X @ (inverse @ (X.T @ (y * weight))))[:, None] * X
    block = (time_s // BLOCK_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    sums = np.add.reduceat(left, starts, axis=0)
    variance = np.diag(inverse @ (sums.T @ sums) @ inverse)
    errors[used] = np.sqrt(variance[:count]) / scale[:count]
    return coefficients, errors, _condition(A[:, _ENGAGED], weight)


def _condition(A: Matrix, weight: Vector) -> float:
    """Condition number of the weighted columns, each scaled to the same size."""
    X = A * weight[:, None]
    scale = np.sqrt(np.square(X).mean(axis=0))
    return float(np.linalg.cond(X / scale)) if (scale > 1e-12).all() else float("inf")
