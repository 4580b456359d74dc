"""Control socket with many clients and requests: bounded, and every client is served."""

import contextlib
import select
import socket

import pytest

from tests.daemon.service.socket_rig import SocketRig, send
from tests.socket_peers import flooding, inside, reported


def test_a_flood_is_bounded_and_others_are_served(sockets: SocketRig) -> None:
    for _ in range(8):
        sockets.asking(*["status"] * 50)
    quiet = sockets.asking("pause")
    for _ in range(3):
        before = len(sockets.handler.seen)
        sockets.poll()
        assert len(sockets.handler.seen) - before == 4
    assert "pause" in sockets.commands
    assert reported(quiet)["ok"] is True


def test_a_thousand_connections_leave_a_place_for_another(sockets: SocketRig) -> None:
    idle: list[socket.socket] = []
    for _ in range(1000):
        idle.append(sockets.dial())
        sockets.poll()
    assert sockets.control.connections == 256
    person = sockets.asking("disarm")
    sockets.poll()
    assert reported(person)["ok"] is True
    for client in idle[: 1001 - 256]:
        assert "closed to make room: more than 256" in str(reported(client)["message"])
        assert client.recv(10) == b""
    with pytest.raises(BlockingIOError):
        idle[-1].recv(10)


def test_a_stop_of_a_connection_that_makes_room_is_served(sockets: SocketRig) -> None:
    """It may have been sent between being let in and making room for others."""
    person = sockets.dial()
    sockets.poll()
    inside(sockets.control, sockets.dial, sockets.handler, 255)
    assert sockets.control.connections == 256
    epoll, sockets.control._epoll = (
        sockets.control._epoll,
        Unready(sockets.control._epoll, next(iter(sockets.control._listeners))),
    )
    send(person, "stop")
    sockets.dial()
    sockets.poll()
    sockets.control._epoll = epoll
    assert reported(person)["ok"] is True
    assert sockets.control.connections == 256


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


def test_a_new_connection_gets_a_place_among_256_that_flood(sockets: SocketRig) -> None:
    loud = inside(sockets.control, sockets.dial, sockets.handler, 256)
    for client in loud:
        send(client, *["status"] * 5)
    sockets.poll(turns_s=0.0)
    person = sockets.dial()
    sockets.poll(turns_s=0.0)
    assert sockets.control.connections == 256
    send(person, "stop")
    sockets.poll(turns_s=0.0)
    assert reported(person)["ok"] is True


def test_a_client_that_asks_reads_or_owns_keeps_its_place(sockets: SocketRig) -> None:
    reader = sockets.reader()
    owner, silent, busy = sockets.dial(), sockets.dial(), sockets.dial()
    sockets.poll()
    send(owner, "arm")
    sockets.poll()
    sockets.control.spare = sockets.handler.seen[-1][1].connection
    for _ in range(600):
        sockets.dial()
        sockets.poll()
        send(busy, "status")
        sockets.poll()
        assert reported(busy)["ok"]
    assert reported(owner)["ok"]
    for client in (reader, owner):
        with pytest.raises(BlockingIOError):
            client.recv(10)
    assert "make room" in str(reported(silent)["message"])


def test_an_owner_that_closes_is_noticed_while_its_requests_wait(sockets: SocketRig) -> None:
    gone: list[int] = []
    sockets.control.on_close = lambda peer: gone.append(peer.connection)
    flooding(sockets.control, sockets.dial, sockets.handler)
    owner = sockets.asking(*["status"] * 10)
    sockets.poll(turns_s=0.0)
    owner.close()
    for _ in range(9):
        sockets.poll(turns_s=0.0)
        assert gone == [33]
    sockets.poll(100)
    assert gone.count(33) == 2


def test_the_time_for_new_connections_in_a_poll_is_bounded(sockets: SocketRig) -> None:
    for _ in range(20):
        sockets.dial()
    sockets.poll(entrance_s=0.0)
    assert sockets.control.connections == 1
    sockets.poll()
    assert sockets.control.connections == 20
    with contextlib.suppress(BlockingIOError):
        while True:
            sockets.dial()
    sockets.poll()
    assert 20 < sockets.control.connections <= 256


def test_one_request_is_served_in_a_poll_without_time_for_turns(sockets: SocketRig) -> None:
    clients = [sockets.dial() for _ in range(3)]
    sockets.poll()
    for client in clients:
        send(client, "status")
    for served in (1, 2, 3, 3):
        sockets.poll(turns_s=0.0)
        assert len(sockets.handler.seen) == served  # each its turn, however little time there is
