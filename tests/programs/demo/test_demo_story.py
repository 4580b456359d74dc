"""Checks of the demonstration: a story that went wrong must not pass."""

import re

import msgspec
import pytest
from rich.text import Text

from bench.rigs.lockstep import OPENARM, ROMEO, lockstep_rig
from daemon.assembly import check_identification
from daemon.config.load import load_robot
from daemon.modes.table import Event
from daemon.protocol.state import STATE_FORMAT, Notice, Snapshot
from programs.demo.demo import HAND as DEMO_HAND
from programs.demo.demo import verdict
from programs.demo.demo_story import RunFigures, Touch, touch_of
from programs.simulate.simulated_robot import true_arm
from simulator.hand_script import Guide, Push, Release, read_script

HAND = (
    Push(at_s=2.0, joint="LShoulderPitch", torque=-2.5, duration_s=0.4, shape="ramp"),
    Guide(at_s=2.4, to={"LShoulderPitch": 1.0}, speed=0.25),
    Release(at_s=5.0),
)


@pytest.fixture(scope="module")
def played():
    """The third experiment in lockstep: (states, touch), on the ticks' clock."""
    return play(HAND, 9.0)


def play(hand, seconds, **how):
    events = []
    with lockstep_rig(hand=hand, on_event=events.append, **how) as rig:
        rig.enable()
        rig.run(1.0)
        assert not rig.permit("the test")
        rig.request(Event.START)
        states = rig.states(seconds)
        offset = rig.time_s - rig.arm.now
    lines = [{"monotonic_s": e.at_s + offset, "kind": e.kind, "text": e.text} for e in events]
    clocked = [
        msgspec.structs.replace(s, timing=msgspec.structs.replace(s.timing, monotonic_s=s.time_s))
        for s in states
    ]
    return clocked, touch_of(lines, hand)


def story_of(states, touch, folder=ROMEO):
    configuration = load_robot(folder).configuration
    snapshot = Snapshot(
        format=STATE_FORMAT,
        joints=configuration.joint_names,
        half_gap=[],
        thresholds=[],
        period_s=configuration.period_s,
        tick=0,
        memory={},
        configuration="",
        urdf="",
        program="",
    )
    return RunFigures(configuration, snapshot, states, touch)


def test_the_complete_story_passes(played):
    story = story_of(*played)
    assert [c.what for c in story.checks() if not c.happened] == []
    (figure,) = (c.figure for c in story.checks() if c.what == "no false contact")
    assert re.fullmatch(
        r"0 with this residual, \d+ with the classical one without backlash", figure
    )
    report = story.report(ended_well=True)
    assert report["pass"]
    assert 2.0 - 1e-9 <= report["quiet_s"] <= 2.02
    assert report["contacts"][0]["joint"] == "LShoulderPitch"


def test_no_force_is_reported_without_a_press(played):
    assert story_of(*played).force("l_wrist") == ""


def test_the_story_happens_on_damiao_motors_with_their_guardian():
    how = {"folder": OPENARM, "identification": check_identification,
           "described": lambda robot, _: true_arm(robot)[0]}  # fmt: skip
    story = story_of(*play(read_script(OPENARM / DEMO_HAND), 16.0, **how), OPENARM)
    assert [c.what for c in story.checks() if not c.happened] == []
    report = story.report(ended_well=True)
    assert report["force_N"] == (-12.0, 0.0, 0.0)
    assert report["wrench"]["force"] == pytest.approx([-12.0, 0.0, 0.0], abs=1.5)
    assert story.force("link7").startswith("the hand pushed with 12 N, towards -x of link7; ")


def without_admittance(states, touch):
    return [msgspec.structs.replace(s, mode="tracking") for s in states], touch


def with_a_jump(states, touch):
    last = [s.mode for s in states].index("admittance")
    resume = next(i for i in range(last, len(states)) if states[i].mode == "tracking")
    jump = [x + 0.2 for x in states[resume].setpoint]
    changed = msgspec.structs.replace(states[resume], setpoint=jump)
    return [*states[:resume], changed, *states[resume + 1 :]], touch


def untouched(states, touch):
    return states, None


def with_a_false_contact(states, touch):
    early = [s.residual for s in states][20]
    changed = msgspec.structs.replace(states[20], residual=[9.0, *early[1:]])
    return [*states[:20], changed, *states[21:]], touch


def faulted(states, touch):
    return [*states[:-1], msgspec.structs.replace(states[-1], mode="faulted")], touch


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (without_admittance, "the arm tracked, yielded, and tracked again"),
        (with_a_jump, "it continued without a jump"),
        (untouched, "the push was detected"),
        (with_a_false_contact, "no false contact"),
        (faulted, "no fault was latched"),
    ],
)
def test_a_story_that_went_wrong_fails(played, spoil, what):
    story = story_of(*spoil(*played))
    assert what in [c.what for c in story.checks() if not c.happened]
    assert not story.report(ended_well=True)["pass"]


def test_a_fault_that_was_not_latched_is_named(played):
    states, touch = played
    late = Notice(kind="fault", text="too many late ticks (51 ms late)")
    changed = msgspec.structs.replace(states[20], notices=[late])
    *_, check = story_of([*states[:20], changed, *states[21:]], touch).checks()
    assert (check.happened, check.figure) == (True, late.text)


def test_an_arm_left_in_disorder_fails(played):
    assert not story_of(*played).report(ended_well=False)["pass"]


def test_touch_needs_a_begin_and_a_release():
    begin = {"monotonic_s": 1.0, "kind": "hand", "text": "begin push x 1 Nm"}
    end = {"monotonic_s": 3.0, "kind": "hand", "text": "begin release"}
    assert touch_of([begin, end]) == Touch(1.0, 3.0)
    assert touch_of([begin]) is None
    assert touch_of([{**end, "kind": "drive"}]) is None


@pytest.mark.parametrize(
    ("passed", "missed", "says"),
    [
        (True, 3, "all as expected"),
        (False, 0, "it failed"),
        (False, 6, "it failed: this computer was too busy, 6 deadlines were missed; try again"),
    ],
)
def test_missed_ticks_of_the_machine_are_reported(passed: bool, missed: int, says: str) -> None:
    assert Text.from_markup(verdict(passed, missed)).plain == says
