"""Owner of a robot: a shell at its PC, and the arm beside it, simulated, which outlives a boot."""

import contextlib
import json
import math
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from tests.system.stand import CAN, CAN_BUS, EXAMPLES, TCP_BUS, run, wait_for

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs"
INSTALLED = Path("/etc/contactd")
NAME = "owner"
HOME = Path("/home") / NAME
MINE = HOME / "my_arm"
ARM = "simulated-arm.service"
_ARM = Path("/etc/systemd/system") / ARM
HAND = Path("/run/simulated-arm/hand")
HALF_GAP = 0.02  # rad
MOTOR_COUNTS = 65536  # per turn: fine enough for the little that `identify wiring` moves
TRIES = 5
# Of its own: the package is replaced and removed while the arm stays what it is.
_ARMS_PROGRAM = Path("/opt/simulated-arm")


def commands(page: str) -> set[str]:
    """Commands that stand in code blocks of a page of docs, without their remarks."""
    text = (ROOT / "docs" / page).read_text()
    blocks = re.findall(r"^(?:    |   )+(\S.*)$", text, re.MULTILINE)
    return {
        re.split(r"\s{2,}#", line)[0].strip() for line in blocks + re.findall(r"`([^`]+)`", text)
    }


class Owner:
    """Types what a page says, with names of the owner's own in the place of the page's."""

    def __init__(self, **names: str) -> None:
        self.names = names

    def types(
        self, page: str, command: str, *, fails: bool = False, yes: bool = False
    ) -> subprocess.CompletedProcess[str]:
        """Type a command as it stands in docs/PAGE, and see it succeed, or fail; as root where
        `sudo` stands in front of it; with `yes` to what it would ask."""
        if command not in commands(page):
            raise ValueError(f"docs/{page} does not say: {command}")
        for known, mine in self.names.items():
            command = command.replace(known, mine)
        return self.shell(f"{command} --yes" if yes else command, fails=fails)

    def tries(self, page: str, command: str, *, yes: bool = False) -> bool:
        """Type it, and say whether it succeeded."""
        with contextlib.suppress(AssertionError):
            self.types(page, command, yes=yes)
            return True
        return False

    def begins(self, command: str, file: Path) -> Callable[[], bool]:
        """Type a command that writes a file, with `&`, and see the file; whether it has ended."""
        file.unlink(missing_ok=True)
        said = file.with_suffix(".log")
        self.shell(f"({command}; echo ended) >{said} 2>&1 &")
        wait_for(file.exists, str(file))
        return lambda: "ended" in said.read_text()

    def repeats(
        self, does: Callable[[], bool], what: str, *, ready: Callable[[], None] | None = None
    ) -> None:
        """Do it until it succeeds, each time once the arm is `ready`, else in power: a machine that
        stood still for a moment has the arm hold and be disarmed, as it should."""
        for _ in range(TRIES):
            (ready or self.holds)()
            if does():
                return
            print(f"\nnot this time, {self.status().get('cause', 'no daemon')}: {what}")
        raise AssertionError(f"{TRIES} times in vain: {what}")

    def shell(self, command: str, *, fails: bool = False) -> subprocess.CompletedProcess[str]:
        """The same with a command of no page."""
        as_root = command.startswith("sudo ")
        who = [] if as_root else ["runuser", "--login", NAME, "--command"]
        word = command.removeprefix("sudo ")
        # The answer to what apt asks, if it asks.
        text = f"cd {HOME}; {'yes | ' if word.startswith('apt ') else ''}{word}"
        done = run(*who, *([] if not as_root else ["sh", "-ec"]), text)
        assert (done.returncode != 0) is fails, f"{command}\n{done.stdout}\n{done.stderr}"
        return done

    def status(self) -> dict[str, Any]:
        """Output of `contactctl status`; nothing where no daemon answers."""
        done = run("contactctl", "--json", "status")
        return dict(json.loads(done.stdout)) if done.returncode == 0 else {}

    def sees(self, *modes: str) -> dict[str, Any]:
        """The first status in one of these modes."""
        return dict(wait_for(lambda: (s := self.status()).get("mode") in modes and s, str(modes)))

    def arms(self) -> None:
        """Once it is possible: a slow machine's drives are seldom heard."""
        words = ("runuser", "--login", NAME, "--command", "contactctl arm")
        wait_for(lambda: run(*words).returncode == 0, "what arming needs")

    def holds(self) -> None:
        """Give it power, from wherever it stands without a person."""

        def holds() -> bool:
            status = self.status()
            if status.get("mode") == "faulted":
                self.tries("operating.md", "contactctl reset")
            if status.get("mode") == "off" and not any(status["age_ticks"]):
                self.tries("commissioning.md", "contactctl enable")
            return status.get("mode") == "holding"

        wait_for(holds, "holding")

    def rests(self) -> None:
        """Take its power, where no fault did."""
        if self.status().get("mode") not in ("off", "faulted"):
            self.types("operating.md", "contactctl disable")
        self.sees("off", "faulted")


