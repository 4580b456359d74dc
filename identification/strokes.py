"""The half-gap, from a motor that turns slowly to and fro while something holds its link."""

from dataclasses import replace

import numpy as np

from common.arrays import Vector
from identification.gap_result import CLEAR, SMALLEST, GapResult, GapVerdict, Limit, refused
from identification.stroke_fit import StrokeFit, fitted
from identification.stroke_samples import Samples, held_by, steady, whole_strokes

STROKES = 4
"""From border to border; fewer than three give no answer."""
_FEWEST = 3
_PUSHED = 0.3  # of the torque's noise: less pushes no link
_RARE = 0.03  # share of the time carried; a border met more rarely is not believed
_CLEARLY, _LITTLE = 0.1, 0.05  # of friction: a load that changes its side, or none
_NONE = 0.7 * SMALLEST  # [rad]: below, a gap is not worth the name
_RIGID = 1.5 * SMALLEST  # [rad]: what a rigid joint moves at most, with its interval
_FLOATS, _DRIFTS = 0.08, 0.5  # share of the time, and of the motor's speed, at which phi changes
_BEYOND, _LOOSE, _LOOSELY = 0.1, 0.1, 0.0001  # of alpha; of alpha and [rad]: scatter that floats
_ROUGH = 0.0003  # [rad]: scatter that every encoder may have
_NARROW = 2.0 * SMALLEST  # [rad] of alpha, of which half is close enough: gears bend by as much
WIDTH = 0.05
"""Half the interval of a gap over alpha, at most; or 0.5 mrad where that is more."""


def from_strokes(
    name: str,
    time_s: Vector,
    q: Vector,
    theta: Vector,
    theta_dot: Vector,
    torque: Vector,
    *,
    gear: float = 0.0,
    integrated: bool = False,
) -> GapResult:
    """Half-gap of strokes of the motor; torque (N,) [Nm] of the motor at the link.

    gear: turns of the motor for one of the link, 0 where it is not known; integrated: theta drifts,
    being a sum of velocities.
    """
    seen = steady(time_s, q, theta, theta_dot, torque)
    strokes = len(whole_strokes(seen)) if len(seen.stroke) else 0
    if strokes < _FEWEST:
        about = f"{strokes} strokes of the motor, at least {_FEWEST} are needed"
        about += "" if strokes else "; a link that a hand moved is judged so by `--by-hand`"
        return GapResult(joint=name, verdict=GapVerdict.FEW, reason=about)
    if not _comes_along(seen):
        about = "the link did not come along at both ends of the strokes"
        return GapResult(joint=name, verdict=GapVerdict.TOO_SHORT, reason=about)
    drift, middle, half = _span(seen)
    if half < 0.5 * SMALLEST:
        return _one_border(name, seen, half)
    fit = fitted(seen, drift, middle, half, gear, integrated=integrated)
    if fit is None:
        about = "the link never rested at a border while the motor turned"
        return GapResult(joint=name, verdict=GapVerdict.UNCLEAR, reason=about, estimate=half)
    if fit.alpha < _NONE:
        return _one_border(name, seen, max(fit.alpha, 0.0) + fit.confidence)
    off = seen.phi - middle - drift * seen.time_s
    return _judged(name, fit, strokes, _floats(name, fit, off, half, seen.follows))


