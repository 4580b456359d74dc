"""Refusals of `enable` and `start` because of the arm's pose, with their reasons. Pure."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from common.arrays import Vector
from daemon.faults.conditions import Response
from daemon.motion.limits import Limits, all_finite
from daemon.motion.path import ROUNDING, JointPath, PathPoint, stands
from daemon.protocol.state import Meeting
from daemon.tick.decision import ControlInput
from estimator.walls import SINKS_M, Walls

# Largest distance from its first sample at which a recorded trajectory may begin [rad].
START_TOLERANCE = 0.05
# Distance outside the limits beyond which a position is implausible: end stops are nearer [rad].
FAR = 1.0
# Margin by which a suggested move ends inside the range from which the path fits [rad].
INSIDE = 0.02
# Number of points of a path that are checked for collisions of shapes, a few ms in all; and the
# part of an endless path that is checked [s].
PLACES, ENDLESS_S = 80, 60.0
SHAPES_FILES = "surroundings.yaml or shapes.yaml"


# Advice for moving a joint without power back inside its limits, by its `end`.
WAY_BACK = {
    "hold": "switch its drive off and move it back by hand",
    "brake": "release its brake and move it back by hand",
    "limp": "move it back by hand",
}


def not_energisable(
    joints: Sequence[str], ends: Sequence[str], limits: Limits, observed: ControlInput
) -> list[str]:
    """Reasons against `enable`: findings that require a quick stop, drives that are still switching
    off, and joints too far outside their limits for the arm to lead them back by itself."""
    reasons = [str(f) for f in observed.findings if f.response >= Response.QUICK_STOP]
    if late := [name for name, on in zip(joints, observed.operating, strict=True) if on]:
        # The next tick would take them for enabled drives, and then for ones that dropped out.
        reasons.append(f"still switching off: {', '.join(late)}")
    q = observed.q
    outside = limits.outside(q)
    return reasons + [
        f"{name} stands at {q[i]:.3f} rad, more than {limits.tolerance:g} outside its limits "
        f"[{limits.lower[i]:g}, {limits.upper[i]:g}]: {_way_back(ends[i], limits, q, i)}"
        for i, name in enumerate(joints)
        if outside[i]
    ]


def _way_back(end: str, limits: Limits, q: Vector, i: int) -> str:
    """Advice for joint i outside its limits; beyond FAR, to check its position first."""
    if limits.lower[i] - FAR < q[i] < limits.upper[i] + FAR:
        return WAY_BACK[end]
    doubt = "scale and offset of its `link_position` first (`contactd identify zero`)"
    return f"check {doubt}; if they are right, {WAY_BACK[end]}"


def lacking(path: JointPath, *, blind: bool) -> list[str]:
    """Requirements of `start` that are missing whatever the pose: a trajectory, trusted links."""
    if stands(path):
        return [
            "no trajectory is configured: `contactctl start FILE.csv` runs one, `contactctl go` "
            "moves to a pose, and `trajectory` in config.yaml sets what `start` alone runs; an "
            "armed arm also yields without one, while it holds"
        ]
    if blind and not path.motors_only:
        return [
            "the links are not trusted: before this start the wiring was not checked, or not "
            "with these drives and this configuration (`contactd identify wiring`; what it finds "
            "counts from the next `contactctl disable` and `enable` on)"
        ]
    return []


def touched(observed: ControlInput, path: JointPath, *, armed: bool, blind: bool) -> list[str]:
    """Reason against `start`: a contact at which the arm would halt at once. Links that are not
    trusted show no collision."""
    if observed.hit and not blind:
        return [f"{observed.hit}: free it first"]
    if armed and observed.touched and observed.load:
        announce = f"{observed.load}, announce it first (`contactctl payload`)"
        return [f"{observed.touched}: {announce}"]
    halts = observed.touched and path.halts_at_contact
    return [f"{observed.touched}: free it first"] if halts else []


def not_startable(joints: Sequence[str], q: Vector, limits: Limits, place: PathPoint) -> list[str]:
    """Reasons against `start`: joints that are not where the path begins, otherwise those that it
    would move out of their limits; then the command that moves the arm to a valid start."""
    off_start, begin = _off_start(joints, q, place), place.path.begin
    if off_start and begin is not None:
        there = np.where(place.off_start(q, START_TOLERANCE), begin, np.nan)
        here = "--from-here (the configured one: trajectory.from_here)"
        return [*off_start, f"{way_to(joints, there)}, or start it with {here}"]
    reasons = leaves_limits(joints, q, limits, place)
    there = place.nearest(q, limits.lower, limits.upper, INSIDE)
    if reasons and all_finite(there):
        return [*reasons, way_to(joints, np.where(there == q, np.nan, there))]
    return reasons


def path_collision(walls: Walls | None, q: Vector, place: PathPoint) -> Meeting | None:
    """First collision of shapes on a path from q (n,) [rad], a reason against `start`; or None."""
    return next(filter(None, path_collisions(walls, q, place)), None)


def path_collisions(walls: Walls | None, q: Vector, place: PathPoint) -> Iterator[Meeting | None]:
    """Check of the rest of a path from q (n,) [rad], or of its first minute if it is endless: for
    each of PLACES points, the pair that penetrates, or penetrates deeper than before, if any."""
    if walls is None or not walls.clearance.pairs:
        return
    clearance, path, s = walls.clearance, place.continued_from(q).path, place.s
    end = min(path.duration, s + ENDLESS_S)
    clearance.at(q)
    least, origin = _floor(clearance.least, -np.inf), q - path.offset(s)
    for at_s in np.linspace(s, end, PLACES).tolist() if path.fastest(s).any() else []:
        there = origin + path.offset(at_s)
        clearance.at(there)
        gaps = np.asarray(clearance.least)
        pair = int(np.argmin(gaps - least))
        if (gap := gaps[pair]) >= least[pair]:
            least = _floor(gaps, least)
            yield None
            continue
        names = [one.name for one in clearance.pairs[pair]]
        depth = f", {-1000.0 * gap:.0f} mm deep," if gap < -5e-4 else ""
        through, advice = "through", "go there another way"
        if least[pair] < -ROUNDING:
            before = -1000.0 * (least[pair] + SINKS_M)
            through, depth = "deeper into", f", from {before:.0f} to {-1000.0 * gap:.0f} mm,"
            advice = f"go first where they part, correct {SHAPES_FILES}, or move it without power"
        text = f"{path.name} leads {f' {through} '.join(names)}{depth} at {at_s:.1f} s: {advice}"
        yield Meeting(pair=names, position=there.tolist(), text=text)


def _floor(gaps: Vector, before: Vector | float) -> Vector:
    """Smallest gap that each pair may have after these [m]."""
    gaps = np.asarray(gaps)
    return np.where(gaps < 0.0, np.maximum(before, gaps - SINKS_M), -ROUNDING)


def way_to(joints: Sequence[str], there: Vector) -> str:
    """Command that moves joints to `there` (n,) [rad], NaN for those that stay."""
    moved = zip(joints, there.tolist(), strict=True)
    words = " ".join(f"{name}={value:.3f}" for name, value in moved if math.isfinite(value))
    return f"`contactctl go {words}` leads there"


def _off_start(joints: Sequence[str], q: Vector, place: PathPoint) -> list[str]:
    off_start, begin = place.off_start(q, START_TOLERANCE), place.path.begin
    return [
        f"{name} stands at {q[i]:.3f} rad, {abs(q[i] - begin[i]):.3f} rad from where "
        f"{place.path.name} begins ({begin[i]:.3f}; allowed {START_TOLERANCE:g})"
        for i, name in enumerate(joints)
        if begin is not None and off_start[i]
    ]


def leaves_limits(joints: Sequence[str], q: Vector, limits: Limits, place: PathPoint) -> list[str]:
    """Reasons for each joint that the rest of the path would move out of its limits, from q (n,)
    [rad]."""
    beyond = place.leaves_limits(q, limits.lower, limits.upper)
    return [
        f"from {q[i]:.3f} rad the path of {name} would leave its limits "
        f"[{limits.lower[i]:g}, {limits.upper[i]:g}]"
        for i, name in enumerate(joints)
        if beyond[i]
    ]
