"""What is said of a contact while a step of `contactd identify` moves the arm, or a hand does."""

from pathlib import Path

import pytest

from bench.rigs.person import Arm
from bench.rigs.typed_session import Typed, wired_joint
from daemon.identify.session import Told, alone, left_out, spoils_wiring_of
from daemon.protocol.messages import Contact, Notice


@pytest.fixture
def arm(tmp_path: Path) -> Arm:
    return wired_joint(tmp_path)


def contact(joint: str) -> Notice:
    about = Contact(joint=joint, torque=-0.35, threshold=0.3, level="contact", side="left")
    return Notice(kind="contact", text=f"{joint} -0.35 Nm (contact)", contact=about)


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (left_out, "elbow -0.35 Nm (contact): if that was you, hands off; it is discarded"),
        (spoils_wiring_of("wrist"), "elbow -0.35 Nm (contact): if that was you, hands off, and "
                                    "check the wiring of wrist again"),
        (alone("wrist"), "elbow feels -0.35 Nm: move wrist alone"),
        (alone("elbow"), ""),
    ],
)  # fmt: skip
def test_a_contact_is_what_the_step_makes_of_it(told: Told, says: str) -> None:
    assert told(contact("elbow")) == says


def pushed(arm: Arm, *words: str) -> str:
    """What a step says that is stopped after a push of half a second, which the daemon felt."""
    with arm.house() as house:
        house.rig.enable()
        typed = Typed(house, *words)
        typed.moves(1.0)
        felt = []
        house.rig.arm.external_torque[0] = 1.5
        while typed.ticks_in_motion < 150:
            typed.tick()
            felt += [event for event in house.rig.last.notices if event.kind == "contact"]
        house.rig.arm.external_torque[0] = 0.0
        typed.ctrl_c()
        said = typed.ends()[1]
    assert felt
    assert "stopped by you" in said
    return said


def test_a_hand_at_the_link_that_it_is_to_move_is_told_nothing(arm: Arm) -> None:
    said = pushed(arm, "gap")
    assert "hands off" not in said
    assert "feels" not in said


@pytest.mark.parametrize(
    ("step", "says"),
    [
        ("wiring", "hands off, and check the wiring of joint again"),
        ("thresholds", "hands off; it is discarded"),
    ],
)
def test_a_hand_at_an_arm_that_moves_by_itself_is_told_what_becomes_of_it(
    arm: Arm, step: str, says: str
) -> None:
    assert f"if that was you, {says}" in pushed(arm, step)
