"""contactd.service: coming up, being watched, and ending, each in order."""

import grp
import os
import pwd
import stat
from pathlib import Path

import pytest

from tests.system.stand import DROP_INS, SERVICE, Service, Simulator, run, wait_for

LOST = "heartbeat of the master lost, quick stop"
SOCKET = Path("/run/contactd/control")
STATE = Path("/var/lib/contactd")


def energised(service: Service) -> bool:
    return "operation enabled" in service.wait_for_samples().drives


def assert_is_off(service: Service) -> None:
    status = service.wait_for_samples()
    assert (status.mode, status.armed) == ("off", False)
    assert "operation enabled" not in status.drives


def policies(pid: int) -> list[int]:
    """Scheduling policy of every thread, the main one first."""
    threads = sorted(int(p.name) for p in Path(f"/proc/{pid}/task").iterdir())
    return [os.sched_getscheduler(t) & ~os.SCHED_RESET_ON_FORK for t in threads]


def kernel_status(pid: int) -> dict[str, str]:
    """Status of a process, from the kernel."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {name: value.strip() for name, value in (line.split(":", 1) for line in lines)}


def test_a_start_ends_ready_and_energises_nothing(service: Service, simulator: Simulator) -> None:
    service.start()
    assert service.show("ActiveState") == "active"
    assert service.show("StatusText") == "off, not armed: started"
    log = service.log()
    set_up = next(i for i, line in enumerate(log) if "set up and read back" in line)
    ready = next(i for i, line in enumerate(log) if "ready, off, at" in line)
    assert set_up < ready
    assert_is_off(service)

    about = kernel_status(service.pid)
    assert int(about["Uid"].split()[0]) == pwd.getpwnam("contactd").pw_uid
    assert int(about["CapEff"], 16) == 0
    assert about["NoNewPrivs"] == "1"
    assert about["Seccomp"] == "2"

    control = SOCKET.stat()
    assert stat.S_IMODE(control.st_mode) == 0o660
    assert control.st_gid == grp.getgrnam("contact").gr_gid
    assert run("contactctl", "--json", "status").returncode == 0


def test_the_loop_has_real_time_and_nothing_else_has(
    service: Service, simulator: Simulator
) -> None:
    if run("systemd-detect-virt", "--container").returncode == 0:
        pytest.skip("a container's systemd has no real-time priorities to give")
    service.start()
    granted = {grant.name: grant.achieved for grant in service.status().realtime}
    assert granted.pop("cpu") is ((os.cpu_count() or 1) == 1)
    assert all(granted.values()), granted
    loop, *others = policies(service.pid)
    assert loop == os.SCHED_FIFO
    assert others == [os.SCHED_OTHER]  # the log's writer
    assert int(kernel_status(service.pid)["VmLck"].split()[0]) > 10_000


def test_a_drop_in_gives_the_loop_a_cpu_of_its_own(service: Service, simulator: Simulator) -> None:
    service.configure("CPUAffinity=0")
    service.start()
    (cpu,) = [grant for grant in service.status().realtime if grant.name == "cpu"]
    assert cpu.achieved
    assert os.sched_getaffinity(service.pid) == {0}


def test_every_change_of_mode_is_one_line_with_its_cause_and_ticks_are_none(
    service: Service, simulator: Simulator
) -> None:
    service.start()
    before = len(service.log())
    service.enable()
    first = service.status().ticks
    wait_for(lambda: service.status().ticks > first + 40, "40 more ticks")
    lines = service.log()[before:]
    assert [line.split("] ")[1].split(":")[0] for line in lines] == [
        "off -> enabling",
        "enabling -> holding",
    ]
    assert all(line.startswith("<6>[mode tick=") for line in lines)
    assert f"enable by uid {os.getuid()} (pid {os.getpid()})" in lines[0]
    assert service.show("StatusText") == "holding, not armed: drives enabled"


def test_ticks_keep_the_watchdog_from_expiring(service: Service, simulator: Simulator) -> None:
    service.configure("WatchdogSec=40")
    service.start()
    fed = service.show("WatchdogTimestampMonotonic")
    again = wait_for(
        lambda: (now := service.show("WatchdogTimestampMonotonic")) != fed and now, "the watchdog"
    )
    ticks = service.status().ticks
    wait_for(
        lambda: service.show("WatchdogTimestampMonotonic") not in (fed, again), "the watchdog again"
    )
    assert service.status().ticks > ticks


def test_after_sigkill_drives_stop_and_the_next_process_energises_nothing(
    service: Service, simulator: Simulator
) -> None:
    service.configure("RestartSec=20")  # later than the drives stop, on a fast machine, too
    service.start()
    service.enable()
    pid = service.pid
    service.kill("SIGKILL")
    stopped = simulator.wait_for("drive", LOST)
    wait_for(lambda: service.pid not in (0, pid), "a new process")
    assert stopped < service.started_s
    # By ExecStopPost=: the daemon's own helper is killed with it.
    (saved,) = [line.split()[-1] for line in service.log() if "/frames-" in line]
    assert Path(saved).parent == Path("/var/lib/contactd")
    assert Path(saved).stat().st_size > 0
    service.wait_until_ready()
    assert_is_off(service)
    # A person may enable it again.
    service.enable()
    assert energised(service)


def test_a_process_frozen_for_a_while_latches_a_fault_until_a_reset(
    service: Service, simulator: Simulator
) -> None:
    service.configure("WatchdogSec=infinity")
    service.start()
    service.enable()
    pid = service.pid
    service.kill("SIGSTOP")
    simulator.wait_for("drive", LOST)
    service.kill("SIGCONT")
    service.wait_for_mode("faulted")
    assert service.pid == pid
    ticks = service.status().ticks
    wait_for(lambda: service.status().ticks > ticks + 40, "40 more ticks")
    assert service.status().mode == "faulted"
    assert not service.request("enable").ok
    assert service.request("reset").ok
    service.wait_for_mode("off")
    wait_for(lambda: not energised(service), "drives without power")


def test_a_frozen_process_is_ended_by_the_watchdog_and_the_next_energises_nothing(
    service: Service, simulator: Simulator
) -> None:
    service.configure("WatchdogSec=20")
    service.start()
    service.enable()
    pid = service.pid
    service.kill("SIGSTOP")
    stopped = simulator.wait_for("drive", LOST)
    wait_for(lambda: service.pid not in (0, pid), "a new process")
    assert stopped < service.started_s
    assert any("watchdog" in line.lower() for line in systemd_lines())
    service.wait_until_ready()
    assert_is_off(service)


def systemd_lines() -> list[str]:
    """Lines of systemd itself on the service."""
    words = ("journalctl", "_PID=1", f"UNIT={SERVICE}", "-o", "cat", "--no-pager")
    return run(*words).stdout.splitlines()


def test_a_stop_in_motion_brakes_holds_and_ends_in_this_order(
    service: Service, simulator: Simulator
) -> None:
    service.start()
    service.enable()
    assert service.request("start").ok
    service.wait_for_mode("tracking")
    service.stop()
    assert service.show("Result") == "success"
    *lines, ended = service.log()
    changes = [line.split("] ")[1].split(":")[0] for line in lines if "[mode " in line]
    assert changes[-3:] == ["tracking -> stopping", "stopping -> holding", "holding -> off"]
    assert ended.endswith("ended: hold: joint")
    # Monitoring was switched off: the drives report no lost master.
    assert not simulator.reported(LOST)


def test_a_wrong_configuration_is_not_tried_again(service: Service) -> None:
    path = service.robot / "config.yaml"
    path.write_text(path.read_text().replace("period_ms: 100", "period_ms: 0"))
    assert run("systemctl", "start", SERVICE).returncode != 0
    wait_for(lambda: service.show("ActiveState") == "failed", "the end")
    assert service.show("ExecMainStatus") == "78"
    assert service.show("NRestarts") == "0"
    line = service.log()[-1]
    assert line.startswith("<3>")
    assert "period_ms" in line
    assert service.show("StatusText") == f"failed: {line[3:]}"


def test_without_drives_starts_are_repeated_without_a_limit(service: Service, vcan: bool) -> None:
    logs = set(STATE.glob("frames-*"))
    service.configure("RestartSec=1")
    for number in range(7):
        assert run("systemctl", "restart", SERVICE).returncode != 0
        wait_for(lambda: service.show("SubState") == "auto-restart", "the next try")
        assert service.show("Result") != "start-limit-hit"
        assert len([line for line in service.log() if line.startswith("<3>")]) > number
    service.configure("RestartSec=600")
    run("systemctl", "restart", SERVICE)
    wait_for(lambda: service.show("SubState") == "auto-restart", "a pause")
    line = service.log()[-1]
    assert line.startswith("<3>")
    shown = run("systemctl", "status", SERVICE).stdout
    assert f'Status: "failed: {line[3:]}"' in shown
    assert set(STATE.glob("frames-*")) == logs, "a start that failed saves no frames"
    service.configure("RestartSec=1")
    run("systemctl", "restart", SERVICE)
    assert run("systemctl", "start", SERVICE).returncode != 0, "it joins the next try"
    wait_for(lambda: int(service.show("NRestarts")) > 6, "7 more tries of its own")
    with Simulator(service.robot):
        wait_for(lambda: service.show("ActiveState") == "active", "readiness, by itself")


def test_a_start_without_can0_reports_it(service: Service, vcan: bool) -> None:
    device = "sys-subsystem-net-devices-can0.device"
    assert (
        run("systemctl", "show", "--value", "-p", "JobRunningTimeoutUSec", device).stdout == "5s\n"
    )
    if run("ip", "link", "show", "can0").returncode == 0:
        run("ip", "link", "delete", "can0", check=True)
    (DROP_INS / "bus.conf").unlink(missing_ok=True)
    run("systemctl", "daemon-reload", check=True)
    assert run("systemctl", "start", SERVICE).returncode != 0
    assert service.show("ActiveState") == "inactive"
    wait_for(lambda: any("on can0" in line for line in systemd_lines()), "the reason")
    assert "on can0" in run("systemctl", "status", SERVICE).stdout


def test_a_helper_of_the_black_box_that_is_killed_is_begun_anew(
    service: Service, simulator: Simulator
) -> None:
    service.start()
    helpers = run("pgrep", "-f", "daemon.service.black_box").stdout.split()
    assert len(helpers) == 1
    run("kill", "-9", *helpers, check=True)
    wait_for(lambda: any("restarting it" in line for line in service.log()), "another")
    again = run("pgrep", "-f", "daemon.service.black_box").stdout.split()
    assert len(again) == 1
    assert again != helpers
    assert service.show("ActiveState") == "active"
