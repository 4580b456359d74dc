"""Pose in which gravity changes sign at a joint, so that its link meets both borders of its gap."""

import itertools

import numpy as np

from common.arrays import Vector
from estimator.model import Model

_GRID = 61  # positions of the joint itself
_OTHERS = 9  # positions of each other joint
_UPRIGHT = 2.0  # [rad] of penalty on a pose in which the link would fall over instead of hanging


def balanced_pose(
    model: Model, joint: int, here: Vector, lower: Vector, upper: Vector, little: float
) -> Vector | None:
    """Nearest pose (n,) [rad] to `here` in which gravity changes sign at `joint`, reached by moving
    it alone or with one other joint; `here` itself, clipped to lower and upper (n,), if gravity at
    the joint never exceeds `little` [Nm]. None if there is no such pose."""
    inside = np.minimum(np.maximum(here, lower), upper)
    if lower[joint] >= upper[joint]:
        return None
    poses = [inside]
    for j in range(model.n):
        if j != joint and lower[j] < upper[j]:
            for q in np.linspace(lower[j], upper[j], _OTHERS):
                pose = inside.copy()
                pose[j] = q
                poses.append(pose)
    found: list[tuple[float, Vector]] = []
    for pose in poses:
        g = _gravity(model, joint, pose, lower[joint], upper[joint])
        if pose is inside and float(np.abs(g[1]).max()) <= little:
            return inside
        found += _crossings(joint, pose, here, *g)
    return min(found, key=lambda one: one[0])[1] if found else None


def _gravity(
    model: Model, joint: int, pose: Vector, lower: float, upper: float
) -> tuple[Vector, Vector]:
    """Positions of the joint, and gravity at each [Nm], with the other joints as in `pose`."""
    at, turned = np.linspace(lower, upper, _GRID), pose.copy()
    values = []
    for q in at:
        turned[joint] = q
        values.append(float(model.gravity(turned)[joint]))
    return at, np.array(values)


def _crossings(
    joint: int, pose: Vector, here: Vector, at: Vector, g: Vector
) -> list[tuple[float, Vector]]:
    """Poses in which g crosses zero, each with its distance [rad], including the penalty."""
    found = []
    for (a, b), (before, after) in zip(
        itertools.pairwise(at.tolist()), itertools.pairwise(g.tolist()), strict=True
    ):
        if before * after > 0.0 or before == after:
            continue
        there = pose.copy()
        there[joint] = a - before * (b - a) / (after - before)
        upright = _UPRIGHT if after < before else 0.0
        found.append((float(np.abs(there - here).sum()) + upright, there))
    return found
