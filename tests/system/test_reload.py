"""`systemctl reload contactd`: files taken up, or not, by the service that goes on."""

import subprocess

import yaml

from programs.clients.client import Client
from tests.system.stand import SERVICE, Service, Simulator, run, wait_for


def edit(service: Service, **changes: object) -> None:
    """Change fields of the only joint."""
    path = service.robot / "config.yaml"
    written = yaml.safe_load(path.read_text())
    written["joints"][0] |= changes
    path.write_text(yaml.safe_dump(written, sort_keys=False))


def reload() -> subprocess.CompletedProcess[str]:
    return run("systemctl", "reload", SERVICE)


def gain(service: Service) -> float:
    """That of the configuration by which the daemon runs."""
    service.wait_for_samples()
    with Client(timeout_s=30.0) as client:
        configuration = yaml.safe_load(client.subscribe()[0].configuration)
    return float(configuration["joints"][0]["admittance_gain"])


def is_the_same(service: Service, pid: int) -> bool:
    """Active, never started again, and off."""
    assert (service.show("ActiveState"), service.show("NRestarts")) == ("active", "0")
    assert service.pid == pid
    return service.wait_for_samples().mode == "off"


def test_good_files_are_taken_up_by_the_same_process(
    service: Service, simulator: Simulator
) -> None:
    service.start()
    pid = service.pid
    edit(service, admittance_gain=0.111)
    wait_for(lambda: service.status().changed == ["config.yaml"], "the change to be seen")
    result = reload()
    assert result.returncode == 0, result.stderr
    assert is_the_same(service, pid)
    assert gain(service) == 0.111
    assert service.status().changed == []
    # systemd takes the new run for the same start, and its watchdog is fed by the new ticks.
    assert wait_for(lambda: service.show("SubState") == "running", "readiness")
    assert service.show("StatusText") == "off, not armed: started"
    fed = service.show("WatchdogTimestampMonotonic")
    wait_for(lambda: service.show("WatchdogTimestampMonotonic") != fed, "food")
    assert not simulator.reported("heartbeat of the master lost")
    service.enable()


def test_bad_files_fail_with_the_reason_and_the_daemon_goes_on(
    service: Service, simulator: Simulator
) -> None:
    service.start()
    pid, before = service.pid, gain(service)
    good = (service.robot / "config.yaml").read_text()
    edit(service, admittance_gain=-1.0)
    result = reload()
    assert result.returncode != 0
    assert "failed" in result.stderr
    assert is_the_same(service, pid)
    assert gain(service) == before
    said = [line for line in service.log() if "not taken up" in line]
    assert any(line.startswith("<3>") for line in said), "by the daemon"
    assert any("contactctl: not taken up" in line for line in said), "by who was asked to"
    shown = run("systemctl", "status", SERVICE).stdout
    assert "not taken up" in shown
    assert all("admittance_gain" in line for line in (*said, service.show("StatusText")))
    reply = service.request("enable")
    assert not reply.ok
    assert "admittance_gain" in reply.reasons[0]
    (service.robot / "config.yaml").write_text(good)
    assert reload().returncode == 0
    assert is_the_same(service, pid)
    service.enable()


def test_with_the_drives_on_it_is_refused_and_nothing_stops(
    service: Service, simulator: Simulator
) -> None:
    service.start()
    pid = service.pid
    service.enable()
    edit(service, admittance_gain=0.111)
    result = reload()
    assert result.returncode != 0
    assert any("the drives must be off, not holding" in line for line in service.log())
    assert service.show("ActiveState") == "active"
    status = service.wait_for_samples()
    assert (status.mode, status.pid) == ("holding", pid)
    assert "operation enabled" in status.drives
