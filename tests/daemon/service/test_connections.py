"""Places at the control socket: which connection makes room, and files that are spared."""

import contextlib
import itertools
import os
import resource
import socket
from collections.abc import Iterator

import pytest

from contactd_client.paths import view_socket_path
from daemon.protocol.doors import MAX_CONNECTIONS, Door
from daemon.protocol.socket_path import Peer
from daemon.service import listener
from daemon.service.connections import GRACE, Connection, Connections
from daemon.service.listener import FEWEST_PLACES, SPARED_FILES, places
from daemon.service.socket import ControlSocket
from tests.daemon.service.socket_rig import SocketRig, send
from tests.socket_peers import reported

LOUD, QUIET = 1000, 1001


def filled(*groups: tuple[int, int, Door]) -> Connections:
    """Connections of (user, how many, door), silent, in this order."""
    made, numbers = Connections(places=100), itertools.count(1)
    for uid, count, door in groups:
        for _ in range(count):
            n = next(numbers)
            made.add(Connection(None, n, Peer(uid, 1, n), door))  # type: ignore[arg-type]
    return made


def makes_room(connections: Connections, uid: int, spare: int = 0) -> Connection:
    found = connections.makes_room(spare, uid)
    assert found is not None
    return found


@pytest.mark.parametrize("newcomer", [LOUD, QUIET, 7])
def test_the_user_with_most_connections_makes_room(newcomer: int) -> None:
    """However long another user's connection has been silent."""
    connections = filled((QUIET, 10, Door.CONTROL), (LOUD, 90, Door.CONTROL))
    assert connections.full(Door.CONTROL)
    one = makes_room(connections, newcomer)
    assert (one.peer.uid, one.file) == (LOUD, 11)


def test_a_user_who_asks_all_the_time_makes_room_itself() -> None:
    connections = filled((QUIET, 10, Door.CONTROL), (LOUD, 90, Door.CONTROL))
    for one in list(connections.all.values()):
        if one.peer.uid == LOUD:
            connections.wait(one)
    one = makes_room(connections, LOUD)
    assert (one.peer.uid, one.file) == (LOUD, 100)  # whose turn is farthest off


def test_a_new_connection_has_time_to_send_its_first_request() -> None:
    """The only silent one, while all others ask all the time."""
    connections = filled((LOUD, 100, Door.CONTROL))
    for one in list(connections.all.values())[:-2]:
        connections.wait(one)
    first, second = list(connections.all.values())[-2:]
    first.entered, second.entered = 5, 6
    assert connections.makes_room(0, LOUD, 5 + GRACE) is first
    turned_out = connections.makes_room(0, LOUD, 4 + GRACE)
    assert turned_out is not None
    assert turned_out.file == 98
    for one in list(connections.waiting.values()):
        connections.drop(one)
    assert connections.makes_room(0, LOUD, 7) is first


def test_of_two_users_with_as_many_the_new_ones_makes_room() -> None:
    connections = filled((QUIET, 50, Door.CONTROL), (LOUD, 50, Door.CONTROL))
    assert makes_room(connections, LOUD).peer.uid == LOUD
    assert makes_room(connections, QUIET).peer.uid == QUIET


def test_a_viewer_makes_room_first_and_an_owner_never_does() -> None:
    connections = filled((LOUD, 90, Door.CONTROL), (QUIET, 2, Door.VIEW))
    assert makes_room(connections, LOUD).file == 91
    assert makes_room(connections, LOUD, spare=91).file == 92
    only = filled((LOUD, 1, Door.CONTROL))
    assert only.makes_room(1, LOUD) is None


def test_a_dropped_connection_is_forgotten() -> None:
    connections = filled((LOUD, 3, Door.CONTROL), (QUIET, 64, Door.VIEW))
    assert connections.full(Door.VIEW)
    assert not connections.full(Door.CONTROL)
    for one in list(connections.all.values()):
        connections.drop(one)
        connections.drop(one)
    assert connections == Connections(places=100)


@pytest.mark.parametrize(
    ("soft", "hard", "left", "after"),
    [
        (1024, 4096, MAX_CONNECTIONS, 1024),
        (-1, -1, MAX_CONNECTIONS, None),
        (100, 4096, MAX_CONNECTIONS, 320),
        (100, -1, MAX_CONNECTIONS, 320),
        (100, 200, 200 - SPARED_FILES, 200),
        (20, 20, FEWEST_PLACES, 20),
    ],
)
def test_places_leave_the_daemon_its_own_files(
    monkeypatch: pytest.MonkeyPatch, soft: int, hard: int, left: int, after: int | None
) -> None:
    limits = [(soft, hard)]
    monkeypatch.setattr(listener.resource, "getrlimit", lambda _: limits[-1])
    monkeypatch.setattr(listener.resource, "setrlimit", lambda _, new: limits.append(new))
    assert places() == left
    assert after is None or limits[-1] == (after, hard)


@pytest.fixture
def no_descriptors(sockets: SocketRig) -> Iterator[socket.socket]:
    """A client that waits outside, with nothing left to open; 20 silent ones are inside."""
    for _ in range(20):
        sockets.dial()
    sockets.poll()
    person = sockets.dial()
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    held = [os.dup(0) for _ in range(3)]
    most = max(*held, *map(int, os.listdir("/proc/self/fd")))
    resource.setrlimit(resource.RLIMIT_NOFILE, (most + 1, before[1]))
    with contextlib.suppress(OSError):
        while True:
            held.append(os.dup(0))
    yield person
    resource.setrlimit(resource.RLIMIT_NOFILE, before)
    for file in held:
        os.close(file)


def test_stop_is_answered_without_files(sockets: SocketRig, no_descriptors: socket.socket) -> None:
    send(no_descriptors, "stop")
    sockets.poll()
    assert reported(no_descriptors)["ok"] is True
    assert sockets.commands == ["stop"]
    assert sockets.control.connections == 20


@pytest.fixture
def clock(control: ControlSocket) -> list[float]:
    """Time that the socket's clock shows [s]."""
    now = [100.0]
    control.clock = lambda: now[0]
    return now


def test_a_crowded_listener_leaves_time_to_another(sockets: SocketRig, clock: list[float]) -> None:
    """Each gets its share in every poll."""
    shares: list[tuple[Door, float]] = []

    def let_in(at: listener.Listener, until_s: float) -> None:
        shares.append((at.door, until_s - clock[0]))
        clock[0] = until_s  # it took all of that

    sockets.control._admit = let_in  # type: ignore[method-assign]
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as viewer:
        viewer.connect(str(view_socket_path(sockets.control.path)))
        sockets.dial()
        for _ in range(2):
            clock[0] = 100.0
            sockets.poll(entrance_s=2.0)
    first, second, third, fourth = shares
    assert {first[0], second[0]} == {Door.CONTROL, Door.VIEW} == {third[0], fourth[0]}
    assert first[0] is not third[0]
    assert [round(share, 3) for _, share in shares] == [1.0, 1.0, 1.0, 1.0]


def test_slow_reading_leaves_time_for_new_clients(sockets: SocketRig, clock: list[float]) -> None:
    control, client, until = sockets.control, sockets.dial(), list[float]()
    sockets.poll()
    send(client, "status")
    control._admit = lambda at, until_s: until.append(until_s)  # type: ignore[method-assign]
    read = control._read_connection

    def slowly(*arguments: object) -> None:
        read(*arguments)  # type: ignore[arg-type]
        clock[0] += 5.0

    control._read_connection = slowly  # type: ignore[method-assign]
    sockets.dial()
    sockets.poll(entrance_s=2.0)
    assert until == [clock[0] + 1.0]
