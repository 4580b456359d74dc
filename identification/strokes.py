"""Half-gap from a motor that turns slowly to and fro while something holds its link."""

from dataclasses import replace

import numpy as np

from common.arrays import Vector
from identification.gap_result import CLEAR, SMALLEST, GapResult, GapVerdict, Limit, refused
from identification.stroke_fit import StrokeFit, fitted
from identification.stroke_samples import Samples, held_by, steady, whole_strokes

STROKES = 4
"""Strokes from border to border; fewer than three give no result."""
_FEWEST = 3
_PUSHED = 0.3  # of the torque's noise, the least that pushes a link
_RARE = 0.03  # share of the time carried; a border met more rarely is not trusted
_CLEARLY, _LITTLE = 0.1, 0.05  # of friction: a load that clearly changes sign, or is negligible
_NONE = 0.7 * SMALLEST  # [rad]; a narrower gap counts as none
_RIGID = 1.5 * SMALLEST  # [rad], largest motion of a rigid joint, with its interval
_FLOATS, _DRIFTS = 0.08, 0.5  # share of the time, and of the motor's speed, at which phi changes
_BEYOND, _LOOSE, _LOOSELY = 0.1, 0.1, 0.0001  # of alpha; of alpha and [rad]: scatter that floats
_ROUGH = 0.0003  # [rad], scatter that any encoder may have
_NARROW = 2.0 * SMALLEST  # [rad] of alpha, for which half is precise enough: gears bend as much
WIDTH = 0.05
"""Largest half-interval of a gap over alpha; or 0.5 mrad if that is more."""


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
    """Half-gap from strokes of the motor; torque (N,) [Nm] of the motor at the link.

    gear: turns of the motor per turn of the link, 0 if unknown; integrated: theta is an integrated
    velocity, and drifts.
    """
    seen = steady(time_s, q, theta, theta_dot, torque)
    strokes = len(whole_strokes(seen)) if len(seen.stroke) else 0
    if strokes < _FEWEST:
        about = f"{strokes} strokes of the motor, at least {_FEWEST} are needed"
        about += "" if strokes else "; if a hand moved the link, use `--by-hand`"
        return GapResult(joint=name, verdict=GapVerdict.FEW, reason=about)
    if not _follows(seen):
        about = "the link did not follow at both ends of the strokes"
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


def _follows(seen: Samples) -> bool:
    """True if the link follows the motor at the ends of most strokes, in both directions."""
    followed: dict[float, list[bool]] = {-1.0: [], 1.0: []}
    for own in whole_strokes(seen):
        last = own[-max(len(own) // 6, 5) :]
        along = abs(float(np.median(seen.follows[last]))) < 0.3
        followed[float(seen.direction[own[0]])].append(along)
    return all(np.mean(each) > 0.5 for each in followed.values() if each)


def _span(seen: Samples) -> tuple[float, float, float]:
    """Drift of phi [rad/s], by the ends of strokes in one direction, and middle and half of the
    range of phi without it [rad]."""
    rows = []
    for own in whole_strokes(seen):
        last = own[-max(len(own) // 5, 3) :]
        rows.append((np.median(seen.time_s[last]), np.median(seen.phi[last]),
                     seen.direction[own[0]]))  # fmt: skip
    t, level, direction = np.array(rows).T
    columns = np.stack([np.ones_like(t), t, direction], axis=1)
    drift = float(np.linalg.lstsq(columns, level, rcond=None)[0][1])
    low, high = np.percentile(seen.phi - drift * seen.time_s, [2.0, 98.0])
    return drift, 0.5 * float(low + high), 0.5 * float(high - low)


def _floats(name: str, fit: StrokeFit, phi: Vector, half: float, follows: Vector) -> list[Limit]:
    """Limits exceeded by a link that nothing holds or pulls: it drifts in its gap, which others
    cross as fast as the motor turns, and rests beyond what the fit takes for borders. phi (N,)
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
    """Result for a link that always followed, with phi within half [rad] about its middle: rigid if
    its load changed sign, or held at one border."""
    about = f"phi stayed within {2e3 * half:.2g} mrad over {len(whole_strokes(seen))} strokes"
    held = held_by(seen)
    if held is None or half > _RIGID:
        return GapResult(joint=name, verdict=GapVerdict.UNCLEAR, reason=about, estimate=half)
    low, high = held.torque - held.reach, held.torque + held.reach
    little = max(-low, high) < _LITTLE * held.friction
    if little or min(-low, high) > _CLEARLY * held.friction:
        about = f"{about}, its load changed sign"
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
        # A link that bounces rests inside its gap, never beyond: half its scatter is not noise.
        confidence=confidence + 0.5 * fit.scatter,
        compliance=fit.compliance,
        crossings=strokes,
        # Harmonics within the scatter are not errors of an encoder.
        harmonics=tuple(h for h in fit.harmonics if h.amplitude > fit.scatter),
        coulomb=fit.coulomb,
    )
    found = refused(found, GapVerdict.UNCLEAR, floats)
    if found.limit is not None:
        return replace(found, harmonics=())
    one_side = Limit("share of the time at the more frequent border", 1.0 - fit.rarer, 1.0 - _RARE,
                     "", "gravity holds the link at one border: measure by hand")  # fmt: skip
    found = refused(found, GapVerdict.ONE_BORDER, [one_side])
    narrow = fit.alpha if fit.alpha < _NARROW else 0.0
    most = max(2.0 * WIDTH * fit.alpha, SMALLEST, narrow)
    limits = [
        Limit("noise of the torque over that pushing the link", fit.noise, 1.0 / _PUSHED, "",
              "the log's current is not this motor's, or has the wrong sign (`motor_sign`)"),
        Limit("scatter of phi at the borders", 1e3 * fit.scatter,
              1e3 * (CLEAR * fit.alpha + _ROUGH), "mrad",
              "a person touched the link, or encoders have errors that do not repeat with a turn"),
        Limit("interval of alpha", 2e3 * confidence, 1e3 * most, "mrad",
              "an elastic gear, friction that bends a gear as much as this gap, or encoder errors "
              "that so short a motion does not show: measure by hand, or use the data sheet"),
    ]  # fmt: skip
    return refused(found, GapVerdict.UNCLEAR, limits) if found.limit is None else found
