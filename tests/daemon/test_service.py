"""The whole daemon behind its socket, in lockstep with the simulated arm: what a client gets."""

import contextlib
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bench.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.client import Client
from daemon.commands import contactctl
from daemon.control import ControlSocket
from daemon.loop import Clock, Loop
from daemon.messages import Reply, Request
from daemon.modes import Mode
from daemon.notify import Notifier
from daemon.service import Service
from daemon.trajectory_file import read_trajectory
from daemon.trajectory_recorder import Recorded, record_trajectory
from errors import ControlError, LogError, TrajectoryError

T = 0.01


@dataclass
class House:
    """Service, loop and simulated arm; time passes by `tick` alone."""

    rig: Rig
    service: Service

    @property
    def path(self) -> Path:
        return self.service.control.path

    def tick(self) -> None:
        self.rig.tick()
        self.service.doors()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / T)):
            self.tick()

    def until(self, work: Callable[[], Any]) -> Any:
        """Tick while `work`, which talks to the daemon, runs in a thread of its own."""
        results: list[Any] = []
        errors: list[BaseException] = []

        def run() -> None:
            try:
                results.append(work())
            except BaseException as error:
                errors.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        while thread.is_alive():
            self.tick()
            thread.join(0.0005)
        if errors:
            raise errors[0]
        return results[0]

    def ask(self, client: Client, command: Any) -> Reply:
        reply = self.until(lambda: client.request(command))
        assert isinstance(reply, Reply)
        return reply

    def contactctl(self, *arguments: str) -> Result:
        result = self.until(
            lambda: CliRunner().invoke(
                contactctl.main, ["--socket", str(self.path), *arguments], catch_exceptions=False
            )
        )
        assert isinstance(result, Result)
        return result


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    with lockstep_rig(SINGLE_JOINT) as rig, ControlSocket(tmp_path / "control") as control:
        c = rig.robot.configuration
        loop = Loop(rig.cycle, Clock(lambda: rig.time_s, lambda _: None), c.period_s)
        notifier = Notifier()
        rig.run(0.1)
        yield House(rig, Service(rig.robot, loop, control, [], 1, notifier))
        notifier.close()


@pytest.fixture
def client(house: House) -> Iterator[Client]:
    with Client(house.path) as connected:
        yield connected


def stands(house: House) -> float:
    samples = house.rig.cycle.samples
    assert samples is not None
    return float(samples.link_position[0])


def csv(tmp_path: Path, rows: list[tuple[object, ...]], header: str = "time_s,joint") -> Path:
    path = tmp_path / "move.csv"
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def swing(house: House, length_s: float = 2.0) -> list[tuple[object, ...]]:
    """0.3 rad forth and back from where the arm stands, 50 samples a second."""
    times = np.arange(0.0, length_s + 1e-9, 0.02)
    q = stands(house) + 0.15 * (1.0 - np.cos(2 * np.pi * times / length_s))
    return [(f"{t:.3f}", f"{x:.6f}") for t, x in zip(times, q, strict=True)]


def test_a_file_is_run_to_its_end(house: House, tmp_path: Path) -> None:
    house.rig.enable()
    began = stands(house)
    path = csv(tmp_path, swing(house))
    result = house.contactctl("start", str(path))
    assert (result.exit_code, result.stdout) == (0, "start: tracking, not armed\n"), result.stderr
    status = house.contactctl("status").stdout
    assert "move.csv at 0." in status
    farthest = began
    while house.rig.mode is Mode.TRACKING:
        house.tick()
        farthest = max(farthest, stands(house))
        assert house.rig.time_s < 30.0
    assert farthest - began == pytest.approx(0.3, abs=0.02)
    house.run(0.5)
    assert house.rig.mode is Mode.HOLDING
    assert stands(house) == pytest.approx(began, abs=0.01)
    assert house.rig.cycle.controller.machine.cause == "move.csv came to its end"


