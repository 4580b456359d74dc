"""Refusals of each mode, their reason, and what a refusal advises."""

from itertools import product

import numpy as np
import pytest

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.modes.contact_reactions import AfterQuiet, ContactReaction, Reactions
from daemon.modes.table import ADVICE, TRANSITIONS, Event, Mode, refusal
from daemon.motion.limits import Limits
from daemon.tick.decision import ControlInput
from daemon.tick.refusals import not_energisable
from tests.ideal_arm import OFF, ON, IdealArm, T, holding_arm, ideal_arm

COMMANDS = ("enable", "start", "pause", "stop", "disarm", "disable", "reset")


@pytest.fixture
def holding() -> IdealArm:
    return holding_arm()


def arm_in(mode: Mode) -> IdealArm:
    """Arm that commands and contacts have brought into the mode."""
    letting_go = mode is Mode.RELEASING
    collision = ContactReaction.RELEASE if letting_go else ContactReaction.RETRACT
    reactions = Reactions(ContactReaction.ADMITTANCE, collision)
    arm = ideal_arm(reactions=reactions, after_quiet=AfterQuiet.RETURN)
    arm.step()
    if mode is Mode.OFF:
        return arm
    arm.request(Event.ENABLE)
    if mode is Mode.ENABLING:
        arm.step(drives=(ON, OFF))
        return arm
    arm.step()
    if mode is Mode.HOLDING:
        return arm
    arm.request(Event.START)
    arm.run(1.5)
    assert arm.controller.arm("me") == []
    if mode is Mode.STOPPING:
        arm.request(Event.PAUSE)
    elif mode is Mode.FAULTED:
        arm.step(findings=(Finding(Condition.DRIVE_FAULT, "b"),))
    elif mode in (Mode.RETRACTING, Mode.RELEASING):
        arm.hit()
    elif mode is not Mode.TRACKING:
        arm.touch(0.6)
        if mode is Mode.RETURNING:
            arm.run(0.5, **arm.push(0.6))
            arm.run_until(mode)
    return arm


@pytest.mark.parametrize(("mode", "command"), list(product(Mode, COMMANDS)))
def test_every_command_in_every_mode(mode: Mode, command: str) -> None:
    """Follows its row of the table, or is refused with what to do about it and changes nothing."""
    arm, event = arm_in(mode), Event(command)
    assert arm.mode is mode
    armed, moving = arm.armed, arm.controller.machine.moving
    reasons = arm.request(event)
    if after := TRANSITIONS.get((mode, event)):
        assert reasons == []
        assert arm.mode is after
    else:
        assert reasons == [f"cannot {command}: {refusal(mode, command)}"]
        assert arm.mode is mode
        assert (arm.armed, arm.controller.machine.moving) == (armed, moving)


@pytest.mark.parametrize(
    ("mode", "command"),
    [(m, c) for m, c in product(Mode, ("start", "arm", "enable", "pause", "disable", "reset"))],
)
def test_advice_is_given_only_where_it_leads_to_what_was_asked(mode: Mode, command: str) -> None:
    """A command that follows the advice of a refusal is not refused in the same way again."""

    def ask() -> list[str]:
        return arm.controller.arm("me") if command == "arm" else arm.request(Event(command))

    arm = arm_in(mode)
    arm.controller.machine.armed = False
    said = " ".join(ask())
    advice = ADVICE.get(mode, "")
    if not advice or advice not in said:
        assert "contactctl" not in said
        return
    words = advice.split("`")[1].removeprefix("contactctl ")
    assert arm.request(Event(words)) == []
    arm.run(1.0)
    assert advice not in " ".join(ask())
    if mode is not Mode.FAULTED:
        assert arm.mode is Mode.TRACKING if command == "start" else arm.armed


@pytest.mark.parametrize(
    ("mode", "command", "said"),
    [
        (Mode.OFF, "start", "the drives are off (`contactctl enable` first)"),
        (Mode.OFF, "pause", "the drives are off"),
        (Mode.OFF, "reset", "no fault is latched"),
        (Mode.HOLDING, "enable", "the arm is holding"),
        (Mode.TRACKING, "enable", "the trajectory is running"),
        (Mode.TRACKING, "start", "the trajectory is running (`contactctl pause` or `stop` first)"),
        (Mode.FAULTED, "disable", "a fault is latched (`contactctl reset` first)"),
    ],
)
def test_a_refusal_in_words(mode: Mode, command: str, said: str) -> None:
    assert arm_in(mode).request(Event(command)) == [f"cannot {command}: {said}"]


@pytest.mark.parametrize("mode", sorted(set(Mode) - {Mode.HOLDING, Mode.TRACKING}))
def test_arming_is_refused_in_every_mode_that_is_not_calm(mode: Mode) -> None:
    arm = arm_in(mode)
    assert refusal(mode, "arm") in arm.controller.arm("another")


def test_start_and_enable_are_refused_with_the_reason(holding: IdealArm) -> None:
    holding.step(q=np.array([0.8, 0.0]))
    assert "from 0.800 rad the path of a would leave" in holding.request(Event.START)[0]
    assert holding.mode is Mode.HOLDING
    off = ideal_arm()
    off.q = np.array([0.0, 1.2])
    off.step()
    assert off.request(Event.ENABLE)[0].startswith("b stands at 1.200 rad, more than 0 outside")
    (reason,) = off.request(Event.START)
    assert reason == "cannot start: the drives are off (`contactctl enable` first)"
    assert off.mode is Mode.OFF


@pytest.mark.parametrize(
    ("condition", "refused"),
    [(Condition.EMERGENCY, True), (Condition.ADAPTER_GONE, True), (Condition.ERROR_PASSIVE, False)],
)
def test_enable_is_refused_during_a_quick_stop_finding(condition: Condition, refused: bool) -> None:
    off = ideal_arm()
    off.step()
    findings = (Finding(condition, "x"),)
    zero = np.zeros(2)
    observed = ControlInput(off.q, zero, zero, zero, "", "", (OFF, OFF), findings)
    off.controller.machine.mode = Mode.FAULTED  # which the finding would lead to
    off.controller.step(off.time_s, T, observed)
    off.controller.machine.mode = Mode.OFF
    reasons = off.request(Event.ENABLE)
    assert reasons == ([f"{condition}: x"] if refused else [])


def test_enable_waits_for_drives_that_are_still_on_their_way_off(holding: IdealArm) -> None:
    """Else they would be taken for enabled at once, and then for drives that dropped out."""
    assert holding.request(Event.DISABLE) == []
    holding.step(drives=(ON, OFF))
    assert holding.request(Event.ENABLE) == ["still switching off: a"]
    assert holding.mode is Mode.OFF
    holding.step()
    assert holding.request(Event.ENABLE) == []


def test_a_joint_that_seems_to_be_where_it_cannot_be_has_a_wrong_scale_or_offset() -> None:
    q = np.array([6.5, 1.7])
    limits = Limits(np.full(2, -1.6), np.full(2, 1.6), np.ones(2), np.ones(2), 0.01)
    seen = ControlInput(q, np.zeros(2), np.zeros(2), np.zeros(2), "", "", (OFF, OFF), ())
    far, near = not_energisable(("a", "b"), ("brake", "brake"), limits, seen)
    assert "check scale and offset of its `link_position` first (`contactd identify zero`)" in far
    assert near.endswith(": release its brake and move it back by hand")
