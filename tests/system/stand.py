"""Stand of the system tests: the service, its journal, the simulated drives."""

import contextlib
import grp
import json
import os
import pwd
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import yaml

from common.errors import ContactdError
from daemon.config import digests, identified
from daemon.config.load import load_robot
from daemon.protocol.replies import Reply, Status
from daemon.protocol.requests import Command
from programs.clients.client import Client
from programs.simulate.simulated_robot import write_truth

CAN = "can0"
SERVICE = "contactd.service"
TIMEOUT_S = 400.0
POLL_S = 0.2

CAN_BUS = {"interface": "socketcan", "channel": CAN}
TCP_BUS = {"interface": "socketcand", "host": "127.0.0.1", "port": 29539, "channel": CAN}
EXAMPLES = Path(__file__).resolve().parents[2] / "systemd" / "examples"

_CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DROP_INS = Path("/run/systemd/system/contactd.service.d")
_OURS = DROP_INS / "system-test.conf"


def run(*command: str, check: bool = False) -> subprocess.CompletedProcess[str]:
    """A command's exit status and what it said."""
    return subprocess.run(command, capture_output=True, text=True, check=check)


def wait_for(true: Callable[[], Any], what: str) -> Any:
    """Value of `true()` once it is true; fails after minutes, with the service's journal."""
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        asked = time.monotonic()
        if found := true():
            return found
        if asked > deadline:
            log = run("journalctl", "-u", SERVICE, "-n", "40", "--no-pager").stdout
            raise AssertionError(f"waited in vain for: {what}\n{log}")
        # On a slow machine asking must not keep it from what is waited for.
        time.sleep(max(POLL_S, 2.0 * (time.monotonic() - asked)))


def write_robot(folder: Path, bus: dict[str, Any]) -> None:
    """The single joint of the examples with periods and time-outs for a slow machine."""
    c = yaml.safe_load((_CONFIGS / "single_joint" / "config.yaml").read_text())
    (drive,) = c["drives"].values()
    folder.mkdir()
    for name, source in ((c["urdf"], "single_joint"), ("drive.eds", "romeo_left_arm")):
        (folder / name).write_bytes((_CONFIGS / source / name).read_bytes())
    drive.update(eds="drive.eds", heartbeat_ms=20000, master_timeout_ms=4000, sdo_timeout_ms=5000)
    c.update(period_ms=100, bus=bus, trajectory={"sinusoids": {"joint": {"amplitude": 0.3}}})
    c["trajectory"]["sinusoids"]["joint"]["frequency_Hz"] = 0.1
    c["estimator"] = {**c.get("estimator", {}), "gain": 15.0}
    # A virtual machine that stands still for a moment is no fault here.
    c["supervisor"] = {
        "stale_ticks": 20,
        "overrun_ticks": 200,
        "enable_timeout_s": 60.0,
        "stop_timeout_s": 25.0,
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(c, sort_keys=False))
    robot = load_robot(folder)
    write_truth(robot)
    wired = identified.IdentifiedJoint(
        serial=1,
        wiring=identified.WiringEntry(date="2026-01-02T03:04:05+00:00", log="0", follows=1.0),
    )
    digest = digests.fingerprint(robot.configuration, robot.urdf)
    found = identified.Identified(configuration=digest, joints={"joint": wired})
    identified.write_identified(folder / "identified.yaml", found)


def show(unit: str, name: str) -> str:
    """A property of a unit."""
    return run("systemctl", "show", "--value", "-p", name, unit).stdout.strip()


