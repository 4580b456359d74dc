"""Point of contact: which link is touched and where on it, from the residuals of all joints.

A force f at a point x of a link is J(x)^T f at the joints. Every point of the arm's surface is a
hypothesis, whose f is any of some 30 N along each axis; its probability is that of the residuals:

    r ~ N(0, D + J(x)^T (30 N)^2 J(x)),    D = diag(s_i^2)

so that a link further out, whose own joint shows nothing, is as unlikely as a force that happens to
pass through that joint's axis. For readers of States; nothing of it is in the loop.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector
from programs.recordings.skeleton import Skeleton, rotated, skeleton_of, towards

SURE, CANDIDATE = 0.9, 0.05
"""Least probability of the link that is named, and of one that may be meant."""
MOST_DOUBT_M: Final = 0.08
"""Beyond it a point cannot be told."""
NO_FIT: Final = 2.0
_FORCE_N: Final = 30.0
_ALONG, _AROUND = 12, 12
# Standard deviation of a residual: of its share of the configured level, of what raises the level
# in force beyond that, and of what it lags behind.
_LEVEL, _RAISED, _LAG = 0.04, 0.2, 0.8


@dataclass(frozen=True, slots=True)
class TouchPoint:
    """Contact on one arm. `links`, by their joints, are those that may be meant, most likely first;
    `point` (3,) [m] is in the frame of the URDF's link `frame`, the true one within `doubt_m` of it
    in 95 of 100, if the first link is right."""

    links: tuple[str, ...]
    sure: float
    frame: str
    point: Vector
    doubt_m: float
    force: Vector
    """(3,) [N], along the axes of `frame`"""
    misfit: float


class TouchFinder:
    """Hypotheses of one arm, as its URDF has it."""

    def __init__(self, urdf: str, joints: Sequence[str], tool: tuple[str, Vector] | None) -> None:
        self._joints = tuple(joints)
        self._skeleton: Skeleton = skeleton_of(urdf)
        points, owners = [], []
        for capsule in self._skeleton.capsules:
            on = _surface(np.array(capsule.end), capsule.radius)
            points.append(on)
            owners += [capsule.link] * len(on)
        self._points, self._owners = np.concatenate(points), np.array(owners)

    def kin(self, q: Vector):
        at = dict(zip(self._joints, q, strict=True))
        rot = {self._skeleton.root: np.eye(3)}
        pos = {self._skeleton.root: np.zeros(3)}
        moved = {self._skeleton.root: ()}
        axes = {}
        for f in self._skeleton.frames:
            t, quat = f.at(at.get(f.joint, 0.0))
            Rl = np.array([rotated(quat, e) for e in np.eye(3)]).T
            rot[f.child] = rot[f.parent] @ Rl
            pos[f.child] = pos[f.parent] + rot[f.parent] @ np.array(t)
            moved[f.child] = moved[f.parent] + ((f.joint,) if f.joint in at else ())
            if f.joint in at:
                axes[f.joint] = (rot[f.child] @ np.array(f.axis), pos[f.child], f.slides)
        return rot, pos, moved, axes


def _surface(end: Vector, radius: float) -> Matrix:
    z = end / np.linalg.norm(end)
    a = np.cross(z, np.eye(3)[np.argmin(np.abs(z))]); a /= np.linalg.norm(a)
    b = np.cross(z, a)
    phi = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.outer(np.cos(phi), a) + np.outer(np.sin(phi), b)
    n = _ALONG
    return np.concatenate([s * end + radius * ring for s in np.linspace(0.05, 1.0, n)])
