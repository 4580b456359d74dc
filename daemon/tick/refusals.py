"""Refusals of `enable` and `start`, from where the arm stands: reasons in words. Pure."""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from arrays import Vector
from daemon.faults.finding import Finding
from daemon.faults.table import Response
from daemon.motion.limits import Limits, all_finite
from daemon.motion.path import JointPath, Place, stands

# How far from its first sample a recorded trajectory may begin [rad].
START_TOLERANCE = 0.05
# How far inside the range of a path the way to it is to end: it does not end to the bit [rad].
INSIDE = 0.02


# How a joint that nobody energises gets back inside its limits, by how it ends.
WAY_BACK = {
    "hold": "take its drive's power away and move it back by hand",
    "brake": "release its brake and move it back by hand",
    "limp": "move it back by hand",
}


class Standing(Protocol):
    """Part of the `ControlInput` that `enable` looks at."""

    @property
    def q(self) -> Vector:
        """Link positions (n,) [rad]."""

    @property
    def operating(self) -> Sequence[bool]:
        """True for each drive in operation enabled."""

    @property
    def findings(self) -> Sequence[Finding]:
        """Findings of the last tick."""


def not_energisable(
    joints: Sequence[str], ends: Sequence[str], limits: Limits, arm: Standing
) -> list[str]:
    """Reasons against `enable`: findings that ask for a quick stop, drives on their way off, and
    joints that stand further outside their limits than the arm would lead them back by itself."""
    reasons = [str(f) for f in arm.findings if f.response >= Response.QUICK_STOP]
    if late := [name for name, on in zip(joints, arm.operating, strict=True) if on]:
        # Taken for enabled drives in the next tick, and then for drives that have dropped out.
        reasons.append(f"still on their way off: {', '.join(late)}")
    q = arm.q
    outside = limits.outside(q)
    return reasons + [
        f"{name} stands at {q[i]:.3f} rad, more than {limits.tolerance:g} outside its limits "
        f"[{limits.lower[i]:g}, {limits.upper[i]:g}]: {WAY_BACK[ends[i]]}"
        for i, name in enumerate(joints)
        if outside[i]
    ]


def lacking(path: JointPath, *, blind: bool) -> list[str]:
    """What `start` lacks wherever the arm stands: a trajectory, or links that are trusted."""
    if stands(path):
        return [
            "no trajectory is configured: `contactctl start FILE.csv` runs one, `contactctl go` "
            "leads to a pose, and `trajectory` in config.yaml says what `start` alone runs; an "
            "armed arm yields without one, too, while it holds"
        ]
    if blind and not path.motors_only:
        return [
            "the links are not trusted: before this start the wiring was not checked, or not "
            "with these drives and this configuration (`contactd identify wiring`)"
        ]
    return []


def not_startable(joints: Sequence[str], q: Vector, limits: Limits, place: Place) -> list[str]:
    """Reasons against `start`: joints that stand elsewhere than the path begins, else those that it
    would lead out of their limits; then the command that leads to where it can start."""
    astray, begin = _astray(joints, q, place), place.path.begin
    if astray and begin is not None:
        there = np.where(place.astray(q, START_TOLERANCE), begin, np.nan)
        return [*astray, f"{_way(joints, there)}, or start it with --from-here"]
    reasons = leaves_limits(joints, q, limits, place)
    there = place.nearest(q, limits.lower, limits.upper, INSIDE)
    if reasons and all_finite(there):
        return [*reasons, _way(joints, np.where(there == q, np.nan, there))]
    return reasons


def _way(joints: Sequence[str], there: Vector) -> str:
    """Command that moves joints to `there` (n,) [rad], NaN for those that stay."""
    moved = zip(joints, there.tolist(), strict=True)
    words = " ".join(f"{name}={value:.3f}" for name, value in moved if math.isfinite(value))
    return f"`contactctl go {words}` leads there"


def _astray(joints: Sequence[str], q: Vector, place: Place) -> list[str]:
    astray, begin = place.astray(q, START_TOLERANCE), place.path.begin
    return [
        f"{name} stands at {q[i]:.3f} rad, {abs(q[i] - begin[i]):.3f} rad from where "
        f"{place.path.name} begins ({begin[i]:.3f}; allowed {START_TOLERANCE:g})"
        for i, name in enumerate(joints)
        if begin is not None and astray[i]
    ]


def leaves_limits(joints: Sequence[str], q: Vector, limits: Limits, place: Place) -> list[str]:
    """Reasons for each joint that the rest of the path would lead out of its limits, from q (n,)
    [rad]."""
    beyond = place.leaves_limits(q, limits.lower, limits.upper)
    return [
        f"from {q[i]:.3f} rad the path of {name} would leave its limits "
        f"[{limits.lower[i]:g}, {limits.upper[i]:g}]"
        for i, name in enumerate(joints)
        if beyond[i]
    ]
