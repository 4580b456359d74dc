"""Trajectories through the daemon's socket, from files and from programs, in lockstep."""

import json
import re
import socket
import threading
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.served_daemon import ServedDaemon, served_daemon
from common.errors import ControlError, LogError, TrajectoryError
from daemon.config.schema import Configuration, Trajectory
from daemon.modes.table import Mode
from daemon.motion.covered_range import CoveredRange
from daemon.motion.trajectory_file import read_trajectory
from programs.clients.client import Client
from programs.clients.trajectory_recorder import Recorded, record_trajectory


def stands(served: ServedDaemon) -> float:
    samples = served.rig.samples
    return float(samples.link_position[0])


def csv(tmp_path: Path, rows: list[tuple[object, ...]], header: str = "time_s,joint") -> Path:
    path = tmp_path / "move.csv"
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def swing(served: ServedDaemon, length_s: float = 2.0) -> list[tuple[object, ...]]:
    """0.3 rad forth and back from where the arm stands, 50 samples a second."""
    times = np.arange(0.0, length_s + 1e-9, 0.02)
    q = stands(served) + 0.15 * (1.0 - np.cos(2 * np.pi * times / length_s))
    return [(f"{t:.3f}", f"{x:.6f}") for t, x in zip(times, q, strict=True)]


def test_a_file_is_run_to_its_end(on: ServedDaemon, tmp_path: Path) -> None:
    began = stands(on)
    path = csv(tmp_path, swing(on))
    result = on.contactctl("start", str(path))
    assert (result.exit_code, result.stdout) == (0, "start: tracking, not armed\n"), result.stderr
    status = on.contactctl("status").stdout
    assert "move.csv at 0." in status
    farthest = began
    while on.rig.mode is Mode.TRACKING:
        on.tick()
        farthest = max(farthest, stands(on))
        assert on.rig.time_s < 30.0
    assert farthest - began == pytest.approx(0.3, abs=0.02)
    on.run(0.5)
    assert on.rig.mode is Mode.HOLDING
    assert stands(on) == pytest.approx(began, abs=0.01)
    assert on.rig.tick.controller.machine.cause == "move.csv came to its end"


def without_trajectory(c: Configuration) -> Configuration:
    return msgspec.structs.replace(c, trajectory=Trajectory())


def test_an_arm_without_a_trajectory_starts_only_a_file(tmp_path: Path) -> None:
    """As drafted."""
    with served_daemon(tmp_path, configure=without_trajectory) as served:
        served.rig.enable()
        assert "trajectory    none configured" in served.contactctl("status").stdout
        refused = served.contactctl("start")
        assert refused.exit_code == 1
        said = " ".join(refused.stderr.split())
        for words in ("no trajectory is configured", "start FILE.csv", "contactctl go", "config"):
            assert words in said
        assert served.rig.mode is Mode.HOLDING
        assert served.contactctl("start", str(csv(tmp_path, swing(served)))).exit_code == 0
        assert "move.csv at 0." in served.contactctl("status").stdout
        served.run(0.5)
        assert served.contactctl("pause").exit_code == 0
        assert served.contactctl("start").stdout == "start: tracking, not armed\n"


def test_an_arm_without_a_trajectory_yields_while_it_holds(tmp_path: Path) -> None:
    with served_daemon(tmp_path, configure=without_trajectory) as served:
        served.rig.enable()
        served.run(1.0)
        assert served.rig.permit() == []
        served.rig.arm.external_torque[0] = 3.0
        served.run(0.5)
        assert served.rig.mode is Mode.ADMITTANCE
        served.run(3.0)
        status = served.contactctl("status").stdout
        assert re.search(r"contact of \S+ Nm at joint.* \(3 s ago\)", status)


