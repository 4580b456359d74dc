"""Each pre-arm check fails by name for its reason, and passes again when it is over."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.faults.table import Condition
from daemon.protocol.messages import Check
from daemon.tick.arming_checks import CHECK_OF, NAMES, Verdict
from daemon.tick.record import Wakeup
from drivers.cia402 import DriveState
from drivers.events import Emergency, Rebooted


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(SINGLE_JOINT) as made:
        made.enable()
        yield made


@pytest.fixture(scope="module")
def calm() -> Iterator[Rig]:
    """For tests that leave it as it was."""
    with lockstep_rig(SINGLE_JOINT) as made:
        made.enable()
        yield made


def checks(rig: Rig) -> dict[str, Check]:
    return {check.name: check for check in rig.tick.checks()}


def failed(rig: Rig) -> list[str]:
    return [name for name, check in checks(rig).items() if not check.passed]


def objections(rig: Rig) -> set[str]:
    """Of the last samples, as they are now."""
    samples, estimate = rig.samples, rig.estimate
    return {o.check for o in rig.tick.prearm.objections(samples, estimate, (), (), ())}


def watched(rig: Rig, *events: object) -> None:
    """As if these had come in the last tick; the supervisor has dealt with them since."""
    samples = rig.samples
    rig.tick.prearm.watch(replace(samples, events=events), (), rig.time_s)
    rig.step()


def test_at_rest_every_check_passes_and_says_why(calm: Rig) -> None:
    found = checks(calm)
    assert list(found) == ["mode", *NAMES]
    assert failed(calm) == []
    assert all(check.text for check in found.values())
    assert found["mode"].text == "holding"
    assert found["drives"].text == "1 of 1 in operation, none in fault"
    assert found["residual"].text.endswith("Nm (joint)")
    assert str(found["emergencies"]) == "passed  emergencies     none"


def test_before_the_first_samples() -> None:
    with lockstep_rig(SINGLE_JOINT) as fresh:
        assert [str(check) for check in fresh.tick.checks()] == [
            "failed  mode            no samples of the drives yet"
        ]


def test_off_only_the_mode_is_wrong() -> None:
    with lockstep_rig(SINGLE_JOINT) as off:
        off.run(0.3)
        assert failed(off) == ["mode"]


def touch(rig: Rig) -> None:
    rig.arm.external_torque[0] = 2.0


def fault(rig: Rig) -> None:
    rig.arm.drives[0].fault(0x2310, "injected by the test")


def late(rig: Rig) -> None:
    rig.tick.begin(rig.time_s)
    rig.lockstep.pump()
    rig.tick.finish(0.0, Wakeup(lateness_s=0.015, left_out=1))
    rig.ticks += 1


def often_late(rig: Rig) -> None:
    for _ in range(3):
        late(rig)
        rig.run(0.1)


@pytest.mark.parametrize(
    ("disturb", "names", "words"),
    [
        (touch, {"residual"}, "joint feels"),
        (fault, {"mode", "drives", "emergencies"}, "emergency of node 1 (joint): 0x2310"),
        (often_late, {"loop"}, "3 ticks were late"),
    ],
)
def test_what_goes_wrong_fails_by_name(
    rig: Rig, disturb: Callable[[Rig], None], names: set[str], words: str
) -> None:
    disturb(rig)
    rig.run(0.05)
    assert names <= set(failed(rig))
    assert any(words in check.text for check in checks(rig).values() if not check.passed)
    assert rig.tick.controller.arm("the test")


def test_now_and_then_a_tick_may_be_late(rig: Rig) -> None:
    for _ in range(4):
        late(rig)
        assert failed(rig) == []  # nor in the tick itself
        rig.run(0.52)


def test_a_loop_that_is_often_late_is_on_time_again_after_a_second(rig: Rig) -> None:
    often_late(rig)
    assert failed(rig) == ["loop"]
    assert checks(rig)["loop"].text == "3 ticks were late in the last 0.3 s"
    rig.run(0.6)
    assert failed(rig) == ["loop"]
    rig.run(0.2)
    assert failed(rig) == []


def test_an_emergency_lasts_until_the_drive_takes_it_back(calm: Rig) -> None:
    watched(calm, Emergency(1, 0x4210, 8))
    assert failed(calm) == ["emergencies"]
    text = checks(calm)["emergencies"].text
    assert text.startswith("emergency of node 1 (joint): 0x4210 (over-temperature")
    assert text.endswith("and not over")
    watched(calm, Emergency(1, 0, 0))
    assert failed(calm) == []


def test_an_emergency_is_over_when_the_drive_restarts(calm: Rig) -> None:
    watched(calm, Emergency(1, 0x3220, 5))
    assert failed(calm) == ["emergencies"]
    watched(calm, Rebooted(1))
    assert failed(calm) == []
    watched(calm, Rebooted(1), Emergency(1, 0x3220, 5))
    assert failed(calm) == ["emergencies"]
    calm.tick.prearm.renewed([1])  # another joint's
    assert failed(calm) == ["emergencies"]
    calm.tick.prearm.renewed([0])
    assert failed(calm) == []


def test_an_emergency_after_one_that_was_taken_back_counts(calm: Rig) -> None:
    samples = calm.samples
    for state, emergency in (
        (DriveState.FAULT, Emergency(1, 0x2310, 1)),
        (DriveState.OPERATION_ENABLED, Emergency(1, 0, 0)),
    ):
        then = replace(samples, states=(state,), events=(emergency,))
        calm.tick.prearm.watch(then, (), calm.time_s)
    watched(calm, Emergency(1, 0x4210, 8))  # of a drive that goes on
    assert failed(calm) == ["emergencies"]
    watched(calm, Emergency(1, 0, 0))
    assert failed(calm) == []


def test_a_drive_that_misses_our_heartbeat_fails_heartbeats(calm: Rig) -> None:
    watched(calm, Emergency(1, 0x8130, 16))
    assert failed(calm) == ["heartbeats"]
    watched(calm, Emergency(1, 0, 0))


def test_a_drive_that_left_its_fault_has_no_emergency(calm: Rig) -> None:
    """Although it never said that it was over."""
    samples = calm.samples
    watch, time_s = calm.tick.prearm.watch, calm.time_s
    faulted = replace(samples, states=(DriveState.FAULT,))
    watch(replace(faulted, events=(Emergency(1, 0x2310, 1),)), (), time_s)
    watch(faulted, (), time_s)
    assert "emergencies" in objections(calm)
    watch(replace(samples, states=(DriveState.SWITCH_ON_DISABLED,)), (), time_s)
    assert "emergencies" not in objections(calm)


def test_a_restarted_drive_must_be_set_up_again_and_then_may_be_armed(rig: Rig) -> None:
    rig.arm.drives[0].boot()
    rig.run(0.3)  # long after the tick in which that was news
    assert "set-up" in failed(rig)
    text = checks(rig)["set-up"].text
    assert text.startswith("restarted, and without their set-up: joint")
    assert "contactctl reset" in text
    assert text in rig.tick.controller.not_armable()
    rig.tick.drives.start(rig.time_s)  # as after setting it up again
    rig.step()
    assert "set-up" not in failed(rig)


def test_a_missing_heartbeat(calm: Rig) -> None:
    arm, samples, estimate = calm.tick.drives, calm.samples, calm.estimate
    assert arm.silent() == ()
    for flag, unheard in (("lost", True), ("operational", False)):
        setattr(arm._drives[0].watch, flag, unheard)
        found = calm.tick.prearm.objections(samples, estimate, (), arm.silent(), ())
        assert [(o.check, o.reason) for o in found] == [("heartbeats", "not heard from joint")]
        setattr(arm._drives[0].watch, flag, not unheard)


def test_the_identification_is_somebody_elses_verdict(calm: Rig) -> None:
    calm.tick.prearm.identification = Verdict(False, "identified.yaml is of other drives")
    calm.step()
    assert failed(calm) == ["identification"]
    assert calm.tick.controller.arm("the test") == ["identified.yaml is of other drives"]
    calm.tick.prearm.identification = Verdict(True, "identified.yaml of 2026-11-20")
    calm.step()
    assert checks(calm)["identification"].text == "identified.yaml of 2026-11-20"
    assert failed(calm) == []


def test_a_joint_outside_its_limits(calm: Rig) -> None:
    prearm, samples, estimate = calm.tick.prearm, calm.samples, calm.estimate
    for q, inside in ((1.4, True), (1.449, True), (1.451, False), (-1.451, False)):
        there = replace(samples, link_position=np.array([q]))
        found = prearm.objections(there, estimate, (), (), ())
        assert [objection.check for objection in found] == ([] if inside else ["limits"])


def test_every_finding_has_a_check() -> None:
    assert set(CHECK_OF.values()) <= set(NAMES)
    assert set(CHECK_OF) <= set(Condition)
