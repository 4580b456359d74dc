"""Readers of the control socket: each gets every State, or loses some without affecting others."""

import json
import os
import select
import socket

import msgspec
import pytest

from daemon.protocol.replies import Reply
from daemon.protocol.socket_path import Peer
from daemon.service.listener import Listener
from tests.daemon.service.socket_rig import SocketRig, send
from tests.fake_daemon import snapshot_at, state_at
from tests.socket_peers import reported


def test_every_reader_gets_every_state(sockets: SocketRig) -> None:
    first, second, silent = sockets.reader(), sockets.reader(), sockets.dial()
    sockets.poll()
    for tick in (1, 2, 3):
        sockets.control.publish(state_at(tick))
    for client in (first, second):
        assert [reported(client)["tick"] for _ in range(3)] == [1, 2, 3]
    with pytest.raises(BlockingIOError):
        silent.recv(10)


def test_nothing_is_encoded_without_a_reader(sockets: SocketRig) -> None:
    sockets.dial()
    sockets.poll()
    sockets.control.publish(state_at(1))
    assert sockets.control._packet == b""


def test_a_ninth_reader_of_a_user_is_refused(sockets: SocketRig) -> None:
    readers = [sockets.reader() for _ in range(8)]
    handled = len(sockets.commands)
    ninth = sockets.asking("subscribe")
    sockets.poll(2)
    message = f"subscribe: too many readers of one user, at most 8 (pid {os.getpid()})"
    assert reported(ninth) == {"ok": False, "message": message}
    assert len(sockets.commands) == handled
    readers[3].close()
    sockets.poll()
    send(ninth, "subscribe")
    sockets.poll()
    assert reported(ninth)["ok"] is True
    assert len(sockets.control.readers) == 8


def test_readers_in_all_are_bounded(sockets: SocketRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel's answer about the peer is replaced: connections of three users."""
    users = iter([os.getuid()] * 8 + [1001, 1001] + [1002] * 7)

    def peer_of(connected: socket.socket, number: int) -> Peer:
        return Peer(next(users), 4700 + number, number)

    monkeypatch.setattr("daemon.service.listener.peer_of", peer_of)
    monkeypatch.setattr(Listener, "_admits", lambda *_: True)
    for _ in range(16):
        sockets.reader()
    assert len(sockets.control.readers) == 16
    client = sockets.asking("subscribe")
    sockets.poll()
    assert reported(client) == {"ok": False, "message": "subscribe: too many readers, at most 16"}


def test_a_reader_may_subscribe_again_when_all_places_are_taken(sockets: SocketRig) -> None:
    readers = [sockets.reader() for _ in range(8)]
    sockets.handler.snapshot = snapshot_at(7)
    send(readers[0], "subscribe")
    sockets.poll()
    assert '"tick": 7' in json.dumps(reported(readers[0]))
    assert len(sockets.control.readers) == 8


def test_a_refused_subscription_reads_nothing(sockets: SocketRig) -> None:
    client = sockets.asking("subscribe")
    for _ in range(2):
        sockets.control.poll(lambda request, peer: Reply(ok=False))
    assert reported(client)["ok"] is False
    assert not sockets.control.readers


def test_a_slow_reader_alone_loses_packets(sockets: SocketRig) -> None:
    slow, quick = sockets.reader(), sockets.reader()
    ticks = 2000
    for tick in range(ticks):
        sockets.control.publish(state_at(tick))
        assert reported(quick)["tick"] == tick
    held = 0
    while select.select([slow], [], [], 0)[0]:
        assert reported(slow)["tick"] == held
        held += 1
    assert len(sockets.control.readers) == 2
    assert 10 < held < ticks
    sockets.control.publish(state_at(ticks))
    assert reported(slow)["tick"] == ticks


def test_a_closed_reader_is_dropped(sockets: SocketRig) -> None:
    closed, alive = sockets.reader(), sockets.reader()
    closed.close()
    sockets.control.publish(state_at(1))
    assert sockets.control.connections == 1
    assert reported(alive)["tick"] == 1


def test_a_snapshot_that_does_not_fit_is_reported(sockets: SocketRig) -> None:
    sockets.handler.snapshot = msgspec.structs.replace(snapshot_at(0), urdf="x" * 10_000_000)
    client = sockets.asking("subscribe")
    sockets.poll(2)
    assert "wmem_max" in str(reported(client)["message"])
    assert not sockets.control.readers
