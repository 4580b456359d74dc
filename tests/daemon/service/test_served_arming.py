"""Arming through the daemon's socket: checks, leases, owners, in lockstep."""

import json
import os
import socket

import pytest

from bench.rigs.served_daemon import ServedDaemon
from daemon.clients.client import Client
from daemon.modes.table import Mode
from daemon.protocol.messages import Request
from daemon.protocol.socket_path import Peer
from errors import ControlError


def armed(house: ServedDaemon) -> bool:
    return house.rig.tick.controller.machine.armed


def cause_of_disarming(house: ServedDaemon) -> str:
    texts = [e.text for e in house.rig.last.notices if e.text.startswith("disarmed")]
    return texts[0] if texts else ""


def until_disarmed(house: ServedDaemon, limit_s: float) -> tuple[float, str]:
    begun = house.rig.time_s
    while armed(house):
        house.tick()
        assert house.rig.time_s - begun < limit_s
    took = house.rig.time_s - begun
    house.rig.step()
    return took, cause_of_disarming(house)


def test_arm_shows_every_check_and_who_armed(house: ServedDaemon) -> None:
    house.rig.enable()
    result = house.contactctl("arm")
    lines = result.stdout.splitlines()
    assert result.exit_code == 0, result.stderr
    assert all(line.startswith("passed  ") for line in lines[:-1])
    assert len(lines) == 13
    assert lines[-1] == "arm: holding, armed for 10 min"
    status = json.loads(house.contactctl("status", "--json").stdout)
    permit = status["permit"]
    assert (permit["uid"], permit["pid"], permit["detached"]) == (os.getuid(), os.getpid(), True)
    assert permit["left_s"] == pytest.approx(600.0, abs=0.5)
    assert f"(pid {os.getpid()}) for another" in house.contactctl("status").stdout


def test_arm_is_refused_with_the_checks_that_failed(house: ServedDaemon) -> None:
    result = house.contactctl("arm")
    assert (result.exit_code, result.stdout) == (1, "")
    failed = [line for line in result.stderr.splitlines() if line.startswith("failed")]
    assert failed == ["failed  mode            the drives are off (`contactctl enable` first)"]
    assert result.stderr.splitlines()[-1] == "contactctl: arm: refused"
    answer = json.loads(house.contactctl("--json", "arm").stdout)
    assert [c["name"] for c in answer["checks"] if not c["passed"]] == ["mode"]
    assert not armed(house)


def test_a_persons_lease_outlives_the_connection_and_runs_out(house: ServedDaemon) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", "1.5").exit_code == 0
    assert house.service.control.connections <= 1
    took, cause = until_disarmed(house, 2.0)
    assert took == pytest.approx(1.5, abs=0.1)
    assert cause == f"disarmed: the lease of uid {os.getuid()} (pid {os.getpid()}) ran out"
    assert house.rig.mode is Mode.HOLDING


def test_arming_again_renews(house: ServedDaemon) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", "1").exit_code == 0
    house.run(0.7)
    renewed = house.contactctl("arm", "--lease", "1")
    assert renewed.stdout == "arm: holding, armed for 1.0 s\n"  # no checks: it is armed already
    took, _ = until_disarmed(house, 2.0)
    assert took == pytest.approx(1.0, abs=0.1)


def test_a_program_holds_its_lease_by_renewing(house: ServedDaemon, client: Client) -> None:
    house.rig.enable()
    assert house.until(client.arm).ok
    for _ in range(3):
        house.run(0.4)
        assert house.until(client.renew).ok
    house.run(0.4)
    assert armed(house)
    took, cause = until_disarmed(house, 1.0)
    assert took < 0.115  # what is left of half a second, and a tick
    assert "ran out" in cause


def test_a_program_that_is_gone_leaves_the_arm_holding(house: ServedDaemon) -> None:
    house.rig.enable()
    client = Client(house.path)
    assert house.until(lambda: client.arm(3600.0)).ok
    house.rig.arm.external_torque[0] = 3.0
    house.run(0.3)
    assert house.rig.mode is Mode.ADMITTANCE
    client.close()
    took, cause = until_disarmed(house, 0.1)
    assert took <= 0.02
    assert cause == (f"disarmed: uid {os.getuid()} (pid {os.getpid()}), who had armed it, is gone")
    house.run(0.5)
    assert house.rig.mode is Mode.HOLDING


def test_while_guided_the_owner_renews(house: ServedDaemon, client: Client) -> None:
    house.rig.enable()
    assert house.until(client.arm).ok
    house.rig.arm.external_torque[0] = 3.0
    for _ in range(4):
        house.run(0.3)
        assert house.until(client.renew).ok
    assert house.rig.mode is Mode.ADMITTANCE


