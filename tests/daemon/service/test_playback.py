"""docs/playback.md: led by hand, recorded, brought back, and played, as the page says."""

import re
import threading
from pathlib import Path

import pytest

from bench.rigs.served_daemon import ServedDaemon
from daemon.modes.table import Mode
from programs.clients.client import Client
from programs.clients.trajectory_recorder import Recorded, record_trajectory


def test_what_was_led_is_played(served: ServedDaemon, tmp_path: Path) -> None:
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
