"""The half-gap alpha of one joint, from whichever side of its gear moves.

- The motor stands, a person moves the link: phi rests at one border, then at the other
  (`from_plateaus`, the paper's V-A).
- The link is clamped, the motor pushes with slow ramps of torque: the dead zone of torque over phi
  (`from_ramps`).
- Both move: phi rests at either border, and runs ahead with speed if one encoder is late
  (`from_motion`), which is where the skew between the encoders shows.
"""

import itertools
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from estimator.identification.log import MotionLog
from estimator.types import Matrix, Vector

SMALLEST = 0.001
"""A half-gap below this [rad] is none: encoders and the gear's own bending are of that size."""
CROSSINGS = 15
"""Differences between plateaus below which no figure is given."""
_CLEAR = 0.15  # of alpha: scatter of the plateaus beyond which they are no borders
_FLAT = 0.15  # of the outer stiffness: slope inside a clear dead zone
_SHAKEN = 0.05  # [rad]: a motor that was to stand is pushed about by less
_RARE = 0.03  # share of the time in motion; a border met more rarely is not believed
_CREEP = 0.01  # [rad/s] that no bias of a velocity explains


class GapVerdict(StrEnum):
    """What a log says about a joint's gap; only `clear` and `none` come with a half-gap to use."""

    CLEAR = "clear"
    NONE = "no dead zone"
    UNCLEAR = "no clear dead zone"
    FEW = "too few crossings"
    MOTOR_MOVED = "the motor moved"
    NO_LINK_ENCODER = "no link encoder"
    NO_MOTION = "nothing moved"


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """Answer for one joint. half_gap is NaN unless the verdict is `clear`; it is 0 for `none`."""

    joint: str
    verdict: GapVerdict
    reason: str
    """In words, with the figures."""
    half_gap: float = float("nan")
    """alpha [rad]"""
    confidence: float = float("nan")
    """Half width of the 95 % interval of alpha [rad]"""
    crossings: int = 0
    skew_s: float = float("nan")
    """The link encoder is later than the motor's by this [s]; NaN where it does not show"""
    skew_confidence_s: float = float("nan")
    coulomb: float = float("nan")
    """Friction inside the gap [Nm], from ramps only"""
    stiffness: float = float("nan")
    """Of the border [Nm/rad], from ramps only"""

    @property
    def usable(self) -> bool:
        """Whether `half_gap` may go into a configuration."""
        return self.verdict in (GapVerdict.CLEAR, GapVerdict.NONE)


def identify_gap(log: MotionLog, joint: int, torque_constant: float) -> Gap:
    """By the method that fits what moved in the log."""
    q, theta = log.link_position[:, joint], _theta(log, joint)
    moved_q, moved_theta = _range(q), _range(theta)
    name = log.joints[joint]
    if max(moved_q, moved_theta) < SMALLEST:
        about = f"link and motor stayed within {1e3 * max(moved_q, moved_theta):.2g} mrad"
        return Gap(joint=name, verdict=GapVerdict.NO_MOTION, reason=about)
    if log.motor_position is not None and float(np.ptp(q - theta)) < 1e-5 * moved_q:
        about = "link and motor position are the same signal"
        return Gap(joint=name, verdict=GapVerdict.NO_LINK_ENCODER, reason=about)
    if moved_q < 0.05 * moved_theta:
        torque = torque_constant * log.current[:, joint]
        return from_ramps(name, log.time_s, q - theta, torque)
    between = _range(q - theta)
    if moved_theta > _SHAKEN and moved_theta > 3.0 * between:
        return from_motion(name, log.time_s, q, theta, log.motor_velocity[:, joint])
    if moved_theta > 0.6 * between > 1.2 * SMALLEST:
        about = f"by {1e3 * moved_theta:.3g} mrad, the link against it by {1e3 * between:.3g} mrad"
        return Gap(joint=name, verdict=GapVerdict.MOTOR_MOVED, reason=about)
    return from_plateaus(name, log.time_s, q, theta, float(log.motor_velocity[:, joint].mean()))


def _theta(log: MotionLog, joint: int) -> Vector:
    """Measured, or integrated; with the mean velocity taken out where the motor was to stand, for
    an uncalibrated bias adds 15 mrad in 40 s."""
    if log.motor_position is not None:
        return log.motor_position[:, joint]
    velocity = log.motor_velocity[:, joint]
    steps = np.diff(log.time_s, prepend=log.time_s[0])
    middle = 0.5 * (velocity + np.concatenate([velocity[:1], velocity[:-1]]))
    theta: Vector = np.cumsum(middle * steps)
    without_mean = theta - velocity.mean() * (log.time_s - log.time_s[0])
    return without_mean if _range(without_mean) < _SHAKEN else theta


def _range(values: Vector) -> float:
    low, high = np.percentile(values, [1.0, 99.0])
    return float(high - low)


# --- the motor stands -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Plateaus:
    """Where phi rested, in the order of time; `upper` says at which border."""

    time_s: Vector
    level: Vector
    upper: NDArray[np.bool_]


def find_plateaus(time_s: Vector, q: Vector, phi: Vector) -> Plateaus:
    """Rests of the link at either end of phi's range, one for each visit."""
    period = float(np.median(np.diff(time_s)))
    smooth = _smoothed(q, round(0.05 / period))
    speed = np.abs(np.gradient(smooth, time_s))
    resting = speed < 0.2 * np.percentile(speed, 90.0)
    low, high = np.percentile(phi, [2.0, 98.0])
    place = (phi - low) / max(high - low, 1e-12)
    # A rest in the middle is a hand that paused; it shows no border.
    side = np.where(resting & (place > 0.6), 1, np.where(resting & (place < 0.4), -1, 0))
    runs = [r for r in _runs(side) if side[r.start] and (r.stop - r.start) * period >= 0.06]
    times: list[float] = []
    levels: list[Vector] = []
    uppers: list[bool] = []
    for run in runs:
        upper = bool(side[run.start] > 0)
        if uppers and uppers[-1] == upper:
            levels[-1] = np.concatenate([levels[-1], phi[run]])
            continue
        times.append(float(time_s[run].mean()))
        levels.append(phi[run])
        uppers.append(upper)
    level = np.array([np.median(values) for values in levels])
    return Plateaus(np.array(times), level, np.array(uppers, dtype=np.bool_))


