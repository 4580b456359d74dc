"""The control socket where many ask much: bounded, and no one is locked out."""

import contextlib
import select
import socket
from collections.abc import Callable

import pytest

from daemon.protocol.requests import Pause
from daemon.protocol.state import Snapshot
from daemon.service.socket import ControlSocket
from tests.socket_peers import Dial, Handler, flooding, inside, reported


def test_flood_is_bounded_and_starves_no_one(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    loud = [dial() for _ in range(8)]
    for client in loud:
        for _ in range(50):
            client.send(b'{"command": "status"}')
    quiet = dial()
    quiet.send(b'{"command": "pause"}')
    for _ in range(3):
        before = len(handler.seen)
        control.poll(handler)
        assert len(handler.seen) - before == 4
    assert Pause() in [request for request, _ in handler.seen]
    assert reported(quiet)["ok"] is True


def test_a_thousand_connections_lock_no_one_out(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    idle: list[socket.socket] = []
    for _ in range(1000):
        idle.append(dial())
        control.poll(handler)
    assert control.connections == 256
    person = dial()
    person.send(b'{"command": "disarm"}')
    control.poll(handler)
    assert reported(person)["ok"] is True
    for client in idle[: 1001 - 256]:
        assert "closed to make room: more than 256" in str(reported(client)["message"])
        assert client.recv(10) == b""
    with pytest.raises(BlockingIOError):
        idle[-1].recv(10)


def test_the_last_word_of_who_makes_room_is_heard(control: ControlSocket, dial: Dial) -> None:
    """Between being let in and making room for others a person may have said `stop`."""
    handler = Handler()
    person = dial()
    control.poll(handler)
    inside(control, dial, handler, 255)
    assert control.connections == 256
    epoll, control._epoll = control._epoll, Unready(control._epoll, next(iter(control._listeners)))
    person.send(b'{"command": "stop"}')
    dial()
    control.poll(handler)
    control._epoll = epoll
    assert reported(person)["ok"] is True
    assert control.connections == 256


class Unready:
    """An epoll that has seen only those who wait outside."""

    def __init__(self, epoll: select.epoll, listener: int) -> None:
        self._epoll, self._listener = epoll, listener

    def poll(self, timeout: float, most: int) -> list[tuple[int, int]]:
        return [(self._listener, select.EPOLLIN)]

    def register(self, file: int, events: int) -> None:
        self._epoll.register(file, events)

    def unregister(self, file: int) -> None:
        self._epoll.unregister(file)


def test_where_everybody_floods_a_newcomer_gets_a_place(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    loud = inside(control, dial, handler, 256)
    for client in loud:
        for _ in range(5):
            client.send(b'{"command": "status"}')
    control.poll(handler, turns_s=0.0)
    person = dial()
    control.poll(handler, turns_s=0.0)
    assert control.connections == 256
    person.send(b'{"command": "stop"}')
    control.poll(handler, turns_s=0.0)
    assert reported(person)["ok"] is True


def test_who_speaks_reads_or_owns_keeps_its_place(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    reader = dial()
    reader.send(b'{"command": "subscribe"}')
    control.poll(Handler(make_snapshot(0)))
    assert reported(reader)["snapshot"]
    handler = Handler()
    owner, silent, busy = dial(), dial(), dial()
    control.poll(handler)
    owner.send(b'{"command": "arm"}')
    control.poll(handler)
    control.spare = handler.seen[-1][1].connection
    for _ in range(600):
        dial()
        control.poll(handler)
        busy.send(b'{"command": "status"}')
        control.poll(handler)
        assert reported(busy)["ok"]
    assert reported(owner)["ok"]
    for client in (reader, owner):
        with pytest.raises(BlockingIOError):
            client.recv(10)
    assert "make room" in str(reported(silent)["message"])


def test_an_owner_that_is_gone_is_noticed_although_its_requests_wait(
    control: ControlSocket, dial: Dial
) -> None:
    gone: list[int] = []
    control.on_close = lambda peer: gone.append(peer.connection)
    flooding(control, dial, Handler())
    owner = dial()
    for _ in range(10):
        owner.send(b'{"command": "status"}')
    control.poll(Handler(), turns_s=0.0)
    owner.close()
    for _ in range(9):
        control.poll(Handler(), turns_s=0.0)
        assert gone == [33]
    for _ in range(100):
        control.poll(Handler())
    assert gone.count(33) == 2


def test_who_may_enter_in_a_poll_is_bounded(control: ControlSocket, dial: Dial) -> None:
    for _ in range(20):
        dial()
    control.poll(Handler(), entrance_s=0.0)
    assert control.connections == 1
    control.poll(Handler())
    assert control.connections == 20
    with contextlib.suppress(BlockingIOError):
        while True:
            dial()
    control.poll(Handler())
    assert 20 < control.connections <= 256


def test_nothing_is_begun_when_the_time_is_over(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    clients = [dial() for _ in range(3)]
    control.poll(handler)
    for client in clients:
        client.send(b'{"command": "status"}')
    for served in (1, 2, 3, 3):
        control.poll(handler, turns_s=0.0)
        assert len(handler.seen) == served  # each its turn, however little time there is