def test_a_path_beyond_what_the_thresholds_have_seen_is_started_with_a_warning(
    on: ServedDaemon, tmp_path: Path
) -> None:
    """0.3 rad within 2 s, up to 0.47 rad/s."""
    here = np.array([stands(on)])
    process = on.service.process

    def seen(speed: float, further: float) -> CoveredRange:
        return CoveredRange(np.array([speed]), here - further, here + further)

    for motion, words in (
        (seen(0.45, 0.25), []),
        (seen(0.3, 0.25), ["joint moves at up to 0.47 rad/s; its thresholds cover 0.3"]),
        (seen(0.45, 0.1), ["joint moves within ["]),
    ):
        process.seen = motion
        result = on.contactctl("start", str(csv(tmp_path, swing(on))))
        assert result.exit_code == 0, result.stderr
        reported = [line for line in result.stderr.splitlines() if "warning" in line]
        assert len(reported) == len(words), result.stderr
        assert all(word in line for word, line in zip(words, reported, strict=True)), reported
        while on.rig.mode is Mode.TRACKING:
            on.tick()
        on.run(0.5)


def test_the_name_of_a_file_forges_no_line(on: ServedDaemon, tmp_path: Path) -> None:
    forged = "\x1b[2Jmove\n[fault tick=7] heartbeat lost.csv"
    path = csv(tmp_path, swing(on)).rename(tmp_path / forged)
    result = on.contactctl("start", str(path))
    assert result.exit_code == 0, result.stderr
    machine = on.rig.tick.controller.machine
    assert machine.cause.startswith("start of ?[2Jmove?[fault tick=7] heartbeat lost.csv by uid ")
    assert "\x1b" not in on.contactctl("status").stdout


def test_a_paused_trajectory_continues(on: ServedDaemon, tmp_path: Path) -> None:
    assert on.contactctl("start", str(csv(tmp_path, swing(on)))).exit_code == 0
    on.run(1.0)
    assert on.contactctl("pause").exit_code == 0
    status = json.loads(on.contactctl("--json", "status").stdout)["trajectory"]
    assert (status["name"], status["state"], status["duration_s"]) == ("move.csv", "paused", 2.0)
    assert on.contactctl("start").exit_code == 0
    assert "move.csv at" in on.rig.tick.controller.machine.cause
    assert on.contactctl("stop").exit_code == 0
    assert on.contactctl("start").exit_code == 0
    assert "start of sinusoids" in on.rig.tick.controller.machine.cause


def test_a_bad_file_is_refused_with_its_line(on: ServedDaemon, tmp_path: Path) -> None:
    """One of them; all are in tests/daemon/motion, by sampled paths and their files."""
    path = csv(tmp_path, [(0, 0), (1, 0.1), (2, 1.5)])
    result = on.contactctl("start", str(path))
    assert result.exit_code == 65
    assert result.stderr.startswith(f"contactctl: {path}:4: joint: reaches 1.5 rad, outside its")
    assert result.stderr.count("\n") == 1
    assert on.rig.mode is Mode.HOLDING


def test_a_file_that_begins_elsewhere_needs_an_option(on: ServedDaemon, tmp_path: Path) -> None:
    here = stands(on)
    path = csv(tmp_path, [(0, here + 0.4), (1, here + 0.4), (2, here + 0.5)])
    result = on.contactctl("start", str(path))
    assert result.exit_code == 1
    assert "0.400 rad from where move.csv begins" in result.stderr
    assert on.contactctl("start", str(path), "--from-here").exit_code == 0
    assert on.contactctl("start", "--from-here").exit_code == 2


def test_a_program_loads_and_starts(on: ServedDaemon, client: Client) -> None:
    times = np.arange(0.0, 3.0, 0.01)
    q = stands(on) + 0.1 * np.sin(times)[:, None]
    v = 0.1 * np.cos(times)[:, None]
    on.until(lambda: client.load_trajectory(["joint"], times, q, v, name="fourier"))
    reply = on.until(client.start_loaded)
    assert reply.ok, reply.reasons
    on.run(2.0)
    follower = on.rig.tick.controller.motion.follower
    assert follower.place.path.name == "fourier"
    s = follower.place.s
    assert stands(on) == pytest.approx(float(q[0, 0]) + 0.1 * np.sin(s), abs=0.01)


