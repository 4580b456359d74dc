"""Each arming check fails by name for its reason, and passes again when it is over."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.arming.checks import NAMES, SAMPLED, ArmingResult
from daemon.arming.permission import Permission
from daemon.config.schema import Configuration
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.table import TABLE
from daemon.modes.table import Event, Mode
from daemon.protocol.replies import Check
from daemon.protocol.requests import Arm
from daemon.protocol.socket_path import Peer
from daemon.tick.telemetry import Wakeup
from drivers.api import Objection
from drivers.canopen.cia402 import drive_status
from estimator.estimate import Flag


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
    return {check.name: check for check in rig.arming.run(rig.time_s).checks}


def failed(rig: Rig) -> list[str]:
    return failing(rig.arming.run(rig.time_s))


def run(rig: Rig, *, late_s: float = 0.0, **changes: object) -> ArmingResult:
    """On a last tick in which something was otherwise."""
    record = replace(rig.last, **changes)  # type: ignore[arg-type]
    time_s = rig.time_s + late_s
    return rig.arming.judge(record, rig.mode, (), time_s)


def failing(result: ArmingResult) -> list[str]:
    return [check.name for check in result.checks if not check.passed]


def test_every_check_passes_at_rest_with_its_text(calm: Rig) -> None:
    found = checks(calm)
    assert list(found) == ["mode", *NAMES]
    assert failed(calm) == []
    assert all(check.text for check in found.values())
    assert found["mode"].text == "holding"
    assert found["drives"].text == "1 of 1 in operation, none in fault"
    assert found["residual"].text.endswith("Nm (joint)")
    assert str(found["emergencies"]) == "passed  emergencies     none"


def test_a_hand_that_is_below_its_level_at_times_is_not_armed_in_a_good_moment(rig: Rig) -> None:
    touched = structs.replace(rig.estimate, thresholded=np.ones(1))
    rig.tick.recent.step((), touched, rig.time_s)
    found = []
    for _ in range(30):
        rig.run(0.01)
        found.append(failed(rig))
    assert found[:24] == [["residual"]] * 24
    assert found[25:] == [[]] * 5
    rig.tick.recent.step((), touched, rig.time_s)
    rig.run(0.05)
    assert "below its threshold for only 0.0" in checks(rig)["residual"].text


def test_before_the_first_samples() -> None:
    with lockstep_rig(SINGLE_JOINT) as fresh:
        assert [str(check) for check in fresh.arming.run(0.0).checks] == [
            "failed  mode            no samples of the drives yet"
        ]
        assert fresh.permit("the test") == ["no samples of the drives yet"]


def test_off_only_the_mode_is_wrong() -> None:
    with lockstep_rig(SINGLE_JOINT) as off:
        off.run(0.3)
        assert failed(off) == ["mode"]


def test_a_latched_fault_fails_its_check_also_when_nothing_is_found_any_more(calm: Rig) -> None:
    result = calm.arming.judge(calm.last, Mode.FAULTED, (), calm.time_s)
    assert failing(result) == ["mode", "faults"]
    assert len(result.reasons) == 1


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
        (touch, {"residual"}, "residual of joint is"),
        (fault, {"mode", "drives", "emergencies"}, "emergency of node 1 (joint): 0x2310"),
        (often_late, {"loop"}, "3 ticks were late"),
    ],
)
def test_a_disturbance_fails_its_checks_by_name(
    rig: Rig, disturb: Callable[[Rig], None], names: set[str], words: str
) -> None:
    disturb(rig)
    rig.run(0.05)
    assert names <= set(failed(rig))
    assert any(words in check.text for check in checks(rig).values() if not check.passed)
    assert rig.permit("the test")


def test_a_late_tick_every_half_second_fails_no_check(rig: Rig) -> None:
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


def test_no_check_passes_on_samples_of_an_earlier_tick(calm: Rig) -> None:
    old = replace(calm.samples, fresh=np.zeros(1, dtype=np.bool_))
    found = run(calm, samples=old)
    assert set(failing(found)) == SAMPLED
    assert found.reasons == ("unknown: no samples of joint in this tick",)


def test_a_restarted_drive_must_be_set_up_again_and_then_may_be_armed(rig: Rig) -> None:
    rig.arm.drives[0].boot()
    rig.run(0.3)  # long after the tick in which that was news
    assert "set-up" in failed(rig)
    text = checks(rig)["set-up"].text
    assert text == "not set up: joint (`contactctl reset`)"
    assert text in rig.permit("the test")
    rig.drives.start(rig.time_s)  # as after setting it up again
    rig.step()
    assert "not set up" not in checks(rig)["set-up"].text


def test_a_missing_heartbeat(calm: Rig) -> None:
    drives = calm.drives
    assert drives.silent() == ()
    for flag, unheard in (("lost", True), ("operational", False)):
        setattr(drives._nodes._nodes[0].beat, flag, unheard)
        found = calm.arming.run(calm.time_s)
        assert failing(found) == ["heartbeats"]
        assert found.reasons == ("no heartbeat received from joint",)
        setattr(drives._nodes._nodes[0].beat, flag, not unheard)


@pytest.mark.parametrize(
    ("passed", "text"),
    [(False, "identified.yaml is of other drives"), (True, "identified.yaml of 2026-11-20")],
)
def test_the_check_of_the_identification_is_taken_over(passed: bool, text: str) -> None:
    check = Check(name="identification", passed=passed, text=text)
    with lockstep_rig(SINGLE_JOINT, identification=lambda *_: check) as rig:
        rig.enable()
        assert checks(rig)["identification"] == check
        assert failed(rig) == ([] if passed else ["identification"])
        assert rig.permit("the test") == ([] if passed else [text])


def rubbing(c: Configuration) -> Configuration:
    """Friction that hides nine times the contact level at rest."""
    (joint,) = c.joints
    friction = structs.replace(joint.friction, motor_coulomb=5.0)
    return structs.replace(c, joints=[structs.replace(joint, friction=friction)])


def test_levels_that_friction_raises_too_far() -> None:
    with lockstep_rig(SINGLE_JOINT, configure=rubbing) as rig:
        rig.enable()
        assert failed(rig) == ["thresholds"]
        force = rig.estimate.threshold[0]
        assert force > 4.0
        (reason,) = rig.permit("the test")
        assert reason.startswith(
            f"joint detects nothing below {force:.2f} Nm now, more than 5 times its contact level "
            "of 0.50 Nm"
        )


@pytest.mark.parametrize(("times", "refused"), [(4.99, False), (5.01, True)])
def test_how_far_levels_may_be_raised(calm: Rig, times: float, refused: bool) -> None:
    configured = calm.robot.configuration.joints[0].thresholds.contact
    raised = structs.replace(calm.estimate, threshold=np.array([times * configured]))
    record = replace(calm.last, estimate=raised)
    found = calm.arming.judge(record, Mode.HOLDING, (), calm.time_s - 0.01)
    assert failing(found) == (["thresholds"] if refused else [])
    (shown,) = (check for check in found.checks if check.name == "thresholds")
    assert f"{times * configured:.2f}" in shown.text
    assert f"{configured:.2f} Nm" in shown.text
    if refused:  # another level than it has
        assert f"to at least {configured + 0.01:.2f} Nm" in shown.text


def test_every_reason_is_given_in_the_order_of_finding(calm: Rig) -> None:
    """One by one to the client, and by name to the person who reads the table."""
    torque = calm.estimate.threshold + 1.0
    estimate = structs.replace(
        calm.estimate, residual=torque, thresholded=np.ones(1), flags=Flag.STARTING | Flag.LATE
    )
    findings = (
        Finding(Condition.OVERRUN, figures="30 ms late"),
        Finding(Condition.DRIVE_FAULT, "joint"),
        Finding(Condition.OVERRUN, figures="40 ms late"),
    )
    record = replace(calm.last, estimate=estimate, findings=findings)
    objections = (Objection("heartbeats", "no heartbeat"), Objection("set-up", "not set up"))
    found = calm.arming.judge(record, Mode.STOPPING, objections, calm.time_s + 0.03)
    level = torque[0] - 1.0
    over = f"residual of joint is {torque[0]:+.2f} Nm, above its threshold of {level:.2f} Nm"
    assert found.reasons == (
        "the arm is still stopping",
        "too many late ticks (30 ms late)",
        "drive fault: joint",
        "too many late ticks (40 ms late)",
        "no heartbeat",
        "not set up",
        "the estimator is not ready: starting",
        f"{over}: a touch, or a payload?",
        "the last tick is 40 ms old: ask again",
    )
    texts = {check.name: check.text for check in found.checks}
    assert list(texts) == ["mode", *NAMES]
    assert texts["mode"] == "the arm is still stopping"
    assert texts["loop"] == "; ".join(found.reasons[i] for i in (1, 3, 8))
    off = replace(calm.last.samples, drives=(drive_status(0x40),))
    at_rest = replace(calm.last, estimate=estimate, samples=off)
    found_off = calm.arming.judge(at_rest, Mode.OFF, (), calm.time_s)
    assert f"{over}: a brake that carries it, or a touch?" in found_off.reasons
    named = {"mode", "drives", "heartbeats", "set-up", "estimator", "residual", "loop"}
    assert set(failing(found)) == named


def test_no_arming_on_a_tick_that_is_longer_ago_than_a_period(calm: Rig) -> None:
    """The process stood still between the tick and the request, say."""
    calm.step()
    assert run(calm).reasons == ()
    assert failing(run(calm, late_s=0.0002)) == ["loop"]
    late = calm.last.time_s + 5.0
    assert calm.arming.run(late).reasons == ("the last tick is 5000 ms old: ask again",)
    permission = Permission(calm.tick, calm.arming)
    request, person = Arm(detached=True), Peer(1000, 11, 1)
    assert permission.arm(request, person, late).reasons
    assert not calm.tick.controller.machine.armed
    assert not permission.arm(request, person, calm.time_s).reasons
    assert calm.tick.controller.machine.armed
    calm.tick.controller.disarm("the test is over", calm.time_s)
    calm.step()


def test_a_joint_outside_its_limits(calm: Rig) -> None:
    for q, inside in ((1.4, True), (1.449, True), (1.451, False), (-1.451, False)):
        there = replace(calm.samples, link_position=np.array([q]))
        assert failing(run(calm, samples=there)) == ([] if inside else ["limits"])


def test_every_finding_has_a_check() -> None:
    assert {row.check for row in TABLE.values()} <= set(NAMES)


def test_joints_that_sense_contact_only_just_are_named_at_once(calm) -> None:
    since = np.array([calm.last.time_s - 0.14])
    record = replace(calm.last, sensing=np.array([True]), sensing_since_s=since)
    found = calm.arming.judge(record, Mode.HOLDING, (), record.time_s)
    (said,) = [one.text for one in found.checks if one.name == "estimator"]
    words = "sensing contact for only 0.14 s, at least 0.25 s required: joint; ask again"
    assert said.startswith(words)


@pytest.mark.parametrize("lean_Nm", [1.5, -1.5])
def test_arming_is_refused_while_a_person_leans_on_the_arm(lean_Nm: float) -> None:
    """Its residuals are put to zero as it begins to hold. What presses must show before it may be
    armed, and then speaks against it: whenever one asks."""
    with lockstep_rig() as rig:
        rig.run(0.1)
        rig.arm.external_torque[2] = lean_Nm
        rig.request(Event.ENABLE)
        while rig.mode is not Mode.HOLDING:
            rig.step()
        for k in range(1, 41):
            assert rig.permit("a person"), f"tick {k} of holding"
            rig.step()
        assert "residual of LElbowRoll is" in " ".join(rig.permit("a person"))
        rig.arm.external_torque[2] = 0.0
        rig.run(0.5)
        assert rig.permit("a person") == []
