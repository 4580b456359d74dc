"""Half-gap from a link that is led by hand from border to border while its motor stands."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from common.arrays import Vector
from identification.bending import SOFTEST, STIFFEST, USUAL, USUALLY, Bending, bending
from identification.gap_result import (
    CLEAR,
    CROSSINGS,
    ENCODERS,
    SMALLEST,
    GapResult,
    GapVerdict,
    Limit,
    refused,
    resolution,
    smoothed,
    spread,
)

_CREEP = 0.01  # [rad/s], more than the bias of a velocity
_SURE = 3.0  # standard errors by which a border loads the motor
_ALIKE = 0.35  # of the load at the other border, which a motor forgets slowly
_HIDDEN = 3.0  # largest ratio of a hand's load to that on the motor, whose friction holds the rest
_BACK = 0.2  # least load in one direction, over that in the other
_PRESSED_S = 0.1
_NO_TORQUE = "the motor's torque is the same throughout: it does not show which ends are borders"
_STEP = 0.4  # of an encoder's resolution: 95 % of the differences between two rests are below


@dataclass(frozen=True, slots=True)
class Plateaus:
    """Rests of phi at either border, in the order of time."""

    time_s: Vector
    level: Vector
    """phi [rad]"""
    upper: NDArray[np.bool_]
    """True at the upper border"""


def find_plateaus(time_s: Vector, q: Vector, phi: Vector) -> Plateaus:
    """Rests of the link at either end of phi's range, one per visit."""
    period = float(np.median(np.diff(time_s)))
    smooth = smoothed(q, round(0.05 / period))
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
        # The time of a sample: the mean may lie in a pause of the log.
        times.append(float(time_s[(run.start + run.stop) // 2]))
        levels.append(phi[run])
        uppers.append(upper)
    level = np.array([np.median(values) for values in levels])
    return Plateaus(np.array(times), level, np.array(uppers, dtype=np.bool_))


def from_plateaus(
    name: str, time_s: Vector, q: Vector, theta: Vector, mean_velocity: float, torque: Vector
) -> GapResult:
    """Half-gap from the differences between successive plateaus: 2 alpha, regardless of slow drift.

    torque (N,) [Nm] of the motor, which a border loads and a hand that stops short of it does not;
    a constant part of it does not matter.
    """
    if abs(mean_velocity) > _CREEP:
        about = f"it crept at {1e3 * mean_velocity:.3g} mrad/s"
        return GapResult(joint=name, verdict=GapVerdict.MOTOR_MOVED, reason=about)
    phi = q - theta
    pushes = _alternations(q)
    if spread(phi) < 2.0 * SMALLEST and pushes >= CROSSINGS:
        about = f"pushed {pushes} times, phi stayed within {1e3 * spread(phi):.2g} mrad"
        none = GapResult(joint=name, verdict=GapVerdict.NONE, reason=about, half_gap=0.0,
                         crossings=pushes)  # fmt: skip
        return _from_both_sides(none, time_s, torque)
    found = find_plateaus(time_s, q, phi)
    crossings = max(len(found.level) - 1, 0)
    if crossings < CROSSINGS:
        about = f"{crossings} crossings from border to border, at least {CROSSINGS} are needed"
        estimate = 0.5 * float(np.median(np.abs(np.diff(found.level)))) if crossings else np.nan
        return GapResult(joint=name, verdict=GapVerdict.FEW, reason=about, estimate=estimate,
                   crossings=crossings)  # fmt: skip
    half = 0.5 * np.abs(np.diff(found.level))
    # Drift adds to the upward differences what it takes from the downward ones.
    up = found.upper[1:]
    alpha = 0.5 * float(np.median(half[up]) + np.median(half[~up]))
    left = np.where(up, half - np.median(half[up]), half - np.median(half[~up]))
    # Of single plateaus: each difference has two.
    scatter = np.sqrt(2.0) * 1.4826 * float(np.median(np.abs(left)))
    confidence = 0.9 * scatter / np.sqrt(crossings) * float(student.ppf(0.975, crossings - 2))
    # Rests that do not scatter read the same count of an encoder each time.
    step = _STEP * max(resolution(q), resolution(theta))
    confidence = ENCODERS + float(np.hypot(confidence, step))
    about = f"{crossings} crossings, plateaus scatter by {1e3 * scatter:.2g} mrad"
    found_gap = GapResult(joint=name, verdict=GapVerdict.CLEAR, reason=about, half_gap=alpha,
                    confidence=confidence, crossings=crossings)  # fmt: skip
    if alpha < SMALLEST:
        none = replace(found_gap, verdict=GapVerdict.NONE, half_gap=0.0)
        return _from_both_sides(none, time_s, torque)
    pressed = _pressed(time_s, phi, torque, found)
    bent = bending(time_s, phi, torque, found.time_s, found.upper)
    if not np.ptp(torque) > 0.0:
        return _doubted(found_gap, GapVerdict.UNCLEAR, _NO_TORQUE)
    found_gap = _straightened(found_gap, bent, pressed)
    return _judged(found_gap, scatter, *_doubtful_border(pressed))


def _from_both_sides(none: GapResult, time_s: Vector, torque: Vector) -> GapResult:
    """`none` if the motor (torque (N,) [Nm]) held the link in both directions: a link that gravity
    holds at one border, pressed towards it and released, moves as one without a gap does."""
    if not np.ptp(torque) > 0.0:
        return _doubted(none, GapVerdict.UNCLEAR, _NO_TORQUE)
    width = max(round(_PRESSED_S / float(np.median(np.diff(time_s)))), 1)
    smooth = smoothed(torque, width)
    low, high = np.percentile(smooth, [2.0, 98.0])
    noise = 1.4826 * float(np.median(np.abs(np.diff(torque)))) / np.sqrt(2.0 * width)
    least = max(_BACK * max(high, -low), _SURE * noise)
    if min(high, -low) > least:
        return none
    about = (f"the motor carries {low:.2g} to {high:.2g} Nm, pressed to one side only: press it "
             "the other way, too, harder than the link's own weight")  # fmt: skip
    return _doubted(none, GapVerdict.ONE_BORDER, about)


def _doubted(found: GapResult, verdict: GapVerdict, why: str) -> GapResult:
    """`found` with its value as an estimate; without a dead zone there is none."""
    return replace(found, verdict=verdict, half_gap=np.nan, estimate=found.half_gap or np.nan,
                   reason=f"{found.reason}; {why}")  # fmt: skip


def _straightened(
    found: GapResult, bent: Bending | None, pressed: Mapping[str, Vector]
) -> GapResult:
    """`found` without the bending of the gear, if that is known better than it matters; else with
    that in its interval, or with what gears usually bend when `pressed` so much."""
    loads = [float(loads.mean()) for loads in pressed.values()]
    load = max(*loads, 0.0) if loads else float("inf")
    if bent is None:
        unseen = (USUAL + 2.0 * USUALLY) * load if loads else 0.0
        return replace(found, confidence=found.confidence + unseen)
    gives = found.half_gap - bent.half_gap
    # Friction hid the force of the hand, or the controller responded late.
    strange = not STIFFEST < bent.compliance < SOFTEST
    if strange or bent.confidence > max(CLEAR * bent.half_gap, 0.5 * SMALLEST):
        least = USUAL * load if strange and loads else 0.0
        # A line through very small torques may end anywhere; gears do not bend so much.
        unknown = min(max(abs(gives), least) + bent.confidence, _HIDDEN * SOFTEST * load)
        return replace(found, confidence=found.confidence + unknown,
                       reason=f"{found.reason}; of alpha the gear may have bent "
                       f"{1e3 * min(max(gives, least), unknown):.2g} mrad")  # fmt: skip
    about = (f"{found.reason}; the gear bends by {1e3 * bent.compliance:.2g} mrad/Nm, "
             f"{1e3 * gives:.2g} mrad of the measured half-gap")  # fmt: skip
    return replace(found, half_gap=bent.half_gap, reason=about, compliance=bent.compliance,
                   confidence=max(found.confidence, bent.confidence))  # fmt: skip


def _judged(found: GapResult, scatter: float, doubt: str, loaded: bool) -> GapResult:
    """`found` unchanged if it has two borders, and both `loaded` the motor."""
    most = 1e3 * CLEAR * found.half_gap
    cause = "preload, an elastic gear, or uneven pressing"
    limit = Limit("scatter of the plateaus", 1e3 * scatter, most, "mrad", cause)
    answer = refused(found, GapVerdict.UNCLEAR, [limit])
    if answer.limit is not None:
        return answer
    if doubt:
        found = replace(found, reason=f"{found.reason}; {doubt}")
    if not loaded:
        return replace(found, verdict=GapVerdict.UNCLEAR, half_gap=np.nan, estimate=found.half_gap)
    wide = Limit("interval of alpha", 1e3 * found.confidence,
                 1e3 * max(found.half_gap, SMALLEST), "mrad",
                 "gears bend by as much as this gap: press more softly; or the current has another "
                 "unit than A")  # fmt: skip
    return refused(found, GapVerdict.UNCLEAR, [wide])


def _pressed(time_s: Vector, phi: Vector, torque: Vector, found: Plateaus) -> dict[str, Vector]:
    """Load of a border on the motor [Nm], beyond the torque inside the gap, at each rest at the
    upper and at the lower end; empty if the motor was never inside."""
    low, high = np.percentile(phi, [2.0, 98.0])
    free = np.abs(phi - 0.5 * (low + high)) < 0.25 * (high - low)
    if not free.any():
        return {}
    # A motor responds late, and its friction drifts: each rest is compared with the crossings
    # before and after it.
    crossing = np.searchsorted(found.time_s, time_s[free])
    inside = np.array([
        torque[free][crossing == k].mean() if (crossing == k).any() else np.nan
        for k in range(len(found.time_s) + 1)
    ])  # fmt: skip
    before, after = inside[:-1], inside[1:]
    usual = np.where(
        np.isnan(before), after, np.where(np.isnan(after), before, 0.5 * (before + after))
    )
    rests = np.array([torque[np.abs(time_s - t) < 0.1].mean() for t in found.time_s])
    loads = np.where(np.isfinite(usual), rests - usual, 0.0)
    loads = np.where(found.upper, -loads, loads)
    return {"upper": loads[found.upper], "lower": loads[~found.upper]}


def _doubtful_border(sides: Mapping[str, Vector]) -> tuple[str, bool]:
    """Reason to doubt that one end of phi's range is a border rather than where the hand stopped,
    or "" if both load the motor alike (`_pressed`): a link ahead of it (phi > 0) is held back, one
    behind it pushed. With it, whether that end loaded the motor at all.

    The share of a load that the motor's friction takes is unknown here: even on a good arm that is
    pressed alike, one end may load the motor six times as much as the other.
    """
    if not sides:
        return "", True
    mean = {side: float(x.mean()) for side, x in sides.items()}
    error = {side: float(x.std(ddof=1)) / np.sqrt(len(x)) for side, x in sides.items()}
    weak = min(mean, key=mean.__getitem__)
    loaded = mean[weak] > _SURE * error[weak]
    if loaded and mean[weak] > _ALIKE * max(mean.values()):
        return "", True
    about = " and ".join(f"{max(mean[s], 0.0):.2g} Nm at the {s}" for s in ("lower", "upper"))
    words = (f"the motor carries {about} end: did the link touch the {weak} border? Press it a "
             "little, both ways alike")  # fmt: skip
    return words, loaded


def _alternations(values: Vector) -> int:
    """Number of changes between the lower and the upper third of the values' range."""
    low, high = np.percentile(values, [2.0, 98.0])
    place = (values - low) / max(float(high - low), 1e-12)
    outer = np.where(place > 0.67, 1, np.where(place < 0.33, -1, 0))
    return int(np.count_nonzero(np.diff(outer[outer != 0])))


def _runs(labels: NDArray[np.int64]) -> list[slice]:
    edges = [0, *(np.flatnonzero(np.diff(labels)) + 1).tolist(), len(labels)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]