@pytest.mark.parametrize(
    ("positions", "row", "words"),
    [
        ([[0.0], [0.1], [float("nan")]], 2, "must be numbers of at most"),
        ([[0.0], [0.1], [9.0]], 2, "jumps"),
        ([[0.0], [0.1, 0.2], [0.3]], 1, "2 positions for 1 joints"),
    ],
)
def test_a_bad_row_is_reported_with_its_number(
    served: ServedDaemon, client: Client, positions: list[list[float]], row: int, words: str
) -> None:
    velocities, times = [[0.0] * len(q) for q in positions], [0.0, 1.0, 2.0]
    with pytest.raises(TrajectoryError, match=words) as caught:
        served.until(lambda: client.load_trajectory(["joint"], times, positions, velocities))
    assert caught.value.row == row
    with pytest.raises(TrajectoryError, match="no joint `elbow`; there are: joint"):
        served.until(lambda: client.load_trajectory(["elbow"], [0.0, 1.0], [[0.0], [0.1]]))


def test_a_loaded_trajectory_belongs_to_its_connection(on: ServedDaemon, client: Client) -> None:
    rows = [[stands(on)], [stands(on)]]
    on.until(lambda: client.load_trajectory(["joint"], [0.0, 1.0], rows))
    with Client(on.path) as other:
        reply = on.until(other.start_loaded)
        assert not reply.ok
        assert "this connection has loaded no trajectory" in reply.message
        # Who begins another takes its place.
        on.until(lambda: other.load_trajectory(["joint"], [0.0, 1.0], rows))
        assert not on.until(client.start_loaded).ok
    on.run(0.02)
    with pytest.raises(ControlError, match="has loaded no trajectory"):
        on.service.commands.upload.take(2)


def test_an_incomplete_upload_is_no_trajectory(on: ServedDaemon) -> None:
    raw = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    raw.connect(str(on.path))

    def say(**request: object) -> dict[str, Any]:
        raw.send(json.dumps(request).encode())
        answer = on.until(lambda: raw.recv(10_000))
        return dict(json.loads(answer))

    with raw:
        assert "no trajectory" in say(command="load", rows=[[0, 0, 0]])["message"]
        assert say(command="load", header={"name": "x", "joints": ["joint"]})["ok"]
        assert say(command="load", rows=[[0, 0, 0]])["ok"]
        answer = say(command="start", loaded=True)
        assert (answer["ok"], "needs two or more" in answer["message"]) == (False, True)
        assert "unknown field `rows`" in say(command="stop", rows=[])["message"]
        assert on.rig.mode is Mode.HOLDING
    on.run(0.05)
    assert on.service.control.connections == 0


def test_a_recorded_lead_is_run_again(served: ServedDaemon, tmp_path: Path) -> None:
    """Recorded while a push leads the arm, then run."""
    path = tmp_path / "led.csv"
    served.rig.enable()
    began = stands(served)
    assert served.contactctl("arm").exit_code == 0
    with Client(served.path) as client:
        made: list[Recorded] = []

        def follow() -> None:
            made.append(record_trajectory(lambda: client, path, seconds=1.5))

        thread = threading.Thread(target=follow)
        thread.start()
        for tick in range(400):
            served.rig.arm.external_torque[0] = 2.5 if 30 <= tick < 110 else 0.0
            served.tick()
            thread.join(0.002)
            if not thread.is_alive():
                break
        assert not thread.is_alive()
    assert made[0].samples == pytest.approx(31, abs=2)
    assert made[0].duration_s == pytest.approx(1.5, abs=0.06)
    file = read_trajectory(path, ["joint"])
    assert abs(file.positions[0][0] - began) <= 0.101  # somewhere in its gap
    led = file.positions[-1][0] - file.positions[0][0]
    assert abs(stands(served) - began - led) <= 0.11
    assert abs(led) > 0.3
    assert served.contactctl("disarm").exit_code == 0
    served.run(0.7)
    here = stands(served)
    assert served.contactctl("start", "--speed", "0.5").exit_code == 2
    result = served.contactctl("start", str(path), "--from-here", "--speed", "0.5")
    assert result.exit_code == 0, result.stderr
    begun = served.rig.time_s
    while served.rig.mode is Mode.TRACKING:
        served.tick()
    assert served.rig.time_s - begun == pytest.approx(2.0 * made[0].duration_s + 2.0, abs=0.1)
    assert stands(served) - here == pytest.approx(led, abs=0.02)
    with pytest.raises(LogError, match="never overwritten"):
        record_trajectory(lambda: Client(served.path), path)
