"""Stops at the control socket: served at once, and what they overtake."""

import json

import pytest

from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request, Start
from daemon.protocol.socket_path import Peer
from daemon.service.connections import Connection
from daemon.service.socket import ControlSocket
from tests.socket_peers import Dial, Handler, flooding, reported


@pytest.mark.parametrize("command", ["stop", "disarm"])
def test_a_stop_is_served_in_the_first_poll_whatever_waits(
    control: ControlSocket, dial: Dial, command: str
) -> None:
    """Beside 32 connections that flood and 60 that want in, with no time at all for turns."""
    handler = Handler()
    flooding(control, dial, handler)
    for _ in range(10):
        control.poll(handler, turns_s=0.0)
    outside = [dial() for _ in range(60)]
    person = dial()
    person.send(json.dumps({"command": command}).encode())
    control.poll(handler, turns_s=0.0)
    assert reported(person)["ok"] is True
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
    commands = ["pause", "status", "start", "payload", "enable", "reset"]
    for command in commands:
        client.send(json.dumps({"command": command}).encode())
    for _ in range(6):
        control.poll(handler)
    assert [request.command for request, _ in handler.seen] == commands
    assert all(reported(client)["ok"] for _ in range(6))


def test_a_stop_overtakes_what_the_same_connection_has_said(
    control: ControlSocket, dial: Dial
) -> None:
    """Beside 64 others whose turns come first, and with no time for more than one of them."""
    handler = Handler()
    for _ in range(64):
        dial().send(b'{"command": "status"}')
    client = dial()
    for command in ("start", "payload", "stop"):
        client.send(json.dumps({"command": command}).encode())
    control.poll(handler, turns_s=0.0)
    assert [request.command for request, _ in handler.seen] == ["stop", "status"]
    assert reported(client)["ok"] is True
    for _ in range(70):
        control.poll(handler)
    assert "a stop overtook it" in str(reported(client)["message"])
    assert reported(client)["ok"] is True
    assert handler.seen[-1][0].command == "payload"


def test_what_may_have_been_sent_before_a_stop_does_not_move_the_arm(
    control: ControlSocket, dial: Dial
) -> None:
    """Deep in what a connection has said, or outside: read after a stop that was sent after it."""
    handler = Handler()
    deep, person = dial(), dial()
    control.poll(handler)
    for command in (*["payload"] * 9, "start"):
        deep.send(json.dumps({"command": command}).encode())
    outside = [dial() for _ in range(3)]
    outside[2].send(b'{"command": "start"}')
    person.send(b'{"command": "stop"}')
    for _ in range(20):
        control.poll(handler, entrance_s=0.0)
    seen = [request.command for request, _ in handler.seen]
    assert seen == ["stop", *["payload"] * 9]
    assert "a stop overtook it" in str(reported(outside[2])["message"])
    # Once everything is read that was there, what comes is new.
    outside[1].send(b'{"command": "start"}')
    control.poll(handler, entrance_s=0.0)
    assert reported(outside[1])["ok"] is True


@pytest.mark.parametrize(
    ("stop", "overtaken", "done"),
    [
        ("stop", {"enable", "start", "arm"}, {"renew", "pause", "reset", "payload"}),
        ("disarm", {"arm"}, {"enable", "start", "renew", "pause", "reset", "payload"}),
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
        reply = reported(waiting[command])
        assert reply == {"ok": False, "message": f"{command}: a {stop} overtook it"}
        waiting[command].send(json.dumps({"command": command}).encode())
        control.poll(handler)
        assert reported(waiting[command])["ok"] is True


def test_a_start_that_was_sent_while_the_doors_were_open_is_older(
    control: ControlSocket, dial: Dial
) -> None:
    """Read in the poll after the stop, from who was looked at before the stop was sent."""
    handler = Handler()
    early, person = dial(), dial()
    control.poll(handler)
    early.send(b'{"command": "status"}')
    person.send(b'{"command": "stop"}')
    look_at = control._read_connection

    def late(connection: Connection, events: int) -> None:
        look_at(connection, events)
        if connection.peer.connection == 1:
            early.send(b'{"command": "start"}')

    control._read_connection = late  # type: ignore[method-assign]
    control.poll(handler)
    control._read_connection = look_at  # type: ignore[method-assign]
    control.poll(handler)
    assert [request.command for request, _ in handler.seen] == ["stop", "status"]
    assert [reported(early)["ok"], reported(early)["ok"]] == [True, False]
    # Asked again it is new; who stopped the arm may start it at once.
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
            assert reported(person)["ok"] is True


def test_an_empty_packet_hides_nothing(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    sly, person = dial(), dial()
    for packet in (b'{"command": "status"}', b"", b'{"command": "start"}'):
        sly.send(packet)
    person.send(b'{"command": "stop"}')
    for _ in range(5):
        control.poll(handler)
    assert [request.command for request, _ in handler.seen] == ["stop", "status"]


def test_one_who_always_talks_keeps_no_one_from_starting(
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
    assert Start() in [request for request, _ in handler.seen]


@pytest.mark.parametrize("before", [0, 7, 8, 40, 200])
def test_a_stop_among_last_words_counts(control: ControlSocket, dial: Dial, before: int) -> None:
    handler = Handler()
    client = dial()
    control.poll(handler)
    for _ in range(before):
        client.send(b'{"command": "payload"}')
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
    assert [reported(client)["ok"], reported(client)["ok"]] == [False, True]


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
    assert "overtook" in str(reported(other)["message"])
