"""The half-gap and the skew between the encoders, from a motion of motor and link."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from estimator.identification.gap_result import (
    CLEAR,
    CROSSINGS,
    SMALLEST,
    GapResult,
    GapVerdict,
    smoothed,
)

_RARE = 0.03  # share of the time in motion; a border met more rarely is not believed


def from_motion(
    name: str,
    time_s: Vector,
    q: Vector,
    theta: Vector,
    theta_dot: Vector,
    enough: int = CROSSINGS,
) -> GapResult:
    """phi = c + c' t +- alpha - skew * velocity, of the samples at which phi rests; the half-gap
    where there were `enough` crossings."""
    period = float(np.median(np.diff(time_s)))
    phi = q - theta
    speed = smoothed(theta_dot, 3)
    phi_dot = np.gradient(smoothed(phi, 3), time_s)
    moving = np.abs(speed) > 0.1 * np.percentile(np.abs(speed), 95.0)
    rests = moving & (np.abs(phi_dot) < 0.05 * np.percentile(np.abs(speed), 95.0))
    if rests.sum() < 50:
        about = "phi is never at rest while the joint moves"
        return GapResult(joint=name, verdict=GapVerdict.UNCLEAR, reason=about)
    x, t, v = phi[rests], time_s[rests] - time_s.mean(), speed[rests]
    columns = np.stack([np.ones_like(t), t / max(np.ptp(t), 1.0), np.zeros_like(t), -v], axis=1)
    solution = np.array([0.5 * float(np.percentile(x, 1) + np.percentile(x, 99)), 0.0, 0.0, 0.0])
    for _ in range(30):
        without_side = x - columns[:, [0, 1, 3]] @ solution[[0, 1, 3]]
        columns[:, 2] = np.where(without_side > 0.0, 1.0, -1.0)
        before, solution = solution, _robust(columns, x)
        if np.allclose(before, solution, rtol=1e-9, atol=1e-12):
            break
    left = x - columns @ solution
    alpha, skew = abs(float(solution[2])), float(solution[3])
    errors = _block_errors(columns, left, rests, period)
    crossings = int(np.count_nonzero(np.diff(columns[:, 2])))
    scatter = 1.4826 * float(np.median(np.abs(left)))
    rarer = float(min((columns[:, 2] > 0).mean(), (columns[:, 2] < 0).mean()))
    answer = GapResult(
        joint=name,
        verdict=GapVerdict.UNCLEAR,
        reason=f"{crossings} crossings in motion, phi scatters by {1e3 * scatter:.2g} mrad",
        skew_s=skew,
        skew_confidence_s=1.96 * errors[3],
        crossings=crossings,
    )
    if alpha < SMALLEST or rarer < _RARE:
        # A load that never changes its sign keeps the joint at one border.
        about = "only one border was met, or there is no gap: move the link by hand"
        return replace(answer, reason=about)
    if scatter > CLEAR * alpha:
        return answer
    if crossings < enough:
        return replace(answer, verdict=GapVerdict.FEW)
    return replace(answer, verdict=GapVerdict.CLEAR, half_gap=alpha, confidence=1.96 * errors[2])


def _robust(columns: Matrix, x: Vector) -> Vector:
    """Least squares, then once more without what lies far off."""
    solution, *_ = np.linalg.lstsq(columns, x, rcond=None)
    left = np.abs(x - columns @ solution)
    near = left <= 3.0 * 1.4826 * np.median(left) + 1e-12
    solution, *_ = np.linalg.lstsq(columns[near], x[near], rcond=None)
    return np.asarray(solution)


def _block_errors(
    columns: Matrix, left: Vector, rests: NDArray[np.bool_], period: float
) -> list[float]:
    """Standard errors from blocks of half a second, within which samples are alike."""
    block = (np.flatnonzero(rests) * period // 0.5).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    sums = np.add.reduceat(left[:, None] * columns, starts, axis=0)
    inverse = np.linalg.pinv(columns.T @ columns)
    errors: list[float] = np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse)).tolist()
    return errors
