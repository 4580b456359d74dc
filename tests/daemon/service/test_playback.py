"""Playback as in docs/playback.md: led by hand, recorded, moved back, and played."""

import re
import threading
from contextlib import nullcontext
from pathlib import Path

import pytest
from click.testing import CliRunner

from bench.rigs.served_daemon import ServedDaemon
from daemon.modes.table import Mode
from programs.clients.client import Client
from programs.clients.trajectory_recorder import Recorded, record_trajectory
from programs.contactctl import contactctl, go


def test_a_led_motion_is_played_back(served: ServedDaemon, tmp_path: Path) -> None:
    path, rig = tmp_path / "move.csv", served.rig
    assert served.contactctl("enable").exit_code == 0
    assert served.contactctl("arm").exit_code == 0
    made = _led(served, path, torque=2.5)
    assert made.samples > 25
    served.run(2.5)
    assert rig.mode is Mode.HOLDING
    left = _stands(served)

    refused = served.contactctl("start", str(path), "--speed", "0.3")
    assert refused.exit_code == 1, refused.output
    way = re.search(r"`contactctl (go [^`]+)` leads there", refused.stderr)
    assert way is not None, refused.stderr
    target = float(way[1].split("=")[1])
    reply = served.until(lambda: _go(served, target))
    assert reply.ok, reply.reasons
    _to_the_end(served)
    assert _stands(served) == pytest.approx(target, abs=0.02)

    assert served.contactctl("start", str(path), "--speed", "0.3").exit_code == 0
    _to_the_end(served)
    assert rig.tick.controller.machine.cause == "move.csv came to its end"
    # Its link may stand elsewhere in its gap.
    assert _stands(served) == pytest.approx(left, abs=0.11)


def test_a_lead_is_repeated_by_one_command(
    served: ServedDaemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Signals reach the main thread alone, and here that ticks.
    monkeypatch.setattr(go, "_interrupted", lambda: nullcontext(lambda: False))
    path, rig = tmp_path / "move.csv", served.rig
    refused = served.contactctl("playback", str(path))
    assert refused.exit_code == 2  # not armed: nothing would lead it
    assert not path.exists()
    assert served.contactctl("playback", 300 * "a").exit_code == 2  # the system refuses to look
    assert served.contactctl("enable").exit_code == 0
    assert served.contactctl("arm").exit_code == 0
    begin = _stands(served)
    words, done = ["--socket", str(served.path), "playback", str(path), "--yes"], []
    typed = threading.Thread(target=lambda: done.append(CliRunner().invoke(contactctl.main, words)))
    typed.start()
    tick, left = 0, begin
    while typed.is_alive():
        rig.arm.external_torque[0] = 2.5 if 30 <= tick < 110 else 0.0
        served.tick()
        tick += bool(served.service.control.readers)
        left = _stands(served) if rig.mode is Mode.ADMITTANCE else left
        typed.join(0.0005)
    assert done[0].exit_code == 0, done[0].output
    assert "the recording ends when it holds or continues" in done[0].stderr
    assert abs(left - begin) > 0.15
    assert _stands(served) == pytest.approx(begin, abs=0.03)
    kept = re.search(r"(\d+) of (\d+) samples, [\d.]+ s, at (\d+)% of its speed", done[0].stdout)
    assert kept is not None, done[0].stdout
    assert 3 <= int(kept[1]) < int(kept[2]) / 3
    assert 0 < int(kept[3]) <= 100
    _to_the_end(served)
    assert rig.tick.controller.machine.cause == "move.csv came to its end"
    assert _stands(served) == pytest.approx(left, abs=0.11)

    again = served.contactctl("playback", str(path), "--yes", "--speed", "0.5")
    assert again.exit_code == 0, again.output
    assert "at 50% of its speed" in again.stdout
    _to_the_end(served)
    path.write_text("time_s,joint\n0,0.1\n1,0.1\n2,0.1\n")
    still = served.contactctl("playback", str(path), "--yes")
    assert still.exit_code == 65
    assert "delete the file to record a lead" in still.stderr
    path.write_text("time_s,joint\n0,0.1\n1,1.45\n2,0.1\n")
    beyond = served.contactctl("playback", str(path), "--yes")
    assert beyond.exit_code == 65
    assert f"limits [-1.4, 1.4]; delete {path} and lead the arm less far\n" in beyond.stderr
    path.write_text("time_s,joint\n0,0.1\n1,0.2\n2,0.1\n")
    assert served.contactctl("disable").exit_code == 0
    off = served.contactctl("playback", str(path), "--yes")
    assert off.stderr.startswith("contactctl: playback: refused\n")


def _led(served: ServedDaemon, path: Path, torque: float) -> Recorded:
    """Recorded for 1.5 s, in which a hand leads the joint for 0.8."""
    made: list[Recorded] = []
    with Client(served.path) as client:
        thread = threading.Thread(
            target=lambda: made.append(record_trajectory(lambda: client, path, seconds=1.5))
        )
        thread.start()
        tick = 0  # since the recorder reads, however long the machine lets it wait
        while thread.is_alive():
            served.rig.arm.external_torque[0] = torque if 30 <= tick < 110 else 0.0
            served.tick()
            tick += bool(served.service.control.readers)
            thread.join(0.002)
    served.rig.arm.external_torque[0] = 0.0
    return made[0]


def _go(served: ServedDaemon, target: float):
    with Client(served.path) as client:
        return client.go(targets={"joint": target})


def _to_the_end(served: ServedDaemon) -> None:
    begun = served.rig.time_s
    while served.rig.mode is Mode.TRACKING:
        served.tick()
        assert served.rig.time_s - begun < 60.0
    served.run(0.3)


def _stands(served: ServedDaemon) -> float:
    return float(served.rig.samples.link_position[0])
