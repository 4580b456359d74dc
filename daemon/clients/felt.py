"""Touches that the arm feels, in words for a person: a table of the joints, and the tool."""

from collections.abc import Sequence

from daemon.protocol.messages import Felt, ToolForce

AXES = "xyz"
_ALONG_AN_AXIS = 0.98  # cosine of 11 degrees


def felt_lines(felt: Felt) -> list[str]:
    """What the arm feels at least, joint by joint and at the tool, in motion and at rest."""
    width = max(len(name) for name in (*felt.joints, "feels from"))
    lines = [f"{'feels from':{width}}  in motion    at rest"]
    for name, moving, resting in zip(felt.joints, felt.moving, felt.resting, strict=True):
        lines.append(f"{name:{width}}  {_level(moving)}  {_level(resting)}")
    return [
        *lines,
        "in motion: all joints at their velocity limits",
        f"at {felt.tool}, in this pose, by direction along x, y, z of the base:",
        f"  in motion  {_in_words(felt.tool_moving)}",
        f"  at rest    {_in_words(felt.tool_resting)}",
    ]


def _level(level: float | None) -> str:
    return "  nothing" if level is None else f"{level:6.2f} Nm"


def _in_words(force: ToolForce) -> str:
    parts = []
    if len(force.unfelt) < len(AXES):
        parts.append(f"{force.least_N:.1f} N where it feels best, along {along(force.least_along)}")
    if len(force.unfelt) < len(AXES) - 1:
        parts.append(f"{force.most_N:.1f} N where it feels worst, along {along(force.most_along)}")
    if force.unfelt:
        parts.append(f"not felt along {' and '.join(map(along, force.unfelt))}")
    return "; ".join(parts)


def along(direction: Sequence[float]) -> str:
    """A direction in words: the axis of the base that it follows, or its three components."""
    for axis, part in zip(AXES, direction, strict=True):
        if abs(part) > _ALONG_AN_AXIS:
            return axis
    sign = -1.0 if max(direction, key=abs) < 0.0 else 1.0  # either way is as good
    return "(" + " ".join(f"{round(sign * part, 1) + 0.0:.1f}" for part in direction) + ")"
