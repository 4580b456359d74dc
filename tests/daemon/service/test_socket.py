"""The control socket against clients that are rude, slow, many, or gone."""

import contextlib
import json
import os
import select
import socket
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon.protocol.messages import Reply, Request, Snapshot
from daemon.protocol.socket_path import Peer
from daemon.service.connections import Connection
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
        (b'{"command": "status", "command": "stop"}', "key `command` is given twice"),
        (b'{"command": "stop", "comm\\u0061nd": "stop"}', "key `command` is given twice"),
        (b'{"command": "gain", "joint": "a", "gain": 1, "gain": 2}', "key `gain` is given twice"),
        (b'{"command": "load", "header": {"name": "a", "name": "b", "joints": []}}', "`name`"),
        (b'{"command": "load", "rows": [[%s]]}' % (b"9" * 400), "out of range"),
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
    for client in loud:
        for _ in range(50):
            client.send(b'{"command": "status"}')
    quiet = dial()
    quiet.send(b'{"command": "pause"}')
    for _ in range(3):
        before = len(handler.seen)
        control.poll(handler)
        assert len(handler.seen) - before == 4
    assert Request("pause") in [request for request, _ in handler.seen]
    assert told(quiet)["ok"] is True


def flooding(control: ControlSocket, dial: Dial, handler: Handler) -> list[socket.socket]:
    """32 connections with as many requests as the kernel keeps, and 200 that wait outside."""
    loud = [dial() for _ in range(32)]
    control.poll(handler)
    for client in loud:
        with contextlib.suppress(BlockingIOError):
            while True:
                client.send(b'{"command": "status"}')
    return loud


@pytest.mark.parametrize("command", ["stop", "disarm"])
def test_a_stop_is_served_in_the_first_poll_whatever_waits(
    control: ControlSocket, dial: Dial, command: str
) -> None:
    """Beside 32 connections that flood and 200 that want in, with no time at all for turns."""
    handler = Handler()
    flooding(control, dial, handler)
    for _ in range(10):
        control.poll(handler, turns_s=0.0)
    outside = [dial() for _ in range(200)]
    person = dial()
    person.send(json.dumps({"command": command}).encode())
    control.poll(handler, turns_s=0.0)
    assert told(person)["ok"] is True
    assert [request.command for request, _ in handler.seen[-2:]] == [command, "status"]
    assert control.connections == 32 + len(outside) + 1


def test_a_flood_of_stops_takes_one_of_each_kind_a_poll_beside_the_turns(
    control: ControlSocket, dial: Dial
) -> None:
    handler = Handler()
    for _ in range(20):
        client = dial()
        client.send(b'{"command": "stop"}')
        client.send(b'{"command": "stop"}')
    person = dial()
    person.send(b'{"command": "disarm"}')
    control.poll(handler, turns_s=0.0)
    assert [request.command for request, _ in handler.seen] == ["stop", "disarm", "stop"]
    control.poll(handler)
    assert len(handler.seen) == 3 + 4
    for _ in range(10):
        control.poll(handler)
    assert len(handler.seen) == 41


