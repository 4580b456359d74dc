"""Targets from the network: publishers that are followed, orders of joints, and ends."""

import errno
import itertools
import struct
from collections.abc import Sequence
from typing import Any

import pytest
import zenoh
from click.testing import CliRunner

from common.errors import ControlError
from programs.zenoh import topics
from programs.zenoh.cdr import CdrError
from programs.zenoh.contactd_zenoh import main
from programs.zenoh.following import SILENT_S, Following, in_order
from programs.zenoh.messages import JointStates, JointTarget, read_joint_target
from programs.zenoh.names import attachment
from tests.programs.zenoh.bridge import Bridge, until

A, B = b"a" * 16, b"b" * 16
JOINTS = ["one", "two"]


def message(
    names: Sequence[str] = JOINTS,
    position: Sequence[float] = (0.1, 0.2),
    velocity: Sequence[float] = (1.0, 2.0),
    stamp_s: float = 5.5,
) -> bytes:
    return JointStates(names, motion=True).encode(stamp_s, [0.0] * len(names), position, velocity)


class Line:
    """Stream that keeps what it is sent, and refuses from the target `until` on."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.closed, self.refuses = False, False

    def to(self, q: Any, velocity: Any, sent_s: Any) -> None:
        if self.refuses:
            raise ControlError("stop by uid 0")
        self.sent.append((q, velocity, sent_s))

    def close(self) -> None:
        self.closed = True


class Network:
    """Publishers, and the lines that are opened for them."""

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.said: list[str] = []
        self.now_s = 10.0
        self.error: OSError | None = None
        self.following = Following(self._connect, lambda: JOINTS, self.said.append)

    def _connect(self) -> Line:
        if self.error:
            raise self.error
        self.lines.append(Line())
        return self.lines[-1]

    def send(
        self, payload: bytes | None = None, publisher: bytes = A, after_s: float = 0.01
    ) -> None:
        self.now_s += after_s
        self.following.take(payload or message(), publisher, 7.0, self.now_s)


def test_names_may_come_in_any_order() -> None:
    network = Network()
    network.send(message(["two", "one"], (0.2, 0.1), (2.0, 1.0)))
    assert network.lines[0].sent == [([0.1, 0.2], [1.0, 2.0], 5.5)]
    network.send(message(stamp_s=0.0))
    assert network.lines[0].sent[1][2] == 7.0  # without a stamp, when it was sent


def test_a_stream_that_was_stopped_does_not_begin_again_by_itself() -> None:
    network = Network()
    network.send()
    network.lines[0].refuses = True
    for _ in range(200):
        network.send()
    assert len(network.lines) == 1
    assert network.lines[0].closed
    assert "until it falls silent: stop by uid 0" in network.said[-1]
    network.send(after_s=SILENT_S + 0.01)
    assert len(network.lines) == 2


def test_an_error_of_the_machine_refuses_and_ends_nothing() -> None:
    network = Network()
    network.error = OSError(errno.EMFILE, "Too many open files")
    network.send()
    assert "Too many open files" in network.said[-1]
    network.error = None
    network.send(after_s=2.0 * SILENT_S)
    assert network.lines[-1].sent


def test_only_one_publisher_is_followed_at_a_time() -> None:
    network = Network()
    network.send()
    for _ in range(30):
        network.send(publisher=B)
        network.send()
    assert len(network.lines) == 1
    assert len(network.lines[0].sent) == 31
    assert [line for line in network.said if B.hex() in line] == [
        f"does not follow publisher {B.hex()} until it falls silent: another publisher is streaming"
    ]


def test_the_stream_of_a_silent_publisher_is_ended() -> None:
    network = Network()
    network.send()
    network.following.look(network.now_s + SILENT_S + 0.01)
    assert network.lines[0].closed
    assert network.said[-1].endswith("fell silent: its stream is ended")


@pytest.mark.parametrize(
    ("names", "position"),
    [(["one"], (0.1,)), (["one", "one"], (0.1, 0.2)), (["one", "three"], (0.1, 0.2)), ([], ())],
)
def test_other_joints_are_refused(names: list[str], position: tuple[float, ...]) -> None:
    with pytest.raises(CdrError, match="must name each joint once"):
        in_order(JointTarget(0.0, names, list(position), []), JOINTS)


def test_a_publisher_without_a_name_is_refused() -> None:
    network = Network()
    network.send(publisher=bytes(16))
    assert network.lines == []


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\0\1\0\0",
        message()[:-60],
        message(position=(float("nan"), 0.0)),
        message(position=(0.0, float("inf"))),
        b"\0\1\0\0" + struct.pack("<iII", 0, 0, 1) + b"\0\0\0\0" + struct.pack("<I", 10**6),
    ],
    ids=["empty", "header", "cut off", "NaN", "infinite", "a million names"],
)
def test_invalid_payloads_are_refused(payload: bytes) -> None:
    network = Network()
    network.send(payload or b"\0")
    assert network.lines == [] or network.lines[0].sent == []
    with pytest.raises(CdrError):
        read_joint_target(payload)


def test_it_needs_the_control_socket() -> None:
    result = CliRunner().invoke(main, ["--allow-follow"])
    assert result.exit_code == 2
    assert "--allow-follow needs --control-socket" in result.stderr


def test_targets_of_a_router_reach_the_daemon(
    fake_daemon: Any, routed: int, other: zenoh.Session
) -> None:
    bridge = Bridge(fake_daemon.path, f"tcp/127.0.0.1:{routed}", following=True)
    try:
        bridge.joined()
        until(lambda: bridge.heard("may stream targets"))
        names = fake_daemon.status().joints
        key = bridge.node.key(topics.targets(bridge.node))
        payload = message(names, [0.0] * len(names), [0.0] * len(names))
        numbers = itertools.count(1)

        def sent() -> bool:
            other.put(key, payload, attachment=attachment(next(numbers), 10**18, A))
            return {"follow", "target"} <= {command for command, _ in fake_daemon.seen}

        until(sent)
        assert bridge.heard(f"follows publisher {A.hex()}")
    finally:
        bridge.close()