def move_in(vcan: bool) -> None:
    """An account, and the folder of an arm that was not identified."""
    run("useradd", "--create-home", "--shell", "/bin/bash", NAME, check=True)
    c = yaml.safe_load((CONFIGS / "single_joint" / "config.yaml").read_text())
    (drive,), (joint,) = c["drives"].values(), c["joints"]
    # For a slow machine, whose moments of standing still are no fault here.
    drive.update(eds="drive.eds", heartbeat_ms=20000, master_timeout_ms=4000, sdo_timeout_ms=5000)
    drive["motor_position"]["scale"] = 2.0 * math.pi / MOTOR_COUNTS
    c["supervisor"] = {"stale_ticks": 50, "overrun_ticks": 500}
    c["supervisor"] |= {"enable_timeout_s": 60.0, "stop_timeout_s": 25.0}
    del joint["known"]  # all of it is found
    joint.update(half_gap=HALF_GAP)
    joint["thresholds"] = {"contact": 1.5, "collision": 4.0}
    c.update(period_ms=100, bus=CAN_BUS if vcan else TCP_BUS)
    c["estimator"] = {**c.get("estimator", {}), "gain": 15.0}
    # At 100 ms the usual 8 makes a limit cycle in the gap, which `identify friction` names.
    c["control"] = {"position_gain": 2.0}
    c["poses"] = {"home": {"joint": 0.2}}
    MINE.mkdir()
    (MINE / "config.yaml").write_text(yaml.safe_dump(c, sort_keys=False))
    truth = yaml.safe_load((CONFIGS / "single_joint" / "simulation.yaml").read_text())
    truth["joints"][0]["half_gap"] = HALF_GAP
    make = truth["drives"]["two_encoder_drive"]
    make["eds"], make["motor_position"]["counts"] = "drive.eds", MOTOR_COUNTS
    (MINE / "simulation.yaml").write_text(yaml.safe_dump(truth, sort_keys=False))
    for name, source in ((c["urdf"], "single_joint"), ("drive.eds", "romeo_left_arm")):
        shutil.copy(CONFIGS / source / name, MINE)
    run("chown", "-R", f"{NAME}:{NAME}", str(HOME), check=True)


def put_up_the_arm(vcan: bool) -> None:
    """Drives that have power from every boot on, with a bus of their own where there may be one."""
    run("cp", "-al", "/opt/contactd", str(_ARMS_PROGRAM), check=True)
    shutil.copytree(MINE, _ARMS_PROGRAM / "arm")
    bus = f"modprobe vcan; ip link add {CAN} type vcan; ip link set {CAN} up"
    _ARM.write_text(
        "\n".join([
            "[Service]",
            *([f"ExecStartPre=+/bin/sh -c '{bus}'"] if vcan else []),
            f"ExecStart={_ARMS_PROGRAM}/bin/python -P -m programs.contactd.contactd simulate "
            f"{_ARMS_PROGRAM}/arm --hand-socket {HAND}",
            f"User={NAME}",
            "Nice=-10",  # drives of an arm have processors of their own
            "AmbientCapabilities=CAP_SYS_NICE",  # for a real-time priority
            "RuntimeDirectory=simulated-arm",
            "[Install]",
            "WantedBy=multi-user.target",
            "",
        ])
    )  # fmt: skip
    run("systemctl", "daemon-reload", check=True)
    run("systemctl", "enable", "--now", ARM, check=True)
    wait_for(HAND.exists, "the arm")


def reach_the_bus_by_tcp() -> None:
    """As the head of that example says; can0 needs nothing of it."""
    head, _, _ = (EXAMPLES / "bus-tcp.conf").read_text().partition("\n[Unit]\n")
    there = Path("/etc/systemd/system/contactd.service.d")
    there.mkdir(parents=True, exist_ok=True)
    shutil.copy(EXAMPLES / "bus-tcp.conf", there / "bus.conf")
    for command in re.findall(r"^#   (systemctl .*)$", head, re.MULTILINE):
        run(*shlex.split(command), check=True)


def content(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def since_power_on_s() -> float:
    """When the service was ready [s, of the kernel's or the container's start]."""
    shown = run(
        "systemctl", "show", "contactd.service", "-p", "ActiveEnterTimestampMonotonic", "--value"
    )
    begun = run("systemctl", "show", "-p", "UserspaceTimestampMonotonic", "--value")
    kernel = 0.0 if run("systemd-detect-virt", "--container").returncode else int(begun.stdout)
    return (int(shown.stdout) - kernel) / 1e6


def pid() -> int:
    shown = run("systemctl", "show", "contactd.service", "-p", "MainPID", "--value")
    return int(shown.stdout)
