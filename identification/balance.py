"""Pose in which gravity changes side at a joint: there its link meets both borders of its gap."""

import itertools

import numpy as np

from common.arrays import Vector
from estimator.model import Model

_GRID = 61  # poses of the joint itself
_OTHERS = 9  # of one other joint
_UPRIGHT = 2.0  # [rad] further one goes for a link that hangs than for one that would fall over


def balanced_pose(
    model: Model, joint: int, here: Vector, lower: Vector, upper: Vector, little: float
) -> Vector | None:
    """The pose (n,) [rad] nearest to `here` in which gravity changes side at `joint`, by moving it
    alone or with one other joint; `here` itself, within lower and upper (n,), where gravity never
    exceeds `little` [Nm] at the joint. None where there is no such pose."""
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
    """Positions of the joint, and gravity there [Nm], the others as in `pose`."""
    at, turned = np.linspace(lower, upper, _GRID), pose.copy()
    values = []
    for q in at:
        turned[joint] = q
        values.append(float(model.gravity(turned)[joint]))
    return at, np.array(values)


def _crossings(
    joint: int, pose: Vector, here: Vector, at: Vector, g: Vector
) -> list[tuple[float, Vector]]:
    """Poses in which g passes zero, each with how far it is, in radians, or seems."""
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
