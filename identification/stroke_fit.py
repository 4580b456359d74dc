"""Fit of a joint's gap to strokes of its motor:

    phi = q - theta = c + c' t - side alpha - kappa tau       where the gear carries
    tau = tau_M - friction of the rotor as it is inside the gap, in that direction

side is the sign of the torque: +1 if the motor pushes its link up. The bending of the gear, kappa
tau, is separated from the gap by the torque, which rises from zero as the motor runs into a border;
so alpha is that at zero torque. Errors of the motor encoder that repeat with its turn are columns
of the fit if the motor turns far enough to show them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from common.arrays import Matrix, Vector
from identification.bending import STIFFEST, USUAL, USUALLY
from identification.encoder_errors import SHOWN, Harmonic, turns
from identification.gap_result import ENCODERS
from identification.stroke_samples import Samples, free_torque

_BLOCK_S = 0.2  # block of a plateau whose samples count as one
_STEP = 0.3  # of an encoder's resolution, as the error of a mean over a stroke
_LATE_S = 0.002  # delay of the current behind the positions that remains unseen
_PERIOD_S = 0.01  # period of the log up to which sampling adds no error
_UNSURE = 0.1  # error of the bending, as friction is not quite constant


@dataclass(frozen=True, slots=True)
class StrokeFit:
    """alpha by strokes, and the parts of its interval."""

    alpha: float
    compliance: float
    """[rad/Nm]"""
    bent: float
    """bending [rad], as part of the range of phi on either side"""
    error: float
    """standard error of alpha [rad]"""
    scatter: float
    rarer: float
    """share of the border that was met more rarely"""
    harmonics: tuple[Harmonic, ...]
    coulomb: float
    """of the rotor [Nm]"""
    bending_error: float
    """error of the bending [rad], if that friction is unknown, or the torque does not show it"""
    hidden: float
    """[rad]: `_hidden`"""
    noise: float
    """of the torque, over that with which it pushes its link at the weaker border"""

    @property
    def confidence(self) -> float:
        """Half the 95 % interval of alpha [rad]."""
        repeats = sum(harmonic.amplitude for harmonic in self.harmonics)
        seen = float(np.hypot(2.0 * self.error, self.hidden))
        return seen + _UNSURE * (self.bent + repeats) + self.bending_error + ENCODERS


def fitted(
    seen: Samples, drift: float, middle: float, half: float, gear: float, *, integrated: bool
) -> StrokeFit | None:
    """Fit of all strokes, started from drift [rad/s], middle and half of the range of phi [rad];
    None if the gear carried nothing at a border. gear, integrated: as for `from_strokes`."""
    center = middle + drift * seen.time_s
    alpha, fit = half, None
    for _ in range(6):
        free, offset, off = free_torque(seen, seen.phi - center, alpha)
        load = seen.torque - offset - seen.direction * free
        rows = _carried(seen, seen.phi - center, alpha, load, off)
        if rows is None:
            break
        # theta drifts as phi does: the motor's position is related to the middle of the gap.
        rows = replace(rows, theta=rows.theta + np.interp(rows.time_s, seen.time_s, center))
        fit, center = _solved(seen, rows, gear, off, integrated=integrated)
        fit = replace(fit, coulomb=float(np.median(free)))
        if abs(fit.alpha - alpha) < 1e-6:
            break
        alpha = max(fit.alpha, 0.25 * half)
    return fit


@dataclass(frozen=True, slots=True)
class _Carried:
    """Rows in which the gear carried: blocks of plateaus, and samples of the motion into them."""

    time_s: Vector
    phi: Vector
    theta: Vector
    side: Vector
    load: Vector
    """tau [Nm]"""
    stroke: Vector
    direction: Vector
    noise: float
    """of the torque, over its mean at the weaker border; infinite if that has the wrong sign"""


def _carried(seen: Samples, phi: Vector, alpha: float, load: Vector, off: float) -> _Carried | None:
    side = -np.sign(phi)
    outer = np.abs(phi) > 0.5 * alpha
    plateau = seen.late & outer & (np.abs(seen.follows) < 0.25)
    if not plateau.any() or len(np.unique(side[plateau])) < 2:
        return None
    usual = {way: float(np.median((load * side)[plateau & (side == way)])) for way in (-1.0, 1.0)}
    noise = 1.4826 * float(np.median(np.abs(np.diff(seen.torque)))) / np.sqrt(2.0)
    enough = 0.3 * np.where(side > 0.0, usual[1.0], usual[-1.0])
    into = seen.late & ~plateau & outer & (side == seen.direction)
    # A link that falls through its gap seems to load the motor, as far as friction is not known.
    into &= load * side > np.maximum(enough, max(4.0 * noise, off))
    block = np.round(seen.time_s / _BLOCK_S)
    keys = np.where(plateau, block, -1.0 - np.arange(len(phi)))
    rows = plateau | into
    _, of = np.unique(np.stack([keys, side, seen.stroke])[:, rows], axis=1, return_inverse=True)
    count = np.bincount(of.ravel()).astype(np.float64)

    def mean(values: Vector) -> Vector:
        return np.bincount(of.ravel(), weights=values[rows]) / count

    return _Carried(
        time_s=mean(seen.time_s),
        phi=mean(seen.phi),
        theta=mean(seen.theta),
        side=mean(side),
        load=mean(load),
        stroke=np.round(mean(seen.stroke.astype(np.float64))),
        direction=mean(seen.direction),
        noise=noise / weakest if (weakest := min(usual.values()) + off) > 0.0 else float("inf"),
    )


def _solved(
    seen: Samples, rows: _Carried, gear: float, off: float, *, integrated: bool
) -> tuple[StrokeFit, Vector]:
    """Fit, and middle of the gap (N,) over the samples' time.

    off: error of the rotor friction that was subtracted from the load [Nm]. The gear bends by that
    in one direction as the motor goes up, in the other as it goes down; if the motor also lets its
    link down, that can be separated from alpha.
    """
    origin = _origin(rows.time_s, rows.stroke, integrated=integrated)
    repeats = turns(np.zeros_like(rows.theta), rows.theta, gear)
    turned = abs(gear) * float(np.ptp(rows.theta)) / (2.0 * np.pi)
    harmonic = repeats.columns if turned > SHOWN else np.empty((len(rows.theta), 0))
    plain = origin(rows.time_s)
    rubs = rows.direction[:, None] if off > 0.0 else np.empty((len(rows.theta), 0))
    X = np.column_stack([-rows.side, -rows.load, plain, harmonic, rubs])
    # The prior of a gear's compliance decides where the torque shows little.
    weak = 1e-4  # [rad]: scatter of phi that goes with it
    prior = np.zeros((2 if off > 0.0 else 1, X.shape[1]))
    prior[0, 1] = weak / USUALLY
    prior[1:, -1] = weak / (off * USUAL) if off > 0.0 else 0.0
    A = np.vstack([X, prior])
    y = np.concatenate([rows.phi, prior[:, 1] * USUAL])
    solution, *_ = np.linalg.lstsq(A, y, rcond=None)
    if solution[1] < 0.0:
        A[:, 1] = 0.0
        solution, *_ = np.linalg.lstsq(A, y, rcond=None)
    left = rows.phi - X @ solution
    inverse = np.linalg.pinv(A.T @ A)
    places = np.round(rows.theta / max(float(np.ptp(rows.theta)) / 12.0, 1e-9))
    clusters = (rows.stroke, 100.0 * rows.side + places)
    variances = np.max([_sandwich(X, left, of, inverse) for of in clusters], axis=0)
    variance = float(variances[0])
    scatter = float(np.sqrt(np.square(left).mean()))
    # Uncertainty that the prior leaves.
    variance += inverse[0, 0] * weak**2
    load = float(np.median(np.abs(rows.load)))
    upper = float((rows.side > 0.0).mean())
    own = 2 + plain.shape[1]
    of_turn = slice(own, own + harmonic.shape[1])
    fit = StrokeFit(
        alpha=float(solution[0]),
        compliance=float(solution[1]),
        bent=float(solution[1]) * load,
        error=float(np.sqrt(variance)),
        scatter=scatter,
        rarer=min(upper, 1.0 - upper),
        harmonics=repeats.harmonics(solution[of_turn], np.sqrt(variances[of_turn]), harmonic)
        if turned > SHOWN else (),
        coulomb=float("nan"),
        bending_error=USUAL * load if solution[1] < STIFFEST else 0.0,
        hidden=_hidden(seen),
        noise=rows.noise,
    )  # fmt: skip
    center = origin(seen.time_s) @ solution[2:own]
    return fit, center


def _hidden(seen: Samples) -> float:
    """Error of alpha that no sample shows [rad]: the motor moves on between two samples, and
    between the instants of the current and of the samples; and encoders have a resolution."""
    speed = float(np.median(np.abs(np.gradient(seen.theta, seen.time_s))))
    period = float(np.median(np.diff(seen.time_s)))
    # A motor at constant speed has equal steps, too: a resolution shows only if values repeat.
    step = seen.resolution if seen.resolution > 1.5 * speed * period else 0.0
    return speed * (_LATE_S + max(period - _PERIOD_S, 0.0)) + _STEP * step


def _origin(time_s: Vector, stroke: Vector, *, integrated: bool) -> Callable[[Vector], Matrix]:
    """Columns of the middle of phi over time: a constant and a line; for an integrated velocity,
    whose errors add up, a polygon with a corner for every other stroke."""
    count = len(np.unique(stroke)) // 2 + 1
    if not integrated or count < 3:
        return lambda t: np.stack([np.ones_like(t), t - float(time_s.mean())], axis=1)
    knots = np.linspace(float(time_s.min()), float(time_s.max()), count)
    eye = np.eye(len(knots))
    return lambda t: np.stack([np.interp(t, knots, row) for row in eye], axis=1)


def _sandwich(X: Matrix, left: Vector, of: Vector, inverse: Matrix) -> Vector:
    """Variances of the coefficients, with rows correlated within each cluster."""
    names, place = np.unique(of, return_inverse=True)
    sums = np.zeros((len(names), X.shape[1]))
    np.add.at(sums, place.ravel(), left[:, None] * X)
    few = len(names) / max(len(names) - 2.0, 1.0)
    return np.asarray(few * np.diag(inverse @ (sums.T @ sums) @ inverse))
