"""Warnings about a contact while a step of `contactd identify`, or a hand, moves the arm."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from daemon.config.schema import Joint
from daemon.protocol.state import Contact, Notice
from programs.identify.contact_warnings import (
    ContactWarning,
    discarded,
    level_below_friction,
    other_joint_touched,
    wiring_touched,
)
from tests.programs.identify.commissioned_arm import CommissionedArm
from tests.programs.identify.typed_session import TypedCommand, wired_joint


@pytest.fixture
def arm(tmp_path: Path) -> CommissionedArm:
    return wired_joint(tmp_path)


def contact(joint: str) -> Notice:
    about = Contact(joint=joint, torque=-0.35, threshold=0.3, level="contact", side="left")
    return Notice(kind="contact", text=f"{joint} -0.35 Nm (contact)", contact=about)


@pytest.mark.parametrize(
    ("warning", "says"),
    [
        (discarded, "elbow -0.35 Nm (contact): if that was you, hands off; it is discarded"),
        (wiring_touched("wrist"), "elbow -0.35 Nm (contact): if that was you, hands off, and "
                                    "check the wiring of wrist again"),
        (other_joint_touched("wrist"), "contact at elbow, -0.35 Nm: move wrist alone"),
        (other_joint_touched("elbow"), ""),
    ],
)  # fmt: skip
def test_a_contact_is_what_the_step_makes_of_it(warning: ContactWarning, says: str) -> None:
    assert warning(contact("elbow")) == says


def test_a_joint_that_is_touched_again_is_named_once_in_a_motion_of_the_wiring() -> None:
    warning = wiring_touched("wrist")
    said = [bool(warning(contact(joint))) for joint in ("wrist", "wrist", "elbow", "wrist")]
    assert said == [True, False, True, False]


@pytest.mark.parametrize(
    ("rubs", "level"), [(0.4, None), (0.59, None), (0.67, "1.1"), (3.35, "6.5"), (math.nan, None)]
)
def test_friction_that_no_draft_knew_asks_for_a_level(rubs: float, level: str | None) -> None:
    """Half of the level of 0.5 Nm is left to friction beyond 0.35 Nm."""
    joint = SimpleNamespace(
        name="elbow", thresholds=SimpleNamespace(contact=0.5),
        friction=SimpleNamespace(motor_coulomb=0.3, link_coulomb=0.05),
    )  # fmt: skip
    said = level_below_friction(cast(Joint, joint), rubs)
    assert bool(said) is (level is not None)
    assert all(f"thresholds.contact to {level} until" in one for one in said)


def pushed(arm: CommissionedArm, *words: str) -> str:
    """Output of a step that is stopped after a push of half a second, which the daemon felt."""
    with arm.served() as served:
        served.rig.enable()
        typed = TypedCommand(served, *words)
        typed.moves(1.0)
        felt = []
        served.rig.arm.external_torque[0] = 1.5
        while typed.ticks_in_motion < 150:
            typed.tick()
            felt += [event for event in served.rig.last.notices if event.kind == "contact"]
        served.rig.arm.external_torque[0] = 0.0
        typed.ctrl_c()
        said = typed.ends()[1]
    assert felt
    assert "stopped by you" in said
    return said


def test_a_hand_at_the_link_that_it_is_to_move_gets_no_message(arm: CommissionedArm) -> None:
    said = pushed(arm, "gap", "--by-hand")
    assert "hands off" not in said
    assert "contact at" not in said


@pytest.mark.parametrize(
    ("step", "says"),
    [("wiring", "hands off, and check the wiring of joint again"),
     ("thresholds", "hands off; it is discarded")],
)  # fmt: skip
def test_a_hand_at_an_arm_that_moves_by_itself_learns_what_becomes_of_it(
    arm: CommissionedArm, step: str, says: str
) -> None:
    assert f"if that was you, {says}" in pushed(arm, step)
