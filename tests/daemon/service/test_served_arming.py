"""Arming through the daemon's socket: checks, leases, owners, in lockstep."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.served_daemon import ServedDaemon
from common.errors import ControlError
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.symptoms import advice_of
from daemon.modes.table import Mode
from daemon.protocol.requests import bare
from daemon.protocol.socket_path import Peer
from daemon.service.sensitivity import sensitivity_now
from estimator.motor_position import Side
from programs.clients.client import Client
from programs.contactctl import replies


def armed(served: ServedDaemon) -> bool:
    return served.rig.tick.controller.machine.armed


def cause_of_disarming(served: ServedDaemon) -> str:
    texts = [e.text for e in served.rig.last.notices if e.text.startswith("disarmed")]
    return texts[0] if texts else ""


def until_disarmed(served: ServedDaemon, limit_s: float) -> tuple[float, str]:
    begun = served.rig.time_s
    while armed(served):
        served.tick()
        assert served.rig.time_s - begun < limit_s
    took = served.rig.time_s - begun
    served.rig.step()
    return took, cause_of_disarming(served)


def test_arm_waits_after_enable(served: ServedDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    served.idle_s = 0.02  # a tick for each time that the command looks
    monkeypatch.setattr(replies, "SENSING_WAIT_S", 60.0)  # of a clock that the ticks do not follow
    with Client(served.path) as client:
        assert served.contactctl("enable").exit_code == 0
        reply = served.until(lambda: client.arm(5.0))
    assert reply.ok, reply.reasons


def test_arm_shows_every_check_and_who_armed(on: ServedDaemon) -> None:
    result = on.contactctl("arm")
    lines = result.stdout.splitlines()
    assert result.exit_code == 0, result.stderr
    assert all(line.startswith("passed  ") for line in lines[:14])
    assert lines[14].startswith("smallest touch")
    assert lines[-1] == "arm: holding, armed for 10 min"
    status = json.loads(on.contactctl("status", "--json").stdout)
    permit = status["permit"]
    assert (permit["uid"], permit["pid"], permit["detached"]) == (os.getuid(), os.getpid(), True)
    assert permit["left_s"] == pytest.approx(600.0, abs=0.5)
    assert f"(pid {os.getpid()}) for another" in on.contactctl("status").stdout


def test_arm_shows_the_smallest_touch(on: ServedDaemon) -> None:
    on.run(0.5)
    shown = on.contactctl("arm").stdout.splitlines()
    felt = json.loads(on.contactctl("--json", "arm").stdout)["sensitivity"]
    rig = on.rig
    joint = rig.robot.configuration.joints[0]
    # At rest: the level in force, of an arm that rests.
    assert felt["resting"] == pytest.approx(rig.estimate.threshold.tolist(), rel=1e-3)
    unsure = 1.25 if rig.estimate.side[0] == Side.UNKNOWN else 1.0
    # Friction may be off by half in motion, before any was shown.
    friction, speed = joint.friction, joint.limits.velocity
    rubs = friction.motor_coulomb + friction.link_coulomb
    rubs += (friction.motor_viscous + friction.link_viscous) * speed
    moving = unsure * joint.thresholds.contact + 0.5 * rubs
    assert felt["moving"] == [pytest.approx(moving, rel=1e-3)]
    # A bar that hangs down, its centre 0.2 m below the joint: felt along x alone.
    assert felt["tool"] == "the centre of mass of bar"
    lever = 0.2
    assert felt["tool_moving"]["least_N"] == pytest.approx(felt["moving"][0] / lever)
    assert felt["tool_resting"]["least_N"] == pytest.approx(felt["resting"][0] / lever)
    assert len(felt["tool_resting"]["undetected"]) == 2
    assert f"joint             {felt['moving'][0]:.2f} Nm    {felt['resting'][0]:.2f} Nm" in shown
    assert shown[-2].startswith(f"  at rest    {felt['resting'][0] / lever:.1f} N at best")
    assert shown[-2] in on.contactctl("status").stdout


def test_a_push_of_the_stated_smallest_touch_is_detected(on: ServedDaemon) -> None:
    """And one of half of it is not: less than in motion, for it moves the link through its gap."""
    assert on.contactctl("arm").exit_code == 0
    on.run(0.5)
    felt = sensitivity_now(on.rig.tick)
    assert felt is not None
    lever = np.linalg.norm(on.rig.tick.estimator.model.tool_jacobian(on.rig.estimate.q))
    force = felt.tool_resting.least_N
    for share, yields in ((0.5, False), (1.3, True)):
        on.rig.arm.external_torque[0] = share * force * lever
        on.run(1.0)
        assert (on.rig.mode is Mode.ADMITTANCE) == yields, (share, on.rig.estimate)


def test_no_smallest_touch_is_known_before_the_first_samples(served: ServedDaemon) -> None:
    served.rig.tick.last = None
    assert sensitivity_now(served.rig.tick) is None


def test_arm_is_refused_with_the_checks_that_failed(served: ServedDaemon) -> None:
    served.run(0.3)
    result = served.contactctl("arm")
    assert (result.exit_code, result.stdout) == (1, "")
    failed = [line for line in result.stderr.splitlines() if line.startswith("failed")]
    assert failed == ["failed  mode            the drives are off (`contactctl enable` first)"]
    assert result.stderr.splitlines()[-1] == "contactctl: arm: refused"
    answer = json.loads(served.contactctl("--json", "arm").stdout)
    assert [c["name"] for c in answer["checks"] if not c["passed"]] == ["mode"]
    assert not armed(served)


def test_a_persons_lease_outlives_the_connection_and_runs_out(on: ServedDaemon) -> None:
    assert on.contactctl("arm", "--lease", "1.5").exit_code == 0
    assert on.service.control.connections <= 1
    took, cause = until_disarmed(on, 2.0)
    assert took == pytest.approx(1.5, abs=0.1)
    assert cause == f"disarmed: the lease of uid {os.getuid()} (pid {os.getpid()}) ran out"
    assert on.rig.mode is Mode.HOLDING
    ended = f"HOLDING   not armed: {cause.removeprefix('disarmed: ')} (0 s ago)"
    assert ended in on.contactctl("status").stdout


def test_arming_again_renews(on: ServedDaemon) -> None:
    assert on.contactctl("arm", "--lease", "1").exit_code == 0
    on.run(0.7)
    renewed = on.contactctl("arm", "--lease", "1")
    assert renewed.stdout.startswith("smallest touch")  # no checks: it is armed already
    assert renewed.stdout.endswith("\narm: holding, armed for 1.0 s\n")
    took, _ = until_disarmed(on, 2.0)
    assert took == pytest.approx(1.0, abs=0.1)


def test_a_program_holds_its_lease_by_renewing(on: ServedDaemon, client: Client) -> None:
    assert on.until(client.arm).ok
    for _ in range(3):
        on.run(0.4)
        assert on.until(client.renew).ok
    on.run(0.4)
    assert armed(on)
    took, cause = until_disarmed(on, 1.0)
    assert took < 0.115  # what is left of half a second, and a tick
    assert "ran out" in cause


def test_an_arm_whose_program_is_gone_holds_disarmed(on: ServedDaemon) -> None:
    client = Client(on.path)
    assert on.until(lambda: client.arm(3600.0)).ok
    on.rig.arm.external_torque[0] = 3.0
    on.run(0.3)
    assert on.rig.mode is Mode.ADMITTANCE
    client.close()
    took, cause = until_disarmed(on, 0.1)
    assert took <= 0.02
    assert cause == (f"disarmed: uid {os.getuid()} (pid {os.getpid()}), who had armed it, is gone")
    on.run(0.5)
    assert on.rig.mode is Mode.HOLDING


def test_while_guided_the_owner_renews(on: ServedDaemon, client: Client) -> None:
    assert on.until(client.arm).ok
    on.rig.arm.external_torque[0] = 3.0
    for _ in range(4):
        on.run(0.3)
        assert on.until(client.renew).ok
    assert on.rig.mode is Mode.ADMITTANCE


def test_renewing_never_arms(on: ServedDaemon, client: Client) -> None:
    """Nor does a program that goes on asking undo what another has done."""
    nothing = on.until(client.renew)
    assert nothing.reasons == ["not armed any more: `arm` it anew"]
    assert on.until(lambda: client.arm(60.0)).ok
    again = on.until(client.arm)
    assert again.reasons == ["this connection has armed it already: use `renew`"]
    assert on.until(lambda: client.renew(2.0)).message == "renew: holding, armed for 2.0 s"
    assert on.contactctl("disarm").exit_code == 0
    assert not on.until(client.renew).ok
    assert not armed(on)


def test_only_the_owner_renews(on: ServedDaemon, client: Client) -> None:
    assert on.contactctl("arm", "--lease", "60").exit_code == 0
    refused = on.until(client.renew)
    assert "only this owner can renew it" in refused.reasons[0]
    with Client(on.path) as another:
        assert on.contactctl("disarm").exit_code == 0
        on.run(0.03)  # what is asked any sooner may be older than the disarm
        assert on.until(another.arm).ok
        assert not on.until(client.renew).ok


def test_renewing_with_an_impossible_lease_is_refused(client: Client) -> None:
    for lease_s in (0.0, -1.0, 86_401.0, float("nan")):
        with pytest.raises(ControlError, match="must be more than 0"):
            client.renew(lease_s)


def test_another_owner_may_not_arm_and_may_disarm(on: ServedDaemon, client: Client) -> None:
    assert on.until(lambda: client.arm(60.0)).ok
    result = on.contactctl("arm")
    assert result.exit_code == 1
    assert f"armed by uid {os.getuid()} (pid {os.getpid()}) for another 1 min" in result.stderr
    assert armed(on)
    assert on.contactctl("disarm").exit_code == 0
    assert not armed(on)
    free = on.contactctl("arm")
    assert free.exit_code == 0, free.output + free.stderr
    refused = on.until(client.arm)
    assert not refused.ok
    assert "for another 10 min" in refused.reasons[0]


def test_status_advises_on_a_fault_until_its_reset(served: ServedDaemon, client: Client) -> None:
    def advice() -> str:
        status = served.ask(client, "status").status
        assert status is not None
        return status.advice

    served.rig.enable()
    assert advice() == ""
    served.rig.arm.drives[0].fault(0x2310, "injected by the test")
    served.run(0.1)
    assert advice() == advice_of(Condition.EMERGENCY)
    served.ask(client, "reset")
    assert advice() == ""
    assert served.rig.tick.last is not None
    noted = (Finding(Condition.BUS_LOADED),)  # the arm goes on with it
    served.rig.tick.last = replace(served.rig.tick.last, findings=noted)
    status = served.service.commands.handle(bare("status"), Peer(0, 1, 1)).status
    assert status is not None
    assert status.advice == advice_of(Condition.BUS_LOADED)


def test_arming_and_disarming_all_the_time_does_not_fill_the_log(
    served: ServedDaemon, client: Client, caplog: pytest.LogCaptureFixture
) -> None:
    served.ask(client, "enable")
    served.run(0.5)
    caplog.set_level("INFO", "contactd")
    caplog.clear()
    a_person = Peer(1000, 4711, 1)

    def flip(times: int) -> None:
        for command in ("arm", "disarm") * times:
            assert served.service.commands.handle(bare(command), a_person).ok
            served.tick()

    flip(100)
    served.run(1.1)
    lines = [record.getMessage() for record in caplog.records]
    assert lines[0] == "armed: armed by uid 1000 (pid 4711), for 0.5 s"
    assert 30 < len(lines) < 45
    reported = [line for line in lines if line.startswith("too many lines")]
    assert len(reported) == 2  # it took two seconds
    assert all(" x armed: armed by uid 1000 (pid 4711), for 0.5 s" in line for line in reported)
    flip(30)
    served.rig.arm.drives[0].fault(0x2310, "injected by the test")
    served.run(0.05)
    faults = [record for record in caplog.records if record.levelname == "ERROR"]
    assert faults, "a fault is never left out"
