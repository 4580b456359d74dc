"""Shapes of an arm's links and of their surroundings, as walls take them."""

from dataclasses import dataclass

from common.arrays import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """All that is within `radius` [m] of the segment from start to end, each (3,) [m] in the frame
    of body number `body`; -1: in that of the root, which stands."""

    name: str
    body: int
    start: Vector
    end: Vector
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Border of the half of space that is free: normal . x > offset [m]."""

    name: str
    normal: Vector
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Box: its centre (3,) [m], axes (3, 3) in columns, and half of its edges (3,) [m]."""

    name: str
    centre: Vector
    axes: Matrix
    half: Vector
