"""Words on the smallest detectable contacts: a table of the joints, and the tool."""

from collections.abc import Sequence

from daemon.protocol.replies import Sensitivity, ToolForce

AXES = "xyz"
_ALONG_AN_AXIS = 0.98  # cosine of 11 degrees


def sensitivity_lines(smallest: Sensitivity) -> list[str]:
    """Lines on the smallest detectable contact of each joint and at the tool, in motion and at
    rest."""
    width = max(len(name) for name in (*smallest.joints, "smallest touch"))
    lines = [f"{'smallest touch':{width}}  in motion    at rest"]
    for name, moving, resting in zip(
        smallest.joints, smallest.moving, smallest.resting, strict=True
    ):
        lines.append(f"{name:{width}}  {_level(moving)}  {_level(resting)}")
    return [
        *lines,
        "in motion: all joints at their velocity limits",
        f"at {smallest.tool}, in this pose, by direction along x, y, z of the base:",
        f"  in motion  {_in_words(smallest.tool_moving)}",
        f"  at rest    {_in_words(smallest.tool_resting)}",
    ]


def _level(level: float | None) -> str:
    return "  nothing" if level is None else f"{level:6.2f} Nm"


def _in_words(force: ToolForce) -> str:
    parts = []
    if len(force.undetected) < len(AXES):
        parts.append(f"{force.least_N:.1f} N at best, along {along(force.least_along)}")
    if len(force.undetected) < len(AXES) - 1:
        parts.append(f"{force.most_N:.1f} N at worst, along {along(force.most_along)}")
    if force.undetected:
        parts.append(f"not detected along {' and '.join(map(along, force.undetected))}")
    return "; ".join(parts)


def along(direction: Sequence[float]) -> str:
    """Direction in words: the base axis that it nearly follows, or its three components."""
    for axis, part in zip(AXES, direction, strict=True):
        if abs(part) > _ALONG_AN_AXIS:
            return axis
    sign = -1.0 if max(direction, key=abs) < 0.0 else 1.0  # both signs mean the same
    return "(" + " ".join(f"{round(sign * part, 1) + 0.0:.1f}" for part in direction) + ")"
