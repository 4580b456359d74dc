"""Half-gap and skew between the encoders, from a motion of motor and link."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from identification.bending import SOFTEST, STIFFEST, USUAL, USUALLY
from identification.encoder_errors import turns
from identification.gap_result import (
    CLEAR,
    CROSSINGS,
    ONE_BORDER,
    SMALLEST,
    GapResult,
    GapVerdict,
    Limit,
    refused,
    smoothed,
)

_RARE = 0.03  # share of the time in motion; a border met more rarely is not trusted
_RESTS = 50  # fewest samples
_ROTORS = 0.75  # rotor's share of all friction, if unknown: half to all
_WIDE = 0.5  # largest half-interval over alpha
_LEAST_TORQUE = 0.01  # [Nm], the least that a gear carries; less is in another unit
_APART, _PLACES = 0.08, 24  # spacing of the places of a map [rad], and their largest number
_LARGEST = 0.015  # largest range of a map [rad]
_UNSURE = 0.1  # error of the bending: friction is not quite constant
_SCATTERED = ("scatter of phi at the borders", "interval of alpha")


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
    """Half-gap from phi = c + c' t +- alpha - skew * velocity - kappa tau + harmonics of both
    encoders, at the samples where phi rests; given only with `enough` crossings.

    If a torque is known, the harmonics become a map over the link's position, and kappa is the
    gear's own as far as phi determines it better than the usual value.

    gear: turns of the motor per turn of the link, 0 if unknown; torque (N,) [Nm] of the motor, by
    which a usual gear bends (kappa tau): without it the bending is taken for gap.
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
    phi = q - theta + USUAL * load
    seen = _Seen(time_s[rests], phi[rests], speed[rests], load[rests], off)
    fit = _fitted(seen, repeats.columns[rests])
    found = replace(
        _judged(name, fit, 2.0 * USUALLY * seen.size + USUAL * off, enough),
        harmonics=repeats.harmonics(fit.solution[4:], fit.errors[4:], repeats.columns[rests]),
    )
    if torque is None or (found.limit is not None and found.limit.name not in _SCATTERED):
        return found
    if found.limit is None and seen.size < _LEAST_TORQUE:
        least = Limit("least torque of a gear over the measured one",
                      _LEAST_TORQUE / max(seen.size, 1e-4), 1.0, "",
                      "it is not this motor's, or has another unit")  # fmt: skip
        return refused(found, GapVerdict.UNCLEAR, [least])
    closer = _mapped(name, seen, q[rests], repeats.columns[rests], enough)
    if found.limit is not None or not closer.usable:
        return closer if found.limit is not None else found
    wider = max(closer.confidence, found.confidence)
    return replace(closer, harmonics=found.harmonics, confidence=wider)


def _load(
    torque: Vector, q: Vector, speed: Vector, rests: NDArray[np.bool_]
) -> tuple[Vector, float]:
    """Torque (N,) [Nm] that the gear carries: the motor's without offset and without its own
    friction; and the error of that."""
    torque, direction = smoothed(torque, 3), np.sign(speed)
    columns = np.stack([np.ones_like(q), direction, speed, q - q.mean()], axis=1)
    found, *_ = np.linalg.lstsq(columns[rests], torque[rests], rcond=None)
    friction = max(float(found[1]), 0.0)
    return torque - _ROTORS * friction * direction, (1.0 - _ROTORS) * friction


@dataclass(frozen=True, slots=True)
class _Seen:
    """Samples at which phi rests in motion, (M,) each; phi without the bending of a usual gear."""

    time_s: Vector
    phi: Vector
    speed: Vector
    load: Vector
    off: float
    """error of the load [Nm]"""

    @property
    def size(self) -> float:
        """Median magnitude of the load [Nm]."""
        return float(np.median(np.abs(self.load)))


@dataclass(frozen=True, slots=True)
class _Fit:
    solution: Vector
    """c, c', alpha, skew, and of further columns"""
    errors: Vector
    """standard errors of these"""
    side: Vector
    """+-1, (M,)"""
    scatter: float
    """at the border where phi scatters more"""


