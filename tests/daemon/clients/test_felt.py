"""What the arm feels, in words."""

import msgspec
import pytest

from daemon.clients.felt import along, felt_lines
from daemon.protocol.messages import Felt, ToolForce


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


def felt(*unfelt: list[float]) -> Felt:
    force = ToolForce(
        least_N=2.0, least_along=[1.0, 0.0, 0.0], most_N=5.0, most_along=[0.0, 0.6, 0.8],
        unfelt=list(unfelt),
    )  # fmt: skip
    return Felt(
        joints=["a", "shoulder"], tool="the origin of tool0", moving=[0.5, 1.0],
        resting=[0.75, 12.0], tool_moving=force, tool_resting=force,
    )  # fmt: skip


def test_the_table() -> None:
    best, worst = "2.0 N where it feels best, along x", "5.0 N where it feels worst, along (0.0 0.6"
    assert felt_lines(felt()) == [
        "feels from  in motion    at rest",
        "a             0.50 Nm    0.75 Nm",
        "shoulder      1.00 Nm   12.00 Nm",
        "in motion: all joints at their velocity limits",
        "at the origin of tool0, in this pose, by direction along x, y, z of the base:",
        f"  in motion  {best}; {worst} 0.8)",
        f"  at rest    {best}; {worst} 0.8)",
    ]


def test_a_joint_that_does_not_sense_feels_nothing() -> None:
    lines = felt_lines(msgspec.structs.replace(felt(), moving=[None, 1.0], resting=[None, 12.0]))
    assert lines[1:3] == [
        "a             nothing    nothing",
        "shoulder      1.00 Nm   12.00 Nm",
    ]


def test_what_is_not_felt_is_said() -> None:
    x, y, z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]
    assert felt_lines(felt(z))[-1].endswith("worst, along (0.0 0.6 0.8); not felt along z")
    assert felt_lines(felt(y, z))[-1].endswith("best, along x; not felt along y and z")
    assert felt_lines(felt(x, y, z))[-1] == "  at rest    not felt along x and y and z"