def test_what_one_connection_says_stays_in_its_order(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    client = dial()
    commands = ["pause", "status", "start", "gain", "enable", "reset"]
    for command in commands:
        client.send(json.dumps({"command": command}).encode())
    for _ in range(6):
        control.poll(handler)
    assert [request.command for request, _ in handler.seen] == commands
    assert all(told(client)["ok"] for _ in range(6))


def test_a_stop_overtakes_what_the_same_connection_has_said(
    control: ControlSocket, dial: Dial
) -> None:
    """Beside 64 others whose turns come first, and with no time for more than one of them."""
    handler = Handler()
    for _ in range(64):
        dial().send(b'{"command": "status"}')
    client = dial()
    for command in ("start", "gain", "stop"):
        client.send(json.dumps({"command": command}).encode())
    control.poll(handler, turns_s=0.0)
    assert [request.command for request, _ in handler.seen] == ["stop", "status"]
    assert told(client)["ok"] is True
    for _ in range(70):
        control.poll(handler)
    assert "a stop overtook it" in str(told(client)["message"])
    assert told(client)["ok"] is True
    assert handler.seen[-1][0].command == "gain"


def test_what_may_have_been_sent_before_a_stop_does_not_move_the_arm(
    control: ControlSocket, dial: Dial
) -> None:
    """Deep in what a connection has said, or outside: read after a stop that was sent after it."""
    handler = Handler()
    deep, person = dial(), dial()
    control.poll(handler)
    for command in (*["gain"] * 9, "start"):
        deep.send(json.dumps({"command": command}).encode())
    outside = [dial() for _ in range(3)]
    outside[2].send(b'{"command": "start"}')
    person.send(b'{"command": "stop"}')
    for _ in range(20):
        control.poll(handler, entrance_s=0.0)
    seen = [request.command for request, _ in handler.seen]
    assert seen == ["stop", *["gain"] * 9]
    assert "a stop overtook it" in str(told(outside[2])["message"])
    # Once everything is read that was there, what comes is new.
    outside[1].send(b'{"command": "start"}')
    control.poll(handler, entrance_s=0.0)
    assert told(outside[1])["ok"] is True


@pytest.mark.parametrize(
    ("stop", "overtaken", "done"),
    [
        ("stop", {"enable", "start", "arm"}, {"renew", "pause", "reset", "gain"}),
        ("disarm", {"arm"}, {"enable", "start", "renew", "pause", "reset", "gain"}),
    ],
)
def test_what_a_stop_has_overtaken_does_not_move_the_arm_afterwards(
    control: ControlSocket, dial: Dial, stop: str, overtaken: set[str], done: set[str]
) -> None:
    handler = Handler()
    waiting = {command: dial() for command in sorted(overtaken | done)}
    for command, client in waiting.items():
        client.send(json.dumps({"command": command}).encode())
    person = dial()
    person.send(json.dumps({"command": stop}).encode())
    for _ in range(3):
        control.poll(handler)
    assert handler.seen[0][0].command == stop
    assert {request.command for request, _ in handler.seen[1:]} == done
    for command in overtaken:
        reply = told(waiting[command])
        assert reply == {
            "ok": False,
            "message": f"{command}: a {stop} overtook it; ask again",
        }
        waiting[command].send(json.dumps({"command": command}).encode())
        control.poll(handler)
        assert told(waiting[command])["ok"] is True


def test_a_start_that_was_sent_while_the_doors_were_open_is_older(
    control: ControlSocket, dial: Dial
) -> None:
    """Read in the poll after the stop, from who was looked at before the stop was sent."""
    handler = Handler()
    early, person = dial(), dial()
    control.poll(handler)
    early.send(b'{"command": "status"}')
    person.send(b'{"command": "stop"}')
    look_at = control._look_at

    def late(connection: Connection, handle: object, events: int) -> None:
        look_at(connection, handler, events)
        if connection.peer.connection == 1:
            early.send(b'{"command": "start"}')

    control._look_at = late  # type: ignore[method-assign]
    control.poll(handler)
    control._look_at = look_at  # type: ignore[method-assign]
    control.poll(handler)
    assert [request.command for request, _ in handler.seen] == ["stop", "status"]
    assert [told(early)["ok"], told(early)["ok"]] == [True, False]
    # Asked again it is new; whoever stopped the arm may start it at once.
    control.poll(handler)
    for client in (early, person):
        client.send(b'{"command": "start"}')
    control.poll(handler)
    assert [request.command for request, _ in handler.seen[2:]] == ["start", "start"]


def test_who_stops_may_start_at_once(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    person = dial()
    for _ in range(3):
        for command in ("stop", "start"):
            person.send(json.dumps({"command": command}).encode())
            control.poll(handler)
            assert told(person)["ok"] is True


def test_an_empty_packet_hides_nothing(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    sly, person = dial(), dial()
    for packet in (b'{"command": "status"}', b"", b'{"command": "start"}'):
        sly.send(packet)
    person.send(b'{"command": "stop"}')
    for _ in range(5):
        control.poll(handler)
    assert [request.command for request, _ in handler.seen] == ["stop", "status"]


def test_one_who_always_talks_keeps_nobody_from_starting(
    control: ControlSocket, dial: Dial
) -> None:
    handler = Handler()
    chatty, person = dial(), dial()
    person.send(b'{"command": "stop"}')
    for _ in range(5):
        for _ in range(12):
            chatty.send(b'{"command": "status"}')
        control.poll(handler)
    person.send(b'{"command": "start"}')
    for _ in range(5):
        control.poll(handler)
    assert Request("start") in [request for request, _ in handler.seen]


@pytest.mark.parametrize("before", [0, 7, 8, 40, 200])
def test_a_stop_among_last_words_counts(control: ControlSocket, dial: Dial, before: int) -> None:
    handler = Handler()
    client = dial()
    control.poll(handler)
    for _ in range(before):
        client.send(b'{"command": "gain"}')
    client.send(b'{"command": "stop"}')
    client.close()
    control.poll(handler)
    assert handler.seen[0][0].command == "stop"
    for _ in range(5):
        control.poll(handler)
    assert control.connections == 0


def test_a_stop_that_is_refused_overtakes_nothing(control: ControlSocket, dial: Dial) -> None:
    def refuses(request: Request, peer: Peer) -> Reply:
        return Reply(ok=request.command != "stop")

    client = dial()
    for packet in (b'{"command": "stop", "joint": "x"}', b'{"command": "start"}'):
        client.send(packet)
        control.poll(refuses)
    assert [told(client)["ok"], told(client)["ok"]] == [False, True]


def test_a_stop_of_who_hung_up_without_reading_counts(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    client = dial()
    client.send(b'{"command": "status"}')
    control.poll(handler)
    client.send(b'{"command": "status"}')
    client.send(b'{"command": "stop"}')
    client.close()
    control.poll(handler)
    assert [request.command for request, _ in handler.seen] == ["status", "stop", "status"]
    assert control.connections == 0


def test_a_stop_in_its_turn_overtakes_too(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    long, other = dial(), dial()
    long.send(b'{"command": "stop"}'.ljust(200))
    other.send(b'{"command": "start"}')
    control.poll(handler)
    assert [request.command for request, _ in handler.seen] == ["stop"]
    assert "overtook" in str(told(other)["message"])


def test_a_thousand_connections_lock_nobody_out(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    idle: list[socket.socket] = []
    for _ in range(1000):
        idle.append(dial())
        control.poll(handler)
    assert control.connections == 256
    person = dial()
    person.send(b'{"command": "disarm"}')
    control.poll(handler)
    assert told(person)["ok"] is True
    for client in idle[: 1001 - 256]:
        assert "closed to make room: more than 256" in str(told(client)["message"])
        assert client.recv(10) == b""
    with pytest.raises(BlockingIOError):
        idle[-1].recv(10)


def test_the_last_word_of_who_makes_room_is_heard(control: ControlSocket, dial: Dial) -> None:
    """Between being let in and making room for others a person may have said `stop`."""
    handler = Handler()
    person = dial()
    control.poll(handler)
    for _ in range(255):
        dial()
    control.poll(handler)
    assert control.connections == 256
    epoll, control._epoll = control._epoll, Unready(control._epoll, next(iter(control._entrances)))
    person.send(b'{"command": "stop"}')
    dial()
    control.poll(handler)
    control._epoll = epoll
    assert told(person)["ok"] is True
    assert control.connections == 256


class Unready:
    """An epoll that has seen nobody but those who wait outside."""

    def __init__(self, epoll: select.epoll, entrance: int) -> None:
        self._epoll, self._entrance = epoll, entrance

    def poll(self, timeout: float, most: int) -> list[tuple[int, int]]:
        return [(self._entrance, select.EPOLLIN)]

    def register(self, file: int, events: int) -> None:
        self._epoll.register(file, events)


def test_where_everybody_floods_a_newcomer_gets_a_place(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    loud = [dial() for _ in range(256)]
    for client in loud:
        for _ in range(5):
            client.send(b'{"command": "status"}')
    control.poll(handler, turns_s=0.0)
    person = dial()
    control.poll(handler, turns_s=0.0)
    assert control.connections == 256
    person.send(b'{"command": "stop"}')
    control.poll(handler, turns_s=0.0)
    assert told(person)["ok"] is True


def test_who_speaks_reads_or_owns_keeps_its_place(
    control: ControlSocket, dial: Dial, make_snapshot: Callable[[int], Snapshot]
) -> None:
    reader = dial()
    reader.send(b'{"command": "subscribe"}')
    control.poll(Handler(make_snapshot(0)))
    assert told(reader)["snapshot"]
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
        assert told(busy)["ok"]
    assert told(owner)["ok"]
    for client in (reader, owner):
        with pytest.raises(BlockingIOError):
            client.recv(10)
    assert "make room" in str(told(silent)["message"])


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