def assert_is_confined(pid: int, user: str) -> None:
    """A process has this user, the view group alone, and no capability or real-time priority."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    about = {name: value.split() for name, value in (line.split(":", 1) for line in lines)}
    view = grp.getgrnam("contact-view").gr_gid
    assert int(about["Uid"][0]) == pwd.getpwnam(user).pw_uid
    assert {int(each) for each in (about["Gid"][0], *about["Groups"])} == {view}
    assert int(about["CapEff"][0], 16) == int(about["CapBnd"][0], 16) == 0
    assert (about["NoNewPrivs"], about["Seccomp"]) == (["1"], ["2"])
    assert os.getpriority(os.PRIO_PROCESS, pid) == 10
    assert os.sched_getscheduler(pid) == os.SCHED_BATCH


class Service:
    """contactd.service as a person sees it with systemctl, journalctl and contactctl."""

    def __init__(self, robot: Path) -> None:
        self.robot = robot
        self._since = ""

    def configure(self, *lines: str, unit: tuple[str, ...] = ()) -> None:
        """Have the unit run our robot; more `lines` for [Service] and `unit` for [Unit]."""
        command = self.show("ExecStart").split("path=")[1].split(" ;")[0]
        DROP_INS.mkdir(parents=True, exist_ok=True)
        text = ["[Unit]", *unit, "[Service]", "WatchdogSec=60"]
        text += ["TimeoutStartSec=infinity", "TimeoutStopSec=infinity", *lines]
        text += ["ExecStart=", f"ExecStart={command} run {self.robot}"]
        _OURS.write_text("\n".join(text) + "\n")
        run("systemctl", "daemon-reload", check=True)
        run("systemctl", "reset-failed", SERVICE)
        shown = run("journalctl", "-n", "0", "--show-cursor").stdout
        self._since = shown.split("cursor: ")[-1].strip()

    def replace_bus(self, drop_in: Path) -> None:
        """Put a file in the place of the bus.conf that was installed."""
        (DROP_INS / "bus.conf").write_text(drop_in.read_text())
        run("systemctl", "daemon-reload", check=True)

    def forget(self) -> None:
        """Stop it and take our drop-ins away."""
        run("systemctl", "disable", "--runtime", SERVICE)
        run("systemctl", "kill", "--signal=SIGKILL", SERVICE)
        run("systemctl", "stop", SERVICE)
        run("systemctl", "reset-failed", SERVICE)
        for path in (_OURS, DROP_INS / "bus.conf"):
            path.unlink(missing_ok=True)
        run("systemctl", "daemon-reload", check=True)

    def start(self) -> None:
        """Returns when it is ready; on a slow machine a drive may answer only at a later try."""
        run("systemctl", "start", SERVICE)
        self.wait_until_ready()

    def wait_until_ready(self) -> None:
        """Returns when the unit is active."""
        wait_for(lambda: self.show("ActiveState") == "active", "readiness")

    def stop(self) -> None:
        """Returns when it has ended."""
        run("systemctl", "stop", SERVICE, check=True)

    def kill(self, signal: str) -> None:
        """Send a signal to the main process."""
        run("systemctl", "kill", "--kill-whom=main", f"--signal={signal}", SERVICE, check=True)

    def show(self, name: str) -> str:
        """A property of the unit."""
        return show(SERVICE, name)

    @property
    def pid(self) -> int:
        """PID of the main process; 0 for none."""
        return int(self.show("MainPID"))

    @property
    def started_s(self) -> float:
        """When the present main process was started [s, monotonic]."""
        return int(self.show("ExecMainStartTimestampMonotonic")) / 1e6

    def log(self) -> list[str]:
        """Its lines of the journal since it was configured."""
        words = ("journalctl", "-u", SERVICE, "-o", "json", f"--after-cursor={self._since}")
        lines = [json.loads(line) for line in run(*words, "--no-pager").stdout.splitlines()]
        mine = [line for line in lines if line.get("_SYSTEMD_UNIT") == SERVICE]
        return [f"<{line['PRIORITY']}>{line['MESSAGE']}" for line in mine]

    def request(self, command: Command) -> Reply:
        """Ask the daemon, as contactctl does."""

        def answer() -> Reply | None:
            with contextlib.suppress(ContactdError), Client(timeout_s=30.0) as client:
                return client.request(command)
            return None

        return wait_for(answer, f"an answer to {command}")

    def status(self) -> Status:
        """Output of `contactctl status`."""
        reply = self.request("status")
        assert reply.status is not None
        return reply.status

    def wait_for_mode(self, *modes: str) -> Status:
        """The first status in one of these modes."""

        def reached() -> Status | None:
            status = self.status()
            return status if status.mode in modes else None

        return wait_for(reached, f"mode {' or '.join(modes)}")

    def wait_for_samples(self) -> Status:
        """The first status with fresh samples of every drive."""

        def fresh() -> Status | None:
            status = self.status()
            return status if status.drives and not any(status.age_ticks) else None

        return wait_for(fresh, "samples")

    def enable(self) -> None:
        """Energise the arm and see it hold."""
        self.wait_for_samples()
        reply = self.request("enable")
        assert reply.ok, reply.reasons
        self.wait_for_mode("holding")


class Simulator:
    """`contactd simulate`, and what it reports."""

    def __init__(self, robot: Path, *arguments: str) -> None:
        words = ["contactd", "simulate", str(robot), *arguments]
        # Not as root, who may have a real-time priority: on a slow machine nothing else would run.
        self._process = subprocess.Popen(
            words, stdout=subprocess.PIPE, text=True, user="contactd", group="contact", cwd="/"
        )
        self.events: list[dict[str, Any]] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def __enter__(self) -> Self:
        self.wait_for("server", "on ")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()
        self._reader.join()
        assert self._process.stdout is not None
        self._process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.events.append(json.loads(line))

    def reported(self, words: str, kind: str = "drive") -> list[float]:
        """When events with these words happened [s, monotonic]."""
        found = [e for e in self.events if e["kind"] == kind and words in e["text"]]
        return [event["monotonic_s"] for event in found]

    def wait_for(self, kind: str, words: str) -> float:
        """When the first such event happened [s, monotonic]."""

        def happened() -> list[float]:
            found = self.reported(words, kind)
            assert found or self._process.poll() is None, "the simulator ended"
            return found

        return float(wait_for(happened, f"{kind}: ...{words}...")[0])