def _comes_along(seen: Samples) -> bool:
    """True where the link follows the motor at the ends of most strokes, both ways."""
    ways: dict[float, list[bool]] = {-1.0: [], 1.0: []}
    for own in whole_strokes(seen):
        last = own[-max(len(own) // 6, 5) :]
        ways[float(seen.direction[own[0]])].append(abs(float(np.median(seen.follows[last]))) < 0.3)
    return all(np.mean(along) > 0.5 for along in ways.values() if along)


def _span(seen: Samples) -> tuple[float, float, float]:
    """Drift of phi [rad/s], by the ends of strokes of one way, and middle and half of what phi
    spans without it [rad]."""
    rows = []
    for own in whole_strokes(seen):
        last = own[-max(len(own) // 5, 3) :]
        rows.append((np.median(seen.time_s[last]), np.median(seen.phi[last]),
                     seen.direction[own[0]]))  # fmt: skip
    t, level, way = np.array(rows).T
    columns = np.stack([np.ones_like(t), t, way], axis=1)
    drift = float(np.linalg.lstsq(columns, level, rcond=None)[0][1])
    low, high = np.percentile(seen.phi - drift * seen.time_s, [2.0, 98.0])
    return drift, 0.5 * float(low + high), 0.5 * float(high - low)


def _floats(name: str, fit: StrokeFit, phi: Vector, half: float, follows: Vector) -> list[Limit]:
    """Limits that a link breaks which nothing holds or pulls: it drifts in its gap, which another
    crosses as fast as its motor turns, and rests beyond what the fit takes for borders. phi (N,)
    about its middle, half its range [rad]."""
    cause = ("neither friction nor gravity holds the link in its gap, or it was touched: "
             f"`contactd identify gap {name} --by-hand`")  # fmt: skip
    inside = (np.abs(phi) < 0.5 * fit.alpha) & (np.abs(follows) < _DRIFTS)
    beyond = half - fit.bent > (1.0 + _BEYOND) * fit.alpha
    return [
        Limit("share of the time in which the link floats in its gap", float(inside.mean()),
              _FLOATS, "", cause),
        Limit("scatter of phi as it floats", 1e3 * fit.scatter * beyond,
              1e3 * (_LOOSE * fit.alpha + _LOOSELY), "mrad", cause),
    ]  # fmt: skip


def _one_border(name: str, seen: Samples, half: float) -> GapResult:
    """A link that always came along, phi within half [rad] about its middle: rigid, if its load
    changed side, or held at one border."""
    about = f"phi stayed within {2e3 * half:.2g} mrad over {len(whole_strokes(seen))} strokes"
    held = held_by(seen)
    if held is None or half > _RIGID:
        return GapResult(joint=name, verdict=GapVerdict.UNCLEAR, reason=about, estimate=half)
    low, high = held.torque - held.reach, held.torque + held.reach
    little = max(-low, high) < _LITTLE * held.friction
    if little or min(-low, high) > _CLEARLY * held.friction:
        about = f"{about}, its load changed side"
        return GapResult(joint=name, verdict=GapVerdict.NONE, reason=about, half_gap=0.0,
                         confidence=half)  # fmt: skip
    return GapResult(joint=name, verdict=GapVerdict.ONE_BORDER, estimate=half,
                     reason=f"{about}: a load of {low:.2g} to {high:.2g} Nm may hold the link at "
                     "one border")  # fmt: skip


def _judged(name: str, fit: StrokeFit, strokes: int, floats: list[Limit]) -> GapResult:
    confidence = fit.confidence
    reason = (f"{strokes} strokes, phi scatters by {1e3 * fit.scatter:.2g} mrad at the borders; "
              f"the gear bent by {round(1e3 * fit.bent, 3) + 0.0:.2g} mrad")  # fmt: skip
    found = GapResult(
        joint=name,
        verdict=GapVerdict.CLEAR,
        reason=reason,
        half_gap=fit.alpha,
        # A link that bounces rests inside its gap, never beyond: half its scatter is no noise.
        confidence=confidence + 0.5 * fit.scatter,
        compliance=fit.compliance,
        crossings=strokes,
        # One that the scatter may make is no encoder's error.
        harmonics=tuple(h for h in fit.harmonics if h.amplitude > fit.scatter),
        coulomb=fit.coulomb,
    )
    found = refused(found, GapVerdict.UNCLEAR, floats)
    if found.limit is not None:
        return replace(found, harmonics=())
    one_side = Limit("share of the time at the more frequent border", 1.0 - fit.rarer, 1.0 - _RARE,
                     "", "gravity holds the link at one border: by hand")  # fmt: skip
    found = refused(found, GapVerdict.ONE_BORDER, [one_side])
    narrow = fit.alpha if fit.alpha < _NARROW else 0.0
    most = max(2.0 * WIDTH * fit.alpha, SMALLEST, narrow)
    limits = [
        Limit("noise of the torque over that which pushes the link", fit.noise, 1.0 / _PUSHED, "",
              "the log's current is not this motor's, or has the other sign (`motor_sign`)"),
        Limit("scatter of phi at the borders", 1e3 * fit.scatter,
              1e3 * (CLEAR * fit.alpha + _ROUGH), "mrad",
              "a person touched the link, or encoders with errors that do not repeat with a turn"),
        Limit("interval of alpha", 2e3 * confidence, 1e3 * most, "mrad",
              "an elastic gear, friction by which a gear bends as much as this gap, or encoders "
              "with errors that show too little in so short a motion: by hand, or its data sheet"),
    ]  # fmt: skip
    return refused(found, GapVerdict.UNCLEAR, limits) if found.limit is None else found
