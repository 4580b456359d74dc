"""A drive that presses too softly, distinguished from one that hears nothing."""

from types import SimpleNamespace
from typing import cast

import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from daemon.config.load import load_robot
from daemon.protocol.state import State
from programs.identify.velocity_loop import REMEMBERED, advice_on_following

C = load_robot(SINGLE_JOINT).configuration
MOST_A = C.joints[0].wiring.max_current_A
SPEED = C.joints[0].limits.velocity


def said(off: float, pressed: float, ended: str = "drive does not follow: joint (by") -> str:
    """Output for a motor that stands at a setpoint `off` [of the velocity limit], while its
    current goes evenly by `pressed` [of the current limit]."""
    last = [
        SimpleNamespace(setpoint=[off * SPEED], motor_velocity=[0.0],
                        current=[-0.1 + pressed * MOST_A * k / REMEMBERED])
        for k in range(REMEMBERED)
    ]  # fmt: skip
    return advice_on_following(f"the arm is faulted: {ended}", cast(list[State], last), C)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_drive_that_presses_softly_the_right_way_wants_a_larger_margin(way: float) -> None:
    text = said(0.42 * way, 0.05 * way)
    assert text.startswith(". joint: its velocity loop is too soft: raise its gains")
    assert "set supervisor.following_margin to 0.7 (it is 0.2)" in text


@pytest.mark.parametrize(
    ("off", "pressed"), [(0.42, 0.0), (0.42, -0.05), (-0.42, 0.05), (0.42, 0.01)]
)
def test_a_drive_whose_current_stays_or_goes_the_other_way_may_be_deaf(
    off: float, pressed: float
) -> None:
    assert said(off, pressed) == ""


def test_no_margin_is_stated_with_which_no_drive_looks() -> None:
    text = said(0.9, 0.05)
    assert "its velocity loop is too soft" in text
    assert "following_margin" not in text


def test_other_ends_are_left_alone() -> None:
    assert said(0.42, 0.05, "drive does not follow: elbow (by") == ""
    assert said(0.42, 0.05, "too fast: joint") == ""
