"""Smallest detected touch, in words."""

import msgspec
import pytest

from daemon.protocol.replies import Sensitivity, ToolForce
from programs.clients.sensitivity import along, sensitivity_lines


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ([1.0, 0.0, 0.0], "x"),
        ([0.0, -1.0, 0.0], "y"),
        ([0.1, 0.1, 0.99], "z"),
        ([-0.6, 0.03, -0.8], "(0.6 0.0 0.8)"),
    ],
)
def test_directions(direction: list[float], words: str) -> None:
    assert along(direction) == words


def smallest(*undetected: list[float]) -> Sensitivity:
    force = ToolForce(
        least_N=2.0, least_along=[1.0, 0.0, 0.0], most_N=5.0, most_along=[0.0, 0.6, 0.8],
        undetected=list(undetected),
    )  # fmt: skip
    return Sensitivity(
        joints=["a", "shoulder"], tool="the origin of tool0", moving=[0.5, 1.0],
        resting=[0.75, 12.0], tool_moving=force, tool_resting=force,
    )  # fmt: skip


def test_the_table() -> None:
    best, worst = "2.0 N at best, along x", "5.0 N at worst, along (0.0 0.6"
    assert sensitivity_lines(smallest()) == [
        "smallest touch  in motion    at rest",
        "a                 0.50 Nm    0.75 Nm",
        "shoulder          1.00 Nm   12.00 Nm",
        "in motion: all joints at their velocity limits",
        "at the origin of tool0, in this pose, by direction along x, y, z of the base:",
        f"  in motion  {best}; {worst} 0.8)",
        f"  at rest    {best}; {worst} 0.8)",
    ]


def test_a_joint_that_does_not_sense_detects_nothing() -> None:
    lines = sensitivity_lines(
        msgspec.structs.replace(smallest(), moving=[None, 1.0], resting=[None, 12.0])
    )
    assert lines[1:3] == [
        "a                 nothing    nothing",
        "shoulder          1.00 Nm   12.00 Nm",
    ]


def test_directions_without_detection_are_named() -> None:
    x, y, z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    last = [sensitivity_lines(smallest(*axes))[-1] for axes in ([z], [y, z], [x, y, z])]
    assert last[0].endswith("at worst, along (0.0 0.6 0.8); not detected along z")
    assert last[1].endswith("at best, along x; not detected along y and z")
    assert last[2] == "  at rest    not detected along x and y and z"
