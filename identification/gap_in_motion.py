"""The half-gap and the skew between the encoders, from a motion of motor and link."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from identification.bending import USUAL, USUALLY
from identification.encoder_errors import Harmonic, Turns, turns
from identification.gap_result import (
    CLEAR,
    CROSSINGS,
    SMALLEST,
    GapResult,
    GapVerdict,
    Limit,
    refused,
    smoothed,
)

_RARE = 0.03  # share of the time in motion; a border met more rarely is not believed
_RESTS = 50  # fewest samples
_ROTORS = 0.75  # of all friction, where nothing is known: half of it or all
_WIDE = 0.5  # half the interval over alpha, at most


def from_motion(
    name: str,
    time_s: Vector,
    q: Vector,
    theta: Vector,
    theta_dot: Vector,
    enough: int = CROSSINGS,
    gear: float = 0.0,
    torque: Vector | None = None,
) -> GapResult:
    """phi = c + c' t +- alpha - skew * velocity - kappa tau + what repeats with a turn of either
    encoder, of the samples at which phi rests; the half-gap where there were `enough` crossings.

    gear: turns of the motor for one of the link, 0 where it is not known; torque (N,) [Nm] of the
    motor, by which a usual gear bends (kappa tau): without it that is taken for gap.
    """
    speed = smoothed(theta_dot, 3)
    fast = float(np.percentile(np.abs(speed), 95.0))
    moving = np.abs(speed) > 0.1 * fast
    repeats = turns(q, theta, gear)
    phi_dot = np.gradient(smoothed(q - theta, 3), time_s)
    rests = moving & (np.abs(phi_dot) < 0.05 * fast)
    if rests.sum() < _RESTS:
        about = "phi is never at rest while the joint moves"
        return GapResult(joint=name, verdict=GapVerdict.UNCLEAR, reason=about)
    load, off = (np.zeros_like(q), 0.0) if torque is None else _load(torque, q, speed, rests)
    fit = _fitted(time_s, q - theta + USUAL * load, speed, repeats, rests)
    unseen = 2.0 * USUALLY * float(np.median(np.abs(load[rests]))) + USUAL * off
    return _judged(name, fit, unseen, enough)


def _load(
    torque: Vector, q: Vector, speed: Vector, rests: NDArray[np.bool_]
) -> tuple[Vector, float]:
    """Torque (N,) [Nm] that the gear carries, the motor's without an offset and without its own
    friction, and how far that may be off."""
    torque, way = smoothed(torque, 3), np.sign(speed)
    columns = np.stack([np.ones_like(q), way, speed, q - q.mean()], axis=1)
    found, *_ = np.linalg.lstsq(columns[rests], torque[rests], rcond=None)
    friction = max(float(found[1]), 0.0)
    return torque - _ROTORS * friction * way, (1.0 - _ROTORS) * friction


@dataclass(frozen=True, slots=True)
class _Fit:
    alpha: float
    skew: float
    errors: Vector
    """standard errors of c, c', alpha and skew"""
    harmonics: tuple[Harmonic, ...]
    side: Vector
    """+-1, (M,)"""
    scatter: float


def _fitted(
    time_s: Vector, phi: Vector, speed: Vector, repeats: Turns, rests: NDArray[np.bool_]
) -> _Fit:
    x, t, v = phi[rests], time_s[rests] - time_s.mean(), speed[rests]
    plain = [np.ones_like(t), t / max(np.ptp(t), 1.0), np.zeros_like(t), -v]
    columns = np.column_stack([*plain, repeats.columns[rests]])
    others = [k for k in range(columns.shape[1]) if k != 2]
    solution = np.zeros(columns.shape[1])
    solution[0] = 0.5 * float(np.percentile(x, 1) + np.percentile(x, 99))
    for _ in range(30):
        without_side = x - columns[:, others] @ solution[others]
        columns[:, 2] = np.where(without_side > 0.0, 1.0, -1.0)
        before, solution = solution, _robust(columns, x)
        if np.allclose(before, solution, rtol=1e-9, atol=1e-12):
            break
    left = x - columns @ solution
    period = float(np.median(np.diff(time_s)))
    errors = _block_errors(columns, left, rests, period)
    return _Fit(
        alpha=abs(float(solution[2])),
        skew=float(solution[3]),
        errors=errors,
        harmonics=repeats.harmonics(solution[4:], errors[4:], columns[:, 4:]),
        side=columns[:, 2],
        scatter=1.4826 * float(np.median(np.abs(left))),
    )


def _judged(name: str, fit: _Fit, unseen: float, enough: int) -> GapResult:
    """Result of a fit; unseen: what the gear may have bent otherwise [rad]."""
    crossings = int(np.count_nonzero(np.diff(fit.side)))
    found = GapResult(
        joint=name,
        verdict=GapVerdict.CLEAR,
        reason=f"{crossings} crossings in motion, phi scatters by {1e3 * fit.scatter:.2g} mrad",
        half_gap=fit.alpha,
        # A link that bounces rests inside its gap, never beyond: scatter is no mere noise.
        confidence=1.96 * float(fit.errors[2]) + fit.scatter + unseen,
        skew_s=fit.skew,
        crossings=crossings,
        harmonics=fit.harmonics,
    )
    # A load that never changes its sign keeps the joint at one border.
    rarer = float(min((fit.side > 0).mean(), (fit.side < 0).mean()))
    one_border = "only one border was met, or there is no gap: move the link by hand"
    limits = [
        Limit("share of the time at the more frequent border", 1.0 - rarer, 1.0 - _RARE, "",
              one_border),
        Limit("smallest gap that shows over alpha", SMALLEST / max(fit.alpha, 1e-9), 1.0, "",
              one_border),
        Limit("scatter of phi at the borders", 1e3 * fit.scatter, 1e3 * CLEAR * fit.alpha, "mrad",
              "an elastic gear, or encoders with errors that repeat otherwise than 1 or 2 x per "
              "turn"),
        Limit("interval of alpha", 1e3 * found.confidence, 1e3 * _WIDE * fit.alpha, "mrad",
              "gears bend by as much as this gap, or the current has another unit: by hand"),
    ]  # fmt: skip
    found = refused(found, GapVerdict.UNCLEAR, limits)
    few = Limit("crossings still missing", float(enough - crossings), 0.0, "", "move it longer")
    return refused(found, GapVerdict.FEW, [few]) if found.limit is None else found


def _robust(columns: Matrix, x: Vector) -> Vector:
    """Least squares, then once more without what lies far off."""
    solution, *_ = np.linalg.lstsq(columns, x, rcond=None)
    left = np.abs(x - columns @ solution)
    near = left <= 3.0 * 1.4826 * np.median(left) + 1e-12
    solution, *_ = np.linalg.lstsq(columns[near], x[near], rcond=None)
    return np.asarray(solution)


def _block_errors(columns: Matrix, left: Vector, rests: NDArray[np.bool_], period: float) -> Vector:
    """Standard errors from blocks of half a second, within which samples are alike."""
    block = (np.flatnonzero(rests) * period // 0.5).astype(np.int64)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    sums = np.add.reduceat(left[:, None] * columns, starts, axis=0)
    inverse = np.linalg.pinv(columns.T @ columns)
    return np.asarray(np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse)))
