"""The control socket against clients that are rude, slow, many, or gone."""

import json
import os
import socket
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon.protocol.messages import Reply, Request, Snapshot
from daemon.protocol.socket_path import Peer
from daemon.service.socket import ControlSocket
from errors import ModelError
from tests.examples import scaled

Dial = Callable[[], socket.socket]


class Handler:
    """Counts what arrives; answers a subscription with a snapshot."""

    def __init__(self, snapshot: Snapshot | None = None) -> None:
        self.seen: list[tuple[Request, Peer]] = []
        self.snapshot = snapshot

    def __call__(self, request: Request, peer: Peer) -> Reply:
        self.seen.append((request, peer))
        return Reply(ok=True, mode="off", snapshot=self.snapshot)


def told(client: socket.socket) -> dict[str, object]:
    reply = json.loads(client.recv(1 << 20))
    assert isinstance(reply, dict)
    return reply


def test_request_is_answered_and_the_peer_known(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    client = dial()
    control.poll(handler)
    client.send(b'{"command": "stop"}')
    control.poll(handler)
    assert told(client) == {"ok": True, "mode": "off"}
    assert handler.seen == [(Request("stop"), Peer(os.getuid(), os.getpid(), 1))]


@pytest.mark.parametrize(
    ("packet", "expected"),
    [
        (b"hello", "malformed"),
        (b"\xff\xfe", "malformed"),
        (b"[1]", "Expected `object`"),
        (b'{"command": "fly"}', "'fly'"),
        (b'{"command": "stop", "speed": 9}', "speed"),
        (b'{"command": "stop"} trailing', "trailing"),
        (b'"' + b"x" * 8192, "at most 8192 bytes"),
    ],
)
def test_malformed_is_told_and_the_connection_kept(
    control: ControlSocket, dial: Dial, packet: bytes, expected: str
) -> None:
    handler = Handler()
    client = dial()
    control.poll(handler)
    client.send(packet)
    control.poll(handler)
    reply = told(client)
    assert reply["ok"] is False
    assert expected in str(reply["message"])
    assert not handler.seen
    client.send(b'{"command": "stop"}')
    control.poll(handler)
    assert told(client)["ok"] is True


@pytest.mark.parametrize(
    ("command", "done"),
    [
        ("enable", False),
        ("start", False),
        ("arm", False),
        ("stop", True),
        ("disarm", True),
        ("pause", True),
        ("disable", True),
        ("reset", True),
    ],
)
def test_who_hung_up_can_stop_the_arm_and_not_let_it_move(
    control: ControlSocket, dial: Dial, command: str, done: bool
) -> None:
    """A person whose command was not answered in time walks up to an arm that must not start."""
    handler = Handler()
    client = dial()
    control.poll(handler)
    client.send(json.dumps({"command": command}).encode())
    client.close()
    control.poll(handler)
    assert bool(handler.seen) is done
    assert control.connections == 0


def test_largest_request_is_served(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    control.poll(Handler())
    client.send(b'{"command": "stop"}'.ljust(8192))
    control.poll(Handler())
    assert told(client)["ok"] is True


def test_ten_megabytes_never_reach_the_daemon(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    control.poll(Handler())
    with pytest.raises(OSError, match="too long"):
        client.send(bytes(10_000_000))
    client.send(bytes(100_000))
    control.poll(Handler())
    assert "at most 8192 bytes" in str(told(client)["message"])


@settings(max_examples=scaled(150), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(packet=st.binary(min_size=1, max_size=10000))
def test_garbage_is_refused(control: ControlSocket, dial: Dial, packet: bytes) -> None:
    handler = Handler()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as client:
        client.connect(str(control.path))
        control.poll(handler)
        client.send(packet)
        control.poll(handler)
        client.setblocking(False)
        assert told(client)["ok"] is False
    control.poll(handler)
    assert control.connections == 0
    assert not handler.seen


def test_error_of_the_handler_is_a_refusal(control: ControlSocket, dial: Dial) -> None:
    def refuse(request: Request, peer: Peer) -> Reply:
        raise ModelError("no such joint")

    client = dial()
    control.poll(refuse)
    client.send(b'{"command": "arm"}')
    control.poll(refuse)
    assert told(client) == {"ok": False, "message": "no such joint"}


def test_flood_is_bounded_and_starves_nobody(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    loud = [dial() for _ in range(8)]
    for _ in loud:
        control.poll(handler)
    for client in loud:
        for _ in range(50):
            client.send(b'{"command": "status"}')
    quiet = dial()
    quiet.send(b'{"command": "stop"}')
    for _ in range(8):
        before = len(handler.seen)
        control.poll(handler)
        assert 3 <= len(handler.seen) - before <= 4
    assert Request("stop") in [request for request, _ in handler.seen]
    assert told(quiet)["ok"] is True


def test_a_thousand_connections_lock_nobody_out(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    idle: list[socket.socket] = []
    for _ in range(1000):
        idle.append(dial())
        control.poll(handler)
    assert control.connections == 32
    person = dial()
    person.send(b'{"command": "disarm"}')
    for _ in range(2):
        control.poll(handler)
    assert told(person)["ok"] is True
    for client in idle[:969]:
        assert "closed to make room: more than 32" in str(told(client)["message"])
        assert client.recv(10) == b""
    with pytest.raises(BlockingIOError):
        idle[-1].recv(10)


def test_who_speaks_reads_or_owns_keeps_its_place(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    reader = dial()
    reader.send(b'{"command": "subscribe"}')
    control.poll(Handler(make_snapshot(0)))
    control.poll(Handler(make_snapshot(0)))
    assert told(reader)["snapshot"]
    handler = Handler()
    owner, silent, busy = dial(), dial(), dial()
    control.poll(handler)
    owner.send(b'{"command": "arm"}')
    control.poll(handler)
    control.spare = handler.seen[-1][1].connection
    for _ in range(60):
        dial()
        control.poll(handler)
        busy.send(b'{"command": "status"}')
        control.poll(handler)
        assert told(busy)["ok"]
    assert told(owner)["ok"]
    for client in (reader, owner):
        with pytest.raises(BlockingIOError):
            client.recv(10)
    assert "make room" in str(told(silent)["message"])


def test_accepts_are_bounded(control: ControlSocket, dial: Dial) -> None:
    for _ in range(20):
        dial()
    control.poll(Handler())
    assert control.connections == 4 * 4
    control.poll(Handler(), budget_s=0.0)
    assert control.connections == 20


def test_nothing_is_begun_when_the_time_is_over(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    clients = [dial() for _ in range(3)]
    control.poll(handler)
    for client in clients:
        client.send(b'{"command": "status"}')
    for served in (1, 2, 3, 3):
        control.poll(handler, budget_s=0.0)
        assert len(handler.seen) == served  # each its turn, however little time there is


def test_every_close_is_told(control: ControlSocket, dial: Dial) -> None:
    gone: list[int] = []
    control.on_close = lambda peer: gone.append(peer.connection)
    first, second = dial(), dial()
    control.poll(Handler())
    second.close()
    control.poll(Handler())
    assert gone == [2]
    first.close()
    control.poll(Handler())
    assert gone == [2, 1]


# Becomes nobody, with the given groups, and disarms. An error of the connection is reported once,
# ahead of the daemon's last words.
@pytest.mark.parametrize("how", ["close", "shutdown", "empty packet"])
def test_half_connected_client_is_dropped(control: ControlSocket, dial: Dial, how: str) -> None:
    client = dial()
    control.poll(Handler())
    assert control.connections == 1
    if how == "close":
        client.close()
    elif how == "shutdown":
        client.shutdown(socket.SHUT_WR)
    else:
        client.send(b"")
    control.poll(Handler())
    assert control.connections == 0


def test_client_that_never_listens_is_dropped(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    handler = Handler()
    control.poll(handler)
    for _ in range(100_000):
        try:
            client.send(b'{"command": "status"}')
        except OSError:
            break
        control.poll(handler)
        if not control.connections:
            break
    assert control.connections == 0


def test_client_gone_before_its_answer(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    handler = Handler()
    control.poll(handler)
    client.send(b'{"command": "stop"}')
    client.close()
    control.poll(handler)
    assert handler.seen  # a stop counts although nobody waits for the answer
    assert control.connections == 0
