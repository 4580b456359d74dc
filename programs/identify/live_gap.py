"""Gap measurement on one joint of a live arm, by strokes of its motor or by hand."""

from contextlib import suppress
from typing import Any

from rich.live import Live

from daemon.protocol.state import State
from identification.gap_search import Strokes
from identification.motion_log import MotionLog
from programs.identify.contact_warnings import ends_strokes, other_joint_touched
from programs.identify.hand import Hand
from programs.identify.live_arm import LiveArm
from programs.identify.live_strokes import StrokesOfJoint, UnobservableError, searched
from programs.identify.measured import Measured
from programs.identify.motions import HAND_S, stand
from programs.identify.session import distrust
from programs.identify.show import histogram

_HEAVY = 1.0  # largest gravity torque that a hand can lift gently [Nm]


def gap_by_strokes(arm: LiveArm, joint: str) -> Measured:
    """Move the motor of one joint to and fro where gravity changes sign. Raises UnobservableError
    if there is no such pose, and as `Session.run` does."""
    step, i = f"strokes-{joint}", arm.configuration.joint_names.index(joint)
    here = arm.link_position()
    own = StrokesOfJoint.of(arm.configuration, arm.model, i, here)
    arm.show(own.announcement())
    how: dict[str, Any] = {
        "warning": ends_strokes(joint),
        "touch_ends": True,
        "to_go_on": f"The same command starts {joint} afresh",
    }

    def record(asked: Strokes) -> MotionLog:
        here = arm.link_position()
        if (path := own.way_to(here, asked)) is not None:
            arm.move(f"way-{joint}", f"{joint} goes to {asked.about:z.2f} rad", path, **how)
            arm.forget(f"way-{joint}")
        arm.forget(step)
        here = arm.link_position()
        text = f"{joint} moves by {1e3 * asked.travel:.0f} mrad"
        arm.move(step, text, own.path(here, asked), motors_only=True, **how)
        return arm.read(step, gap_of=joint).log

    searched(own.begin(), record)
    return arm.read(step, gap_of=joint)


def gap_by_hand(arm: LiveArm, joint: str) -> Measured:
    """Hold the motor of one joint while a person moves its link. Raises as `Session.run` does."""
    step, i = f"gap-{joint}", arm.configuration.joint_names.index(joint)
    before = arm.before(step)
    _move_to_unloaded(arm, joint, i)
    here = arm.link_position(motors_only=True)
    arm.show(
        f"The motor of {joint} stands still. Move its link gently by hand from side to side: lean "
        "on one edge of the gap, rest a moment, then lean as hard on the other."
    )
    load = float(arm.model.gravity(here)[i])
    if abs(load) > _HEAVY:
        arm.show(
            f"In this pose {abs(load):.1f} Nm of gravity hold it at one edge: carry it, or start "
            "from a pose in which the joint hangs."
        )
    hand = Hand(i, arm.configuration.joints[i].torque_constant, joint, before)
    with Live(console=arm.console, auto_refresh=False) as live:

        def each(state: State) -> bool:
            if hand.add(state):
                live.update(histogram(hand.phi, hand.gap), refresh=True)
            return hand.done

        path, warning = stand(here), other_joint_touched(joint)
        arm.session.run(step, path, HAND_S, each, warning=warning, motors_only=True)
    if not arm.console.is_terminal:
        arm.console.line()  # `Live` does not end its last line in a file
    return arm.read(step, gap_of=joint)


def _move_to_unloaded(arm: LiveArm, joint: str, i: int) -> None:
    """Move to a pose without gravity load on the joint, if there is one. Stays if a person enabled
    the arm, and so chose the pose, or if link positions are not trusted."""
    here = arm.link_position(motors_only=True)
    if arm.session.here is None or distrust(arm.session.client.ask_status()):
        return
    with suppress(UnobservableError):
        own = StrokesOfJoint.of(arm.configuration, arm.model, i, here)
        if own.weighs:
            text = f"{joint} goes to where it hangs"
            how: dict[str, Any] = {"warning": ends_strokes(joint), "touch_ends": True}
            arm.move(f"way-{joint}", text, own.way_to_pose(), to_go_on="", **how)
            arm.forget(f"way-{joint}")
