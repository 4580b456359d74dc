"""Places at the control socket: who makes room, and what is spared."""

import itertools
import os
import resource
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.protocol.doors import MAX_CONNECTIONS, Door
from daemon.protocol.requests import Stop
from daemon.protocol.socket_path import Peer
from daemon.service import listener
from daemon.service.connections import GRACE, Connection, Connections
from daemon.service.listener import FEWEST_PLACES, SPARED_FILES, places
from daemon.service.socket import ControlSocket
from tests.socket_peers import Dial, Handler, reported

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
def test_the_user_who_has_most_makes_room(newcomer: int) -> None:
    """However long another user's connection has been silent."""
    connections = filled((QUIET, 10, Door.CONTROL), (LOUD, 90, Door.CONTROL))
    assert connections.full(Door.CONTROL)
    one = makes_room(connections, newcomer)
    assert (one.peer.uid, one.file) == (LOUD, 11)


def test_a_user_who_asks_all_the_time_takes_no_place_of_another() -> None:
    connections = filled((QUIET, 10, Door.CONTROL), (LOUD, 90, Door.CONTROL))
    for one in list(connections.all.values()):
        if one.peer.uid == LOUD:
            connections.wait(one)
    one = makes_room(connections, LOUD)
    assert (one.peer.uid, one.file) == (LOUD, 100)  # whose turn is farthest off


def test_a_newcomer_is_given_time_to_speak() -> None:
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


def test_of_two_with_as_many_the_newcomers_own_makes_room() -> None:
    connections = filled((QUIET, 50, Door.CONTROL), (LOUD, 50, Door.CONTROL))
    assert makes_room(connections, LOUD).peer.uid == LOUD
    assert makes_room(connections, QUIET).peer.uid == QUIET


def test_who_looks_makes_room_first_and_an_owner_never_does() -> None:
    connections = filled((LOUD, 90, Door.CONTROL), (QUIET, 2, Door.VIEW))
    assert makes_room(connections, LOUD).file == 91
    assert makes_room(connections, LOUD, spare=91).file == 92
    only = filled((LOUD, 1, Door.CONTROL))
    assert only.makes_room(1, LOUD) is None


def test_what_is_dropped_is_forgotten() -> None:
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
def no_descriptors(control: ControlSocket, dial: Dial) -> Iterator[socket.socket]:
    """A client that waits outside, with nothing left to open; 20 silent ones are inside."""
    for _ in range(20):
        dial()
    control.poll(Handler())
    person = dial()
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = max(int(name) for name in os.listdir("/proc/self/fd"))
    held = [os.dup(0) for _ in range(3)]
    most = max(most, *held)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most + 1, before[1]))
    try:
        while True:
            held.append(os.dup(0))
    except OSError:
        pass
    yield person
    resource.setrlimit(resource.RLIMIT_NOFILE, before)
    for file in held:
        os.close(file)


def test_a_stop_is_answered_without_a_descriptor_left(
    control: ControlSocket, no_descriptors: socket.socket
) -> None:
    handler = Handler()
    no_descriptors.send(b'{"command": "stop"}')
    control.poll(handler)
    assert reported(no_descriptors)["ok"] is True
    assert [request for request, _ in handler.seen] == [Stop()]
    assert control.connections == 20


def test_a_crowd_at_one_door_leaves_time_for_the_other(tmp_path: Path) -> None:
    """Both listeners get their share, whichever of them is crowded, in every poll."""
    with ControlSocket(tmp_path / "control") as control:
        shares: list[tuple[Door, float]] = []
        began: list[float] = []

        def let_in(at: listener.Listener, until_s: float) -> None:
            shares.append((at.door, until_s - began[0]))
            began[0] = until_s  # it took all of that

        now = control_clock(control, began)
        control._admit = let_in  # type: ignore[method-assign]
        peers = [socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
        for one, at in zip(peers, control._listeners.values(), strict=True):
            one.connect(str(at.path))
        for _ in range(2):
            began[:] = [now]
            control.poll(Handler(), entrance_s=2.0)
        for one in peers:
            one.close()
    first, second, third, fourth = shares
    assert {first[0], second[0]} == {Door.CONTROL, Door.VIEW} == {third[0], fourth[0]}
    assert first[0] is not third[0]
    assert [round(share, 3) for _, share in shares] == [1.0, 1.0, 1.0, 1.0]


def control_clock(control: ControlSocket, began: list[float]) -> float:
    """Let the socket's clock show what `began` holds."""
    began[:] = [100.0]
    control.clock = lambda: began[0]
    return 100.0


def test_those_inside_leave_time_for_the_entrance(control: ControlSocket, dial: Dial) -> None:
    """However long it took to hear what they have said."""
    began = [0.0]
    control_clock(control, began)
    inside = dial()
    control.poll(Handler())
    inside.send(b'{"command": "status"}')
    until: list[float] = []
    control._admit = lambda at, until_s: until.append(until_s)  # type: ignore[method-assign]
    hear = control._read_connection

    def slowly(*arguments: object) -> None:
        hear(*arguments)  # type: ignore[arg-type]
        began[0] += 5.0

    control._read_connection = slowly  # type: ignore[method-assign]
    dial()
    control.poll(Handler(), entrance_s=2.0)
    assert until == [began[0] + 1.0]
