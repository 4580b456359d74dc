"""The control socket against clients that are rude, slow, many, or gone."""

import json
import os
import select
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon.control import ControlSocket
from daemon.messages import Reply, Request, Snapshot, State
from daemon.peers import Peer
from errors import ModelError

Dial = Callable[[], socket.socket]


@pytest.fixture
def control(tmp_path: Path) -> Iterator[ControlSocket]:
    with ControlSocket(tmp_path / "control") as opened:
        yield opened


@pytest.fixture
def dial(control: ControlSocket) -> Iterator[Dial]:
    """Connects without blocking; everything is closed at the end."""
    opened: list[socket.socket] = []

    def connect() -> socket.socket:
        opened.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK))
        opened[-1].connect(str(control.path))
        return opened[-1]

    yield connect
    for one in opened:
        one.close()


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


def subscribed(control: ControlSocket, dial: Dial, snapshot: Snapshot) -> socket.socket:
    client = dial()
    client.send(b'{"command": "subscribe"}')
    control.poll(Handler(snapshot))
    control.poll(Handler(snapshot))
    assert told(client)["snapshot"]
    return client


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


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
    reader = subscribed(control, dial, make_snapshot(0))
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


def test_every_reader_gets_every_state(
    control: ControlSocket,
    dial: Dial,
    make_state: Callable[..., State],
    make_snapshot: Callable[[int], Snapshot],
) -> None:
    first = subscribed(control, dial, make_snapshot(0))
    second = subscribed(control, dial, make_snapshot(0))
    silent = dial()
    control.poll(Handler())
    for tick in (1, 2, 3):
        control.publish(make_state(tick))
    for client in (first, second):
        assert [told(client)["tick"] for _ in range(3)] == [1, 2, 3]
    with pytest.raises(BlockingIOError):
        silent.recv(10)


def test_nothing_is_encoded_without_a_reader(
    control: ControlSocket, dial: Dial, make_state: Callable[..., State]
) -> None:
    dial()
    control.poll(Handler())
    control.publish(make_state(1))
    assert control._packet == b""


def test_ninth_reader_is_refused(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    readers = [subscribed(control, dial, make_snapshot(0)) for _ in range(8)]
    ninth = dial()
    ninth.send(b'{"command": "subscribe"}')
    handler = Handler(make_snapshot(0))
    control.poll(handler)
    control.poll(handler)
    assert told(ninth) == {"ok": False, "message": "too many readers, at most 8"}
    assert not handler.seen
    readers[3].close()
    control.poll(handler)
    ninth.send(b'{"command": "subscribe"}')
    control.poll(handler)
    assert told(ninth)["ok"] is True
    assert len(control.readers) == 8


def test_reader_may_subscribe_again_although_all_places_are_taken(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    readers = [subscribed(control, dial, make_snapshot(0)) for _ in range(8)]
    readers[0].send(b'{"command": "subscribe"}')
    control.poll(Handler(make_snapshot(7)))
    assert '"tick": 7' in json.dumps(told(readers[0]))
    assert len(control.readers) == 8


def test_refused_subscription_reads_nothing(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    client.send(b'{"command": "subscribe"}')
    for _ in range(2):
        control.poll(lambda request, peer: Reply(ok=False))
    assert told(client)["ok"] is False
    assert not control.readers


def test_slow_reader_loses_packets_and_only_it(
    control: ControlSocket,
    dial: Dial,
    make_state: Callable[..., State],
    make_snapshot: Callable[[int], Snapshot],
) -> None:
    slow = subscribed(control, dial, make_snapshot(0))
    quick = subscribed(control, dial, make_snapshot(0))
    ticks = 2000
    for tick in range(ticks):
        control.publish(make_state(tick))
        assert told(quick)["tick"] == tick
    held = 0
    while select.select([slow], [], [], 0)[0]:
        assert told(slow)["tick"] == held
        held += 1
    lost = {c.lost for c in control.readers}
    assert lost == {0, ticks - held}
    assert 10 < held < ticks
    control.publish(make_state(ticks))
    assert told(slow)["tick"] == ticks


def test_dead_reader_is_dropped(
    control: ControlSocket,
    dial: Dial,
    make_state: Callable[..., State],
    make_snapshot: Callable[[int], Snapshot],
) -> None:
    dead = subscribed(control, dial, make_snapshot(0))
    alive = subscribed(control, dial, make_snapshot(0))
    dead.close()
    control.publish(make_state(1))
    assert control.connections == 1
    assert told(alive)["tick"] == 1


def test_snapshot_that_does_not_fit_is_told(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    huge = msgspec.structs.replace(make_snapshot(0), urdf="x" * 10_000_000)
    client = dial()
    client.send(b'{"command": "subscribe"}')
    for _ in range(2):
        control.poll(Handler(huge))
    assert "wmem_max" in str(told(client)["message"])
    assert not control.readers
