"""Guide of an arm that is led by hand, as configuration, requests and Status describe it. Pure."""

from typing import Annotated, Final, Literal, get_args

import msgspec

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
Axes = Annotated[tuple[Axis, ...], msgspec.Meta(max_length=6)]
Frame = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
Redundant = Literal["free", "held"]
AXES: Final[tuple[Axis, ...]] = get_args(Axis)
KINDS: Final = ("free", "damped", "held", "stiff")
"""Kinds of an axis, in the order of their numbers in `daemon.motion.guide`."""
TOOL, BASE = "tool", "base"


class GuideAxes(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """Axes of a guide; those not named are free, and if all are free there is no guide."""

    # the tool in its own axes or (`base`) in those of the URDF's root; or a link, at its origin
    frame: Frame = TOOL
    free: Axes = ()
    damped: Axes = ()  # at a fifth of the speed
    held: Axes = ()
    stiff: Axes = ()  # held, and returned to where the guide began
    redundant: Redundant = "free"  # joint motion that leaves the frame at rest

    @property
    def guides(self) -> bool:
        """True if there is a guide."""
        return bool(self.damped or self.held or self.stiff) or self.redundant == "held"

    def kinds(self) -> list[int]:
        """Kind of each of AXES."""
        of = {axis: k for k, kind in enumerate(KINDS) for axis in getattr(self, kind)}
        return [of.get(axis, 0) for axis in AXES]

    def objections(self, joints: int) -> list[str]:
        """Reasons why these axes cannot guide an arm of this number of joints."""
        named = [axis for kind in KINDS for axis in getattr(self, kind)]
        twice = sorted({axis for axis in named if named.count(axis) > 1})
        found = [f"{', '.join(twice)} named twice: an axis is {' or '.join(KINDS)}"] * bool(twice)
        if self.free and not self.guides:
            found.append("free alone holds nothing: name what is stiff, held or damped")
        if (fixed := len({*self.held, *self.stiff})) >= joints:
            found.append(f"{fixed} directions held leave an arm of {joints} joints none to move in")
        return found

    def __str__(self) -> str:
        if not self.guides:
            return "off"
        named: dict[str, list[str]] = {}
        for axis, kind in sorted(zip(AXES, self.kinds(), strict=True), key=lambda each: each[1]):
            named.setdefault(KINDS[kind], []).append(axis)
        kinds = [f"{kind} {' '.join(axes)}" for kind, axes in named.items()]
        joints = ["redundant joints held"] if self.redundant == "held" else []
        return f"{', '.join([*kinds, *joints])}; frame {self.frame}"
