"""Payload: a point mass at the hand, part of the model once it is announced."""

from collections.abc import Sequence
from typing import Annotated, Self

import msgspec
from msgspec import Meta

from common.errors import ModelError

HEAVIEST_KG = 100.0
FURTHEST_M = 2.0
"""largest distance from the origin of the hand's frame along each axis [m]"""
THINNEST_M = 0.001

Mass = Annotated[float, Meta(gt=0, le=HEAVIEST_KG)]
Coordinate = Annotated[float, Meta(ge=-FURTHEST_M, le=FURTHEST_M)]
Edge = Annotated[float, Meta(ge=THINNEST_M, le=FURTHEST_M)]


class Payload(msgspec.Struct, frozen=True, kw_only=True):
    """Mass at the hand, modelled as a point. Bounds are checked by its decoder, and by `of`."""

    mass: Mass  # [kg]
    # its centre in the frame of the hand, the URDF's last link [m]
    com: Annotated[list[Coordinate], Meta(min_length=3, max_length=3)]
    name: str = ""  # in the configuration
    # edges of its bounding box about that centre, along the axes of the hand [m]
    box: Annotated[list[Edge], Meta(min_length=3, max_length=3)] | None = None

    @classmethod
    def of(
        cls, mass: float, com: Sequence[float], name: str = "", box: Sequence[float] | None = None
    ) -> Self:
        """Payload with these values. Raises ModelError for an invalid mass, a place far from the
        hand, or an invalid box."""
        if not 0.0 < mass <= HEAVIEST_KG:  # nor NaN
            raise ModelError(f"a payload of {mass:g} kg: must be above 0, up to {HEAVIEST_KG:g} kg")
        if len(com) != 3 or not all(abs(x) <= FURTHEST_M for x in com):
            where = " ".join(f"{x:g}" for x in com)
            raise ModelError(
                f"centre of the payload ({where}) m: must be three numbers, each within "
                f"{FURTHEST_M:g} m of the origin of the hand's frame"
            )
        if box and (len(box) != 3 or not all(THINNEST_M <= x <= FURTHEST_M for x in box)):
            edges = " ".join(f"{x:g}" for x in box)
            raise ModelError(
                f"box of the payload ({edges}) m: must be three edges of {THINNEST_M:g} to "
                f"{FURTHEST_M:g} m"
            )
        return cls(mass=mass, com=list(com), name=name, box=list(box) if box else None)

    def __str__(self) -> str:
        name = f"{self.name}: " if self.name else ""
        box = f", {' x '.join(f'{x:g}' for x in self.box)} m," if self.box else ""
        return f"{name}{self.mass:.3g} kg{box} at ({' '.join(f'{x:.3f}' for x in self.com)}) m"
