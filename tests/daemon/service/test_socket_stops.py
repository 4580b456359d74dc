"""Stops at the control socket: served at once; requests that they overtake are refused."""

import pytest

from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request
from daemon.protocol.socket_path import Peer
from daemon.service.connections import Connection
from tests.daemon.service.socket_rig import SocketRig, send
from tests.socket_peers import flooding, reported


@pytest.mark.parametrize("command", ["stop", "disarm"])
def test_a_stop_is_served_in_the_first_poll(sockets: SocketRig, command: str) -> None:
    """Beside 32 connections that flood and 60 that want in, with no time at all for turns."""
    flooding(sockets.control, sockets.dial, sockets.handler)
    sockets.poll(10, turns_s=0.0)
    outside = [sockets.dial() for _ in range(60)]
    person = sockets.asking(command)
    sockets.poll(turns_s=0.0)
    assert reported(person)["ok"] is True
    assert sockets.commands[-2:] == [command, "status"]
    assert sockets.control.connections == 32 + len(outside) + 1


def test_a_poll_serves_one_stop_of_each_kind_beside_the_turns(sockets: SocketRig) -> None:
    for _ in range(20):
        sockets.asking("stop", "stop")
    sockets.asking("disarm")
    sockets.poll(turns_s=0.0)
    assert sockets.commands == ["stop", "disarm", "stop"]
    sockets.poll()
    assert len(sockets.handler.seen) == 3 + 4
    sockets.poll(10)
    assert len(sockets.handler.seen) == 41


def test_requests_of_a_connection_stay_in_order(sockets: SocketRig) -> None:
    commands = ["pause", "status", "start", "payload", "enable", "reset"]
    client = sockets.asking(*commands)
    sockets.poll(6)
    assert sockets.commands == commands
    assert all(reported(client)["ok"] for _ in range(6))


def test_a_stop_overtakes_earlier_requests_of_its_connection(sockets: SocketRig) -> None:
    """Beside 64 others whose turns come first, and with no time for more than one of them."""
    for _ in range(64):
        sockets.asking("status")
    client = sockets.asking("start", "payload", "stop")
    sockets.poll(turns_s=0.0)
    assert sockets.commands == ["stop", "status"]
    assert reported(client)["ok"] is True
    sockets.poll(70)
    assert "a stop overtook it" in str(reported(client)["message"])
    assert reported(client)["ok"] is True
    assert sockets.commands[-1] == "payload"


def test_a_start_that_may_be_older_than_a_stop_is_refused(sockets: SocketRig) -> None:
    """Last in a long queue, or not let in yet: read after a stop that was sent after it."""
    deep, person = sockets.dial(), sockets.dial()
    sockets.poll()
    send(deep, *["payload"] * 9, "start")
    outside = [sockets.dial() for _ in range(3)]
    send(outside[2], "start")
    send(person, "stop")
    sockets.poll(20, entrance_s=0.0)
    assert sockets.commands == ["stop", *["payload"] * 9]
    assert "a stop overtook it" in str(reported(outside[2])["message"])
    # Requests that come after all of these were read are new.
    send(outside[1], "start")
    sockets.poll(entrance_s=0.0)
    assert reported(outside[1])["ok"] is True


@pytest.mark.parametrize(
    ("stop", "overtaken", "done"),
    [
        ("stop", {"enable", "start", "arm"}, {"renew", "pause", "reset", "payload"}),
        ("disarm", {"arm"}, {"enable", "start", "renew", "pause", "reset", "payload"}),
    ],
)
def test_commands_that_a_stop_overtook_are_refused_until_sent_again(
    sockets: SocketRig, stop: str, overtaken: set[str], done: set[str]
) -> None:
    waiting = {command: sockets.asking(command) for command in sorted(overtaken | done)}
    sockets.asking(stop)
    sockets.poll(3)
    assert sockets.commands[0] == stop
    assert set(sockets.commands[1:]) == done
    for command in overtaken:
        reply = reported(waiting[command])
        assert reply == {"ok": False, "message": f"{command}: a {stop} overtook it"}
        send(waiting[command], command)
        sockets.poll()
        assert reported(waiting[command])["ok"] is True


def test_a_start_sent_during_the_poll_of_a_stop_is_refused(sockets: SocketRig) -> None:
    """Read in the poll after it, from a connection that was read before the stop was."""
    early, person = sockets.dial(), sockets.dial()
    sockets.poll()
    send(early, "status")
    send(person, "stop")
    look_at = sockets.control._read_connection

    def late(connection: Connection, events: int) -> None:
        look_at(connection, events)
        if connection.peer.connection == 1:
            send(early, "start")

    sockets.control._read_connection = late  # type: ignore[method-assign]
    sockets.poll()
    sockets.control._read_connection = look_at  # type: ignore[method-assign]
    sockets.poll()
    assert sockets.commands == ["stop", "status"]
    assert [reported(early)["ok"], reported(early)["ok"]] == [True, False]
    # Sent again it is new; the client that stopped the arm may start it at once.
    sockets.poll()
    for client in (early, person):
        send(client, "start")
    sockets.poll()
    assert sockets.commands[2:] == ["start", "start"]


def test_a_client_may_start_right_after_its_stop(sockets: SocketRig) -> None:
    person = sockets.dial()
    for _ in range(3):
        for command in ("stop", "start"):
            send(person, command)
            sockets.poll()
            assert reported(person)["ok"] is True


def test_an_empty_packet_does_not_hide_an_older_start(sockets: SocketRig) -> None:
    sly, person = sockets.dial(), sockets.dial()
    for packet in (b'{"command": "status"}', b"", b'{"command": "start"}'):
        sly.send(packet)
    send(person, "stop")
    sockets.poll(5)
    assert sockets.commands == ["stop", "status"]


def test_a_start_is_served_beside_a_client_that_floods(sockets: SocketRig) -> None:
    chatty, person = sockets.dial(), sockets.dial()
    send(person, "stop")
    for _ in range(5):
        send(chatty, *["status"] * 12)
        sockets.poll()
    send(person, "start")
    sockets.poll(5)
    assert "start" in sockets.commands


@pytest.mark.parametrize("before", [0, 7, 8, 40, 200])
def test_a_stop_before_the_connection_closes_counts(sockets: SocketRig, before: int) -> None:
    client = sockets.dial()
    sockets.poll()
    send(client, *["payload"] * before, "stop")
    client.close()
    sockets.poll()
    assert sockets.commands[0] == "stop"
    sockets.poll(5)
    assert sockets.control.connections == 0


def test_a_stop_that_is_refused_overtakes_nothing(sockets: SocketRig) -> None:
    def refuses(request: Request, peer: Peer) -> Reply:
        return Reply(ok=request.command != "stop")

    client = sockets.dial()
    for packet in (b'{"command": "stop", "joint": "x"}', b'{"command": "start"}'):
        client.send(packet)
        sockets.control.poll(refuses)
    assert [reported(client)["ok"], reported(client)["ok"]] == [False, True]


def test_a_stop_of_a_client_that_closed_without_reading_counts(sockets: SocketRig) -> None:
    client = sockets.asking("status")
    sockets.poll()
    send(client, "status", "stop")
    client.close()
    sockets.poll()
    assert sockets.commands == ["status", "stop", "status"]
    assert sockets.control.connections == 0


def test_a_stop_in_its_turn_overtakes_too(sockets: SocketRig) -> None:
    long, other = sockets.dial(), sockets.dial()
    long.send(b'{"command": "stop"}'.ljust(200))
    send(other, "start")
    sockets.poll()
    assert sockets.commands == ["stop"]
    assert "overtook" in str(reported(other)["message"])