def test_it_is_paused_and_goes_on(house: House, tmp_path: Path) -> None:
    house.rig.enable()
    assert house.contactctl("start", str(csv(tmp_path, swing(house)))).exit_code == 0
    house.run(1.0)
    assert house.contactctl("pause").exit_code == 0
    status = json.loads(house.contactctl("--json", "status").stdout)["trajectory"]
    assert (status["name"], status["state"], status["duration_s"]) == ("move.csv", "paused", 2.0)
    assert house.contactctl("start").exit_code == 0
    assert "move.csv at" in house.rig.cycle.controller.machine.cause
    assert house.contactctl("stop").exit_code == 0
    assert house.contactctl("start").exit_code == 0
    assert "start of sinusoids" in house.rig.cycle.controller.machine.cause


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (
            [(0, 0), (1, 0.1), (2, 1.5)],
            ":4: joint: reaches 1.5 rad, outside its limits [-1.4, 1.4]",
        ),
        ([(0, 0), (1, 0.1), (1.01, 0.9)], ":4: joint: jumps by 0.8 rad in 0.01 s: 80 rad/s is"),
        ([(0, 0), (0.1, 0.1), (0.2, 0)], ":3: joint: reaches"),
        ([(0, 0), (1, 0.1), (2, "nan")], ":4: joint: nan is no number"),
        ([(0, 0), (1, 0.1), (0.5, 0.1)], ":4: time_s: 0.5 does not come after 1"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(
    house: House, tmp_path: Path, rows: list[tuple[object, ...]], words: str
) -> None:
    house.rig.enable()
    path = csv(tmp_path, rows)
    result = house.contactctl("start", str(path))
    assert result.exit_code == 65
    assert result.stderr.startswith(f"contactctl: {path}{words}")
    assert result.stderr.count("\n") == 1
    assert house.rig.mode is Mode.HOLDING


def test_a_file_that_begins_elsewhere_needs_a_word(house: House, tmp_path: Path) -> None:
    house.rig.enable()
    here = stands(house)
    path = csv(tmp_path, [(0, here + 0.4), (1, here + 0.4), (2, here + 0.5)])
    result = house.contactctl("start", str(path))
    assert result.exit_code == 1
    assert "0.400 rad from where move.csv begins" in result.stderr
    assert house.contactctl("start", str(path), "--from-here").exit_code == 0
    assert house.contactctl("start", "--from-here").exit_code == 2


def test_a_program_loads_and_starts(house: House, client: Client) -> None:
    house.rig.enable()
    times = np.arange(0.0, 3.0, 0.01)
    q = stands(house) + 0.1 * np.sin(times)[:, None]
    v = 0.1 * np.cos(times)[:, None]
    house.until(lambda: client.load_trajectory(["joint"], times, q, v, name="fourier"))
    reply = house.until(client.start_loaded)
    assert reply.ok, reply.reasons
    house.run(2.0)
    follower = house.rig.cycle.controller.motion.follower
    assert follower.place.path.name == "fourier"
    s = follower.place.s
    assert stands(house) == pytest.approx(float(q[0, 0]) + 0.1 * np.sin(s), abs=0.01)


@pytest.mark.parametrize(
    ("positions", "row", "words"),
    [
        ([[0.0], [0.1], [float("nan")]], 2, "cannot be followed"),
        ([[0.0], [0.1], [9.0]], 2, "jumps"),
        ([[0.0], [0.1, 0.2], [0.3]], 1, "2 positions for 1 joints"),
    ],
)
def test_a_program_is_told_the_row(
    house: House, client: Client, positions: list[list[float]], row: int, words: str
) -> None:
    velocities = [[0.0] * len(q) for q in positions]
    with pytest.raises(TrajectoryError, match=words) as caught:
        house.until(
            lambda: client.load_trajectory(["joint"], [0.0, 1.0, 2.0], positions, velocities)
        )
    assert caught.value.row == row
    with pytest.raises(TrajectoryError, match="no joint `elbow`; there are: joint"):
        house.until(lambda: client.load_trajectory(["elbow"], [0.0, 1.0], [[0.0], [0.1]]))


def test_what_was_loaded_belongs_to_its_connection(house: House, client: Client) -> None:
    house.rig.enable()
    rows = [[stands(house)], [stands(house)]]
    house.until(lambda: client.load_trajectory(["joint"], [0.0, 1.0], rows))
    with Client(house.path) as other:
        reply = house.until(other.start_loaded)
        assert not reply.ok
        assert "this connection has loaded no trajectory" in reply.message
        # Whoever begins another takes its place.
        house.until(lambda: other.load_trajectory(["joint"], [0.0, 1.0], rows))
        assert not house.until(client.start_loaded).ok
    house.run(0.02)
    with pytest.raises(ControlError, match="has loaded no trajectory"):
        house.service.dock.take(2)


def test_half_an_upload_is_no_trajectory(house: House) -> None:
    house.rig.enable()
    raw = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    raw.connect(str(house.path))

    def say(**request: object) -> dict[str, Any]:
        raw.send(json.dumps(request).encode())
        answer = house.until(lambda: raw.recv(10_000))
        return dict(json.loads(answer))

    with raw:
        assert "no trajectory" in say(command="load", rows=[[0, 0, 0]])["message"]
        assert say(command="load", header={"name": "x", "joints": ["joint"]})["ok"]
        assert say(command="load", rows=[[0, 0, 0]])["ok"]
        answer = say(command="start", loaded=True)
        assert (answer["ok"], "needs two or more" in answer["message"]) == (False, True)
        assert say(command="stop", rows=[])["reasons"] == ["`rows` belongs to load"]
        assert say(command="load", loaded=True)["reasons"] == ["`loaded` belongs to start"]
        assert house.rig.mode is Mode.HOLDING
    house.run(0.05)
    assert house.service.control.connections == 0


def test_what_was_led_by_hand_is_done_again(house: House, tmp_path: Path) -> None:
    """Recorded while a push leads the arm, then run."""
    path = tmp_path / "led.csv"
    house.rig.enable()
    began = stands(house)
    assert house.contactctl("arm").exit_code == 0
    with Client(house.path) as client:
        made: list[Recorded] = []

        def follow() -> None:
            made.append(record_trajectory(lambda: client, path, seconds=1.5))

        thread = threading.Thread(target=follow)
        thread.start()
        for tick in range(400):
            house.rig.arm.external_torque[0] = 2.0 if 30 <= tick < 110 else 0.0
            house.tick()
            thread.join(0.002)
            if not thread.is_alive():
                break
        assert not thread.is_alive()
    assert made[0].samples == pytest.approx(31, abs=2)
    assert made[0].duration_s == pytest.approx(1.5, abs=0.06)
    file = read_trajectory(path, ["joint"])
    assert abs(file.positions[0][0] - began) <= 0.101  # somewhere in its gap
    led = file.positions[-1][0] - file.positions[0][0]
    assert abs(stands(house) - began - led) <= 0.11
    assert abs(led) > 0.3
    assert house.contactctl("disarm").exit_code == 0
    house.run(0.7)
    here = stands(house)
    assert house.contactctl("start", "--speed", "0.5").exit_code == 2
    result = house.contactctl("start", str(path), "--from-here", "--speed", "0.5")
    assert result.exit_code == 0, result.stderr
    begun = house.rig.time_s
    while house.rig.mode is Mode.TRACKING:
        house.tick()
    assert house.rig.time_s - begun == pytest.approx(2.0 * made[0].duration_s + 2.0, abs=0.1)
    assert stands(house) - here == pytest.approx(led, abs=0.02)
    with pytest.raises(LogError, match="never overwritten"):
        record_trajectory(lambda: Client(house.path), path)


# --- arming -------------------------------------------------------------------------------------


def armed(house: House) -> bool:
    return house.rig.cycle.controller.machine.armed


def cause_of_disarming(house: House) -> str:
    texts = [e.text for e in house.rig.cycle.events if e.text.startswith("disarmed")]
    return texts[0] if texts else ""


def until_disarmed(house: House, limit_s: float) -> tuple[float, str]:
    begun = house.rig.time_s
    while armed(house):
        house.tick()
        assert house.rig.time_s - begun < limit_s
    took = house.rig.time_s - begun
    house.rig.tick()
    return took, cause_of_disarming(house)


def test_arm_shows_every_check_and_who_armed(house: House) -> None:
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


def test_arm_is_refused_with_the_checks_that_failed(house: House) -> None:
    result = house.contactctl("arm")
    assert (result.exit_code, result.stdout) == (1, "")
    failed = [line for line in result.stderr.splitlines() if line.startswith("failed")]
    assert failed == ["failed  mode            the drives are off (`contactctl enable` first)"]
    assert result.stderr.splitlines()[-1] == "contactctl: arm: refused"
    answer = json.loads(house.contactctl("--json", "arm").stdout)
    assert [c["name"] for c in answer["checks"] if not c["passed"]] == ["mode"]
    assert not armed(house)


def test_a_persons_lease_outlives_the_connection_and_runs_out(house: House) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", "1.5").exit_code == 0
    assert house.service.control.connections <= 1
    took, cause = until_disarmed(house, 2.0)
    assert took == pytest.approx(1.5, abs=0.1)
    assert cause == f"disarmed: the lease of uid {os.getuid()} (pid {os.getpid()}) ran out"
    assert house.rig.mode is Mode.HOLDING


def test_arming_again_renews(house: House) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", "1").exit_code == 0
    house.run(0.7)
    renewed = house.contactctl("arm", "--lease", "1")
    assert renewed.stdout == "arm: holding, armed for 1.0 s\n"  # no checks: it is armed already
    took, _ = until_disarmed(house, 2.0)
    assert took == pytest.approx(1.0, abs=0.1)


def test_a_program_holds_its_lease_by_renewing(house: House, client: Client) -> None:
    house.rig.enable()
    for _ in range(3):
        assert house.until(client.arm).ok
        house.run(0.4)
        assert armed(house)
    took, cause = until_disarmed(house, 1.0)
    assert took <= 0.11
    assert "ran out" in cause


def test_a_program_that_is_gone_leaves_the_arm_holding(house: House) -> None:
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


def test_while_guided_the_owner_renews(house: House, client: Client) -> None:
    house.rig.enable()
    assert house.until(client.arm).ok
    house.rig.arm.external_torque[0] = 3.0
    for _ in range(4):
        house.run(0.3)
        assert house.until(client.arm).ok
    assert house.rig.mode is Mode.ADMITTANCE


def test_another_owner_is_refused_and_everybody_disarms(house: House, client: Client) -> None:
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
def test_impossible_leases(house: House, lease: object) -> None:
    house.rig.enable()
    assert house.contactctl("arm", "--lease", str(lease)).exit_code == 2
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as raw:
        raw.connect(str(house.path))
        raw.send(json.dumps({"command": "arm", "lease_s": lease}).encode())
        assert "not a request" in json.loads(house.until(lambda: raw.recv(10_000)))["message"]
    assert not armed(house)


def test_disarm_works_in_every_mode(house: House) -> None:
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


# --- clients that are rude ----------------------------------------------------------------------


def rude(path: Path, packets: list[bytes], connections: int) -> Iterator[list[socket.socket]]:
    """Sockets that send without ever waiting or reading; each `next` is one more round."""
    opened: list[socket.socket] = []
    while True:
        if len(opened) < connections:
            one = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
            opened.append(one)
            with contextlib.suppress(OSError):
                one.connect(str(path))
        for i, one in enumerate(opened if packets else ()):
            with contextlib.suppress(OSError):
                one.send(packets[i % len(packets)])
        yield opened


ATTACKS: dict[str, tuple[list[bytes], int]] = {
    "flood": ([b'{"command":"status"}'], 16),
    "garbage": ([bytes(range(256)) * 8, b"[" * 8000, b'{"command":', b"\xff" * 100], 16),
    "10 MB": ([b"x" * 10_000_000, b"x" * 150_000], 8),
    "readers": ([b'{"command":"subscribe"}'], 16),
    "arm and disarm": ([b'{"command":"arm"}', b'{"command":"disarm"}'], 8),
    "half a trajectory": (
        [b'{"command":"load","header":{"name":"x","joints":["joint"]}}', b'{"command":"load"}'],
        8,
    ),
    "1000 connections": ([], 1000),
}


@pytest.mark.parametrize("name", list(ATTACKS))
def test_whatever_clients_do_a_tick_does_little_and_disarm_comes_through(
    house: House, name: str
) -> None:
    """Counted, not timed: at most four requests in a tick; a person waits for few ticks."""
    packets, connections = ATTACKS[name]
    house.rig.enable()
    served: list[int] = [0]
    handle = house.service.handle

    def counting(request: Any, peer: Any) -> Reply:
        served[0] += 1
        return handle(request, peer)

    attack = rude(house.path, packets, connections)
    opened: list[socket.socket] = []
    for _ in range(30 if connections < 1000 else 260):
        for _ in range(4):
            opened = next(attack)
        served[0] = 0
        house.rig.tick()
        house.service.control.poll(counting)
        assert served[0] <= 4
    assert house.service.control.connections <= 32
    assert house.rig.mode is Mode.HOLDING
    ticks = house.rig.ticks
    with Client(house.path) as person:
        assert house.ask(person, "disarm").ok
    assert house.rig.ticks - ticks < 60
    for one in opened:
        one.close()
    house.run(0.5)
    assert house.service.control.connections == 0


# --- gains --------------------------------------------------------------------------------------


def test_a_gain_is_shown_changed_and_told(house: House) -> None:
    assert house.contactctl("gain").stdout.split() == ["joint", "0.3"]
    result = house.contactctl("gain", "joint", "0.05")
    assert (result.exit_code, result.stdout) == (0, "gain: joint 0.05 rad/s per Nm\n")
    assert house.contactctl("gain", "joint").stdout.split() == ["joint", "0.05"]
    house.run(0.6)
    gains = house.rig.cycle.controller.motion.gains
    np.testing.assert_array_equal(gains.value, [0.05])


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["knee", "0.1"], 1, "no joint 'knee'; there are: joint"),
        (["joint", "6"], 1, "6 is not a gain: 0 to 5 rad/s per Nm"),
        (["joint", "-0.1"], 1, "-0.1 is not a gain"),
        (["joint", "nan"], 2, "nan is not a gain"),
        (["joint", "soft"], 2, "'soft' is not a valid float"),
        (["knee"], 2, "no joint 'knee'; there are: joint"),
    ],
)
def test_what_is_no_gain_is_refused(
    house: House, arguments: list[str], code: int, words: str
) -> None:
    result = house.contactctl("gain", *arguments)
    assert result.exit_code == code
    assert words in result.stderr
    assert house.rig.cycle.controller.motion.gains.goal[0] == 0.3


def test_a_gain_needs_its_joint_and_belongs_to_its_command(house: House, client: Client) -> None:
    for request, reason in (
        (Request("gain", joint="joint"), "it takes a `joint` and a `gain`"),
        (Request("gain"), "it takes a `joint` and a `gain`"),
        (Request("arm", gain=1.0), "`gain` belongs to gain"),
    ):
        reply = house.until(lambda asked=request: client.ask(asked))
        assert (reply.ok, reply.reasons) == (False, [reason])
