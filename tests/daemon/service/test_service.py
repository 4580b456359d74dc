"""The daemon behind its socket, in lockstep: rude clients, gains."""

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.rigs.served_daemon import ServedDaemon
from daemon.modes.table import Mode
from daemon.protocol.replies import Reply
from programs.clients.client import Client

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
def test_a_tick_serves_few_requests_and_a_disarm(served: ServedDaemon, name: str) -> None:
    """Counted, not timed: at most four requests in a tick, and a `disarm`; a person waits for none
    of them."""
    packets, connections = ATTACKS[name]
    served.rig.enable()
    handled: list[int] = [0]
    handle = served.service.commands.handle

    def counting(request: Any, peer: Any) -> Reply:
        handled[0] += 1
        return handle(request, peer)

    attack = rude(served.path, packets, connections)
    opened: list[socket.socket] = []
    for _ in range(30 if connections < 1000 else 260):
        for _ in range(4):
            opened = next(attack)
        handled[0] = 0
        served.rig.step()
        served.service.control.poll(counting)
        assert handled[0] <= 5
    assert served.service.control.connections <= 256
    assert served.rig.mode is Mode.HOLDING
    ticks = served.rig.ticks
    with Client(served.path) as person:
        assert served.ask(person, "disarm").ok
    assert served.rig.ticks - ticks < 60
    for one in opened:
        one.close()
    for _ in range(20):  # what was sent before is answered first, four requests a tick
        served.run(1.0)
    assert served.service.control.connections == 0


# --- gains --------------------------------------------------------------------------------------


def test_a_gain_is_shown_changed_and_reported(served: ServedDaemon) -> None:
    assert served.contactctl("gain").stdout.split() == ["joint", "0.3", "rad/s", "per", "Nm"]
    result = served.contactctl("gain", "joint", "0.05")
    assert (result.exit_code, result.stdout) == (0, "gain: joint 0.05 rad/s per Nm\n")
    assert served.contactctl("gain", "joint").stdout.split()[:2] == ["joint", "0.05"]
    served.run(0.6)
    gains = served.rig.tick.controller.motion.gains
    np.testing.assert_array_equal(gains.value, [0.05])


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["knee", "0.1"], 1, "no joint 'knee'; there are: joint"),
        (["joint", "6"], 1, "6 is not a gain: 0, or 0.0001 to 5 rad/s per Nm"),
        (["joint", "-0.1"], 1, "-0.1 is not a gain"),
        (["joint", "nan"], 2, "nan is not a gain"),
        (["joint", "soft"], 2, "'soft' is not a number"),
        (["knee"], 1, "no joint 'knee'; there are: joint"),
    ],
)
def test_invalid_gains(served: ServedDaemon, arguments: list[str], code: int, words: str) -> None:
    result = served.contactctl("gain", *arguments)
    assert result.exit_code == code
    assert words in result.stderr
    assert served.rig.tick.controller.motion.gains.goal[0] == 0.3


# --- the black box's helper ---------------------------------------------------------------------


def test_the_helper_is_checked_only_while_the_arm_rests_disarmed(served: ServedDaemon) -> None:
    seen: list[Mode] = []

    class Box:
        def look_after(self, _: float) -> None:
            seen.append(served.rig.mode)

    served.service.black_box = Box()
    served.run(3.0)
    served.rig.enable()
    served.run(3.0)
    assert set(seen) == {Mode.OFF, Mode.HOLDING}
    assert len(seen) == pytest.approx(served.rig.tick.number / 100, abs=1)
    before = len(seen)
    assert not served.rig.permit()
    served.run(3.0)
    assert (served.rig.mode, len(seen)) == (Mode.HOLDING, before)
    assert served.contactctl("disarm").exit_code == 0
    assert served.contactctl("start").exit_code == 0
    before = len(seen)
    served.run(3.0)
    assert served.rig.mode is Mode.TRACKING
    assert len(seen) == before