def test_renewing_never_arms(house: ServedDaemon, client: Client) -> None:
    """Nor does a program that goes on asking undo what somebody else has done."""
    house.rig.enable()
    nothing = house.until(client.renew)
    assert nothing.reasons == ["not armed any more: `arm` it anew"]
    assert house.until(lambda: client.arm(60.0)).ok
    again = house.until(client.arm)
    assert again.reasons == ["this connection has armed it already: `renew` it"]
    assert house.until(lambda: client.renew(2.0)).message == "renew: holding, armed for 2.0 s"
    assert house.contactctl("disarm").exit_code == 0
    assert not house.until(client.renew).ok
    assert not armed(house)


def test_only_who_armed_renews(house: ServedDaemon, client: Client) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", "60").exit_code == 0
    refused = house.until(client.renew)
    assert "only they renew it" in refused.reasons[0]
    with Client(house.path) as another:
        assert house.contactctl("disarm").exit_code == 0
        assert house.until(another.arm).ok
        assert not house.until(client.renew).ok


@pytest.mark.parametrize("lease_s", [0.0, -1.0, 86_401.0, float("nan")])
def test_renewing_takes_no_impossible_lease(
    house: ServedDaemon, client: Client, lease_s: float
) -> None:
    with pytest.raises(ControlError, match="is not a lease"):
        client.renew(lease_s)


def test_another_owner_is_refused_and_everybody_disarms(
    house: ServedDaemon, client: Client
) -> None:
    house.rig.enable()
    assert house.until(lambda: client.arm(60.0)).ok
    result = house.contactctl("arm")
    assert result.exit_code == 1
    assert f"armed by uid {os.getuid()} (pid {os.getpid()}) for another 1 min" in result.stderr
    assert armed(house)
    assert house.contactctl("disarm").exit_code == 0
    assert not armed(house)
    assert house.contactctl("arm").exit_code == 0  # free again
    refused = house.until(client.arm)
    assert not refused.ok
    assert "for another 10 min" in refused.reasons[0]


@pytest.mark.parametrize("lease", [0.0, -1.0, 86_401.0, "soon", float("nan")])
def test_impossible_leases(house: ServedDaemon, lease: object) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", str(lease)).exit_code == 2
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as raw:
        raw.connect(str(house.path))
        raw.send(json.dumps({"command": "arm", "lease_s": lease}).encode())
        assert "not a request" in json.loads(house.until(lambda: raw.recv(10_000)))["message"]
    assert not armed(house)


def test_disarm_works_in_every_mode(house: ServedDaemon) -> None:
    enabled = [house.contactctl("disarm").exit_code]
    house.rig.enable()
    enabled.append(house.contactctl("disarm").exit_code)
    house.contactctl("arm")
    house.contactctl("start")
    enabled.append(house.contactctl("disarm").exit_code)
    house.contactctl("pause", "--no-wait")
    enabled.append(house.contactctl("disarm").exit_code)
    house.rig.arm.drives[0].fault(0x2310, "injected by the test")
    house.run(0.1)
    assert house.rig.mode is Mode.FAULTED
    enabled.append(house.contactctl("disarm").exit_code)
    assert enabled == [0] * 5


def test_who_arms_and_disarms_all_the_time_does_not_fill_the_log(
    house: ServedDaemon, client: Client, caplog: pytest.LogCaptureFixture
) -> None:
    house.ask(client, "enable")
    house.run(0.5)
    caplog.set_level("INFO", "contactd")
    caplog.clear()
    somebody = Peer(1000, 4711, 1)

    def flip(times: int) -> None:
        for command in ("arm", "disarm") * times:
            assert house.service.handle(Request(command), somebody).ok
            house.tick()

    flip(100)
    house.run(1.1)
    lines = [record.getMessage() for record in caplog.records]
    assert lines[0] == "armed: armed by uid 1000 (pid 4711), for 0.5 s"
    assert 30 < len(lines) < 45
    told = [line for line in lines if line.startswith("too much to tell line by line")]
    assert len(told) == 2  # it took two seconds
    assert all(" x armed: armed by uid 1000 (pid 4711), for 0.5 s" in line for line in told)
    flip(30)
    house.rig.arm.drives[0].fault(0x2310, "injected by the test")
    house.run(0.05)
    faults = [record for record in caplog.records if record.levelname == "ERROR"]
    assert faults, "a fault is never left out"