def _mapped(name: str, seen: _Seen, q: Vector, repeats: Matrix, enough: int) -> GapResult:
    """Result with an error map over q (M,), and with the gear's own compliance."""
    count = int(np.clip(round(float(np.ptp(q)) / _APART), 3, _PLACES))
    places = np.linspace(q.min(), q.max(), count)
    hats = [np.interp(q, places, row) for row in np.eye(count)[1:]]
    columns = np.column_stack([*hats, repeats])
    free = _fitted(seen, np.column_stack([columns, seen.load]))
    error = float(free.errors[-1])
    believed = USUALLY**2 / (USUALLY**2 + error**2)
    shown = believed * float(free.solution[-1])
    more = float(np.clip(shown, STIFFEST - USUAL, SOFTEST - USUAL))
    fit = _fitted(replace(seen, phi=seen.phi - more * seen.load), columns)
    unsure = 2.0 * np.sqrt(believed) * error + abs(shown - more) + _UNSURE * (USUAL + more)
    unseen = float(unsure) * seen.size + 2.0 * (USUAL + more) * seen.off
    found = _judged(name, fit, unseen, enough, _WIDE)
    size = float(np.ptp(columns @ fit.solution[4:]))
    found = replace(found, reason=f"{found.reason}; without errors of {1e3 * size:.2g} mrad that "
                    "repeat with the position")  # fmt: skip
    too_large = "too large for encoders: measure the gap by hand"
    map_ = Limit("these errors", 1e3 * size, 1e3 * _LARGEST, "mrad", too_large)
    return refused(found, GapVerdict.UNCLEAR, [map_]) if found.limit is None else found


def _fitted(seen: _Seen, further: Matrix) -> _Fit:
    x, t = seen.phi, seen.time_s - seen.time_s.mean()
    plain = [np.ones_like(t), t / max(np.ptp(t), 1.0), np.zeros_like(t), -seen.speed]
    columns = np.column_stack([*plain, further])
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
    errors, side = _block_errors(columns, left, seen.time_s), columns[:, 2]
    scatters = [1.4826 * float(np.median(np.abs(left[side == one]))) for one in set(side)]
    return _Fit(solution, errors, side, max(scatters))


def _judged(name: str, fit: _Fit, unseen: float, enough: int, most: float = CLEAR) -> GapResult:
    """Result of a fit; unseen: unknown bending of the gear [rad]; most: largest scatter over
    alpha."""
    alpha = abs(float(fit.solution[2]))
    crossings = int(np.count_nonzero(np.diff(fit.side)))
    found = GapResult(
        joint=name,
        verdict=GapVerdict.CLEAR,
        reason=f"{crossings} crossings in motion, phi scatters by {1e3 * fit.scatter:.2g} mrad",
        half_gap=alpha,
        # A link that bounces rests inside its gap, never beyond: scatter is no mere noise.
        confidence=1.96 * float(fit.errors[2]) + fit.scatter + unseen,
        skew_s=float(fit.solution[3]),
        crossings=crossings,
    )
    # A load that never changes its sign keeps the joint at one border.
    rarer = float(min((fit.side > 0).mean(), (fit.side < 0).mean()))
    limits = [
        Limit("share of the time at the more frequent border", 1.0 - rarer, 1.0 - _RARE, "",
              ONE_BORDER),
        Limit("smallest gap that shows over alpha", SMALLEST / max(alpha, 1e-9), 1.0, "",
              ONE_BORDER),
        Limit(_SCATTERED[0], 1e3 * fit.scatter, 1e3 * most * alpha, "mrad",
              "an elastic gear, or encoders with errors that repeat otherwise than 1 or 2 x per "
              "turn"),
        Limit(_SCATTERED[1], 1e3 * found.confidence, 1e3 * _WIDE * alpha, "mrad",
              "gears bend as much as this gap, or the current has another unit: measure by hand"),
    ]  # fmt: skip
    found = refused(found, GapVerdict.UNCLEAR, limits)
    few = Limit("crossings still missing", float(enough - crossings), 0.0, "", "move it longer")
    return refused(found, GapVerdict.FEW, [few]) if found.limit is None else found


def _robust(columns: Matrix, x: Vector) -> Vector:
    """Least squares, then once more without outliers."""
    solution, *_ = np.linalg.lstsq(columns, x, rcond=None)
    left = np.abs(x - columns @ solution)
    near = left <= 3.0 * 1.4826 * np.median(left) + 1e-12
    solution, *_ = np.linalg.lstsq(columns[near], x[near], rcond=None)
    return np.asarray(solution)


def _block_errors(columns: Matrix, left: Vector, time_s: Vector) -> Vector:
    """Standard errors from blocks of half a second, within which samples are correlated."""
    starts = np.flatnonzero(np.diff((time_s - time_s[0]) // 0.5, prepend=-1.0))
    sums = np.add.reduceat(left[:, None] * columns, starts, axis=0)
    inverse = np.linalg.pinv(columns.T @ columns)
    return np.asarray(np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse)))