def from_plateaus(name: str, time_s: Vector, q: Vector, theta: Vector, mean_velocity: float) -> Gap:
    """Differences between successive plateaus: 2 alpha, whatever drifts slowly."""
    if abs(mean_velocity) > _CREEP:
        about = f"it crept at {1e3 * mean_velocity:.3g} mrad/s"
        return Gap(joint=name, verdict=GapVerdict.MOTOR_MOVED, reason=about)
    phi = q - theta
    rigid = _range(phi) < 2.0 * SMALLEST
    pushes = _alternations(q)
    if rigid and pushes >= CROSSINGS:
        about = f"pushed {pushes} times, phi stayed within {1e3 * _range(phi):.2g} mrad"
        return Gap(joint=name, verdict=GapVerdict.NONE, reason=about, half_gap=0.0,
                   crossings=pushes)  # fmt: skip
    found = find_plateaus(time_s, q, phi)
    crossings = max(len(found.level) - 1, 0)
    if crossings < CROSSINGS:
        about = f"{crossings} crossings from border to border, at least {CROSSINGS} are needed"
        return Gap(joint=name, verdict=GapVerdict.FEW, reason=about, crossings=crossings)
    half = 0.5 * np.abs(np.diff(found.level))
    # Drift adds to the ways up what it takes from the ways down.
    up = found.upper[1:]
    alpha = 0.5 * float(np.median(half[up]) + np.median(half[~up]))
    left = np.where(up, half - np.median(half[up]), half - np.median(half[~up]))
    # Of single plateaus: each difference has two.
    scatter = np.sqrt(2.0) * 1.4826 * float(np.median(np.abs(left)))
    confidence = 0.9 * scatter / np.sqrt(crossings) * float(student.ppf(0.975, crossings - 2))
    about = f"{crossings} crossings, plateaus scatter by {1e3 * scatter:.2g} mrad"
    if alpha < SMALLEST:
        return Gap(joint=name, verdict=GapVerdict.NONE, reason=about, half_gap=0.0,
                   confidence=confidence, crossings=crossings)  # fmt: skip
    if scatter > _CLEAR * alpha:
        return Gap(joint=name, verdict=GapVerdict.UNCLEAR, reason=about, crossings=crossings)
    return Gap(joint=name, verdict=GapVerdict.CLEAR, reason=about, half_gap=alpha,
               confidence=confidence, crossings=crossings)  # fmt: skip


# --- the link is clamped ----------------------------------------------------------------------


def from_ramps(name: str, time_s: Vector, phi: Vector, torque: Vector) -> Gap:
    """A bounded, robust fit of torque = -k delta(phi - c) + F sign(theta_dot), and how flat the
    torque really is inside the gap it found. (Unbounded, a third of real files diverge.)"""
    period = float(np.median(np.diff(time_s)))
    x = _smoothed(-phi, round(0.05 / period))  # theta, but for a constant
    tau = _smoothed(torque, round(0.05 / period))
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
        return Gap(joint=name, verdict=GapVerdict.NONE, reason=about, half_gap=0.0)
    if not clear:
        return Gap(joint=name, verdict=GapVerdict.UNCLEAR, reason=about)
    return Gap(joint=name, verdict=GapVerdict.CLEAR, reason=about, half_gap=float(alpha),
               confidence=confidence, coulomb=coulomb, stiffness=float(stiffness))  # fmt: skip


_RAMP_WIDTH = 0.002  # [rad/s] over which friction changes its sign in slow ramps


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


# --- both move --------------------------------------------------------------------------------


def from_motion(name: str, time_s: Vector, q: Vector, theta: Vector, theta_dot: Vector) -> Gap:
    """phi = c + c' t +- alpha - skew * velocity, of the samples at which phi rests."""
    period = float(np.median(np.diff(time_s)))
    phi = q - theta
    speed = _smoothed(theta_dot, 3)
    phi_dot = np.gradient(_smoothed(phi, 3), time_s)
    moving = np.abs(speed) > 0.1 * np.percentile(np.abs(speed), 95.0)
    rests = moving & (np.abs(phi_dot) < 0.05 * np.percentile(np.abs(speed), 95.0))
    if rests.sum() < 50:
        about = "phi is never at rest while the joint moves"
        return Gap(joint=name, verdict=GapVerdict.UNCLEAR, reason=about)
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
    answer = Gap(
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
    if scatter > _CLEAR * alpha:
        return answer
    if crossings < CROSSINGS:
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


def _smoothed(values: Vector, width: int) -> Vector:
    """Mean over `width` samples around each; the ends repeat."""
    if width < 2:
        return values
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))


def _alternations(values: Vector) -> int:
    """How often they went from the lower to the upper third of their range, or back."""
    low, high = np.percentile(values, [2.0, 98.0])
    place = (values - low) / max(float(high - low), 1e-12)
    outer = np.where(place > 0.67, 1, np.where(place < 0.33, -1, 0))
    return int(np.count_nonzero(np.diff(outer[outer != 0])))


def _runs(labels: NDArray[np.int64]) -> list[slice]:
    edges = [0, *(np.flatnonzero(np.diff(labels)) + 1).tolist(), len(labels)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]
