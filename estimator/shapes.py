"""Shapes of an arm's links and of their surroundings, as `walls` takes them."""

from dataclasses import dataclass

from common.arrays import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """Everything within `radius` [m] of the segment from start to end, each (3,) [m] in the frame
    of body number `body`; -1: in the root frame, which is at rest."""

    name: str
    body: int
    start: Vector
    end: Vector
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Boundary of free space: points with normal . x > offset [m] are free."""

    name: str
    normal: Vector
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Box with centre (3,) [m], axes (3, 3) in columns, and half edges (3,) [m]."""

    name: str
    centre: Vector
    axes: Matrix
    half: Vector
