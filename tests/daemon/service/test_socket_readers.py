"""Readers of the control socket: each gets every State, or loses some without hurting others."""

import json
import os
import select
import socket
from collections.abc import Callable

import msgspec
import pytest

from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request
from daemon.protocol.socket_path import Peer
from daemon.protocol.state import Snapshot, State
from daemon.service.answers import Handler
from daemon.service.listener import Listener
from daemon.service.socket import ControlSocket

Dial = Callable[[], socket.socket]


def answering(snapshot: Snapshot | None = None) -> Handler:
    """Takes everything; answers a subscription with a snapshot."""
    return lambda request, peer: Reply(ok=True, mode="off", snapshot=snapshot)


def reported(client: socket.socket) -> dict[str, object]:
    reply = json.loads(client.recv(1 << 20))
    assert isinstance(reply, dict)
    return reply


def subscribed(control: ControlSocket, dial: Dial, snapshot: Snapshot) -> socket.socket:
    client = dial()
    client.send(b'{"command": "subscribe"}')
    control.poll(answering(snapshot))
    control.poll(answering(snapshot))
    assert reported(client)["snapshot"]
    return client


def test_every_reader_gets_every_state(
    control: ControlSocket,
    dial: Dial,
    make_state: Callable[..., State],
    make_snapshot: Callable[[int], Snapshot],
) -> None:
    first = subscribed(control, dial, make_snapshot(0))
    second = subscribed(control, dial, make_snapshot(0))
    silent = dial()
    control.poll(answering())
    for tick in (1, 2, 3):
        control.publish(make_state(tick))
    for client in (first, second):
        assert [reported(client)["tick"] for _ in range(3)] == [1, 2, 3]
    with pytest.raises(BlockingIOError):
        silent.recv(10)


def test_nothing_is_encoded_without_a_reader(
    control: ControlSocket, dial: Dial, make_state: Callable[..., State]
) -> None:
    dial()
    control.poll(answering())
    control.publish(make_state(1))
    assert control._packet == b""


def test_ninth_reader_is_refused(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    readers = [subscribed(control, dial, make_snapshot(0)) for _ in range(8)]
    ninth = dial()
    ninth.send(b'{"command": "subscribe"}')
    seen: list[Request] = []

    def handler(request: Request, peer: Peer) -> Reply:
        seen.append(request)
        return Reply(ok=True, mode="off", snapshot=make_snapshot(0))

    control.poll(handler)
    control.poll(handler)
    message = f"subscribe: too many readers of one user, at most 8 (pid {os.getpid()})"
    assert reported(ninth) == {"ok": False, "message": message}
    assert not seen
    readers[3].close()
    control.poll(handler)
    ninth.send(b'{"command": "subscribe"}')
    control.poll(handler)
    assert reported(ninth)["ok"] is True
    assert len(control.readers) == 8


def test_no_user_can_hold_all_places_of_readers(
    control: ControlSocket,
    dial: Dial,
    make_snapshot: Callable[[int], Snapshot],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The kernel's word on who is at the other end is replaced: connections of three users."""
    users = iter([os.getuid()] * 8 + [1001, 1001] + [1002] * 7)

    def peer_of(connected: socket.socket, number: int) -> Peer:
        return Peer(next(users), 4700 + number, number)

    monkeypatch.setattr("daemon.service.listener.peer_of", peer_of)
    monkeypatch.setattr(Listener, "_admits", lambda *_: True)
    for _ in range(16):
        subscribed(control, dial, make_snapshot(0))
    assert len(control.readers) == 16
    client = dial()
    client.send(b'{"command": "subscribe"}')
    control.poll(answering(make_snapshot(0)))
    assert reported(client) == {"ok": False, "message": "subscribe: too many readers, at most 16"}


def test_reader_may_subscribe_again_although_all_places_are_taken(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    readers = [subscribed(control, dial, make_snapshot(0)) for _ in range(8)]
    readers[0].send(b'{"command": "subscribe"}')
    control.poll(answering(make_snapshot(7)))
    assert '"tick": 7' in json.dumps(reported(readers[0]))
    assert len(control.readers) == 8


def test_refused_subscription_reads_nothing(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    client.send(b'{"command": "subscribe"}')
    for _ in range(2):
        control.poll(lambda request, peer: Reply(ok=False))
    assert reported(client)["ok"] is False
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
        assert reported(quick)["tick"] == tick
    held = 0
    while select.select([slow], [], [], 0)[0]:
        assert reported(slow)["tick"] == held
        held += 1
    assert len(control.readers) == 2
    assert 10 < held < ticks
    control.publish(make_state(ticks))
    assert reported(slow)["tick"] == ticks


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
    assert reported(alive)["tick"] == 1


def test_snapshot_that_does_not_fit_is_reported(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    huge = msgspec.structs.replace(make_snapshot(0), urdf="x" * 10_000_000)
    client = dial()
    client.send(b'{"command": "subscribe"}')
    for _ in range(2):
        control.poll(answering(huge))
    assert "wmem_max" in str(reported(client)["message"])
    assert not control.readers
