"""Requests to the control socket and their answers, malformed ones, and clients that leave."""

import os
import socket

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import ModelError
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request, Stop
from daemon.protocol.socket_path import Peer
from tests.daemon.service.socket_rig import SocketRig, send
from tests.examples import scaled
from tests.socket_peers import reported


def test_request_is_answered_and_the_peer_known(sockets: SocketRig) -> None:
    client = sockets.dial()
    sockets.poll()
    send(client, "stop")
    sockets.poll()
    assert reported(client) == {"ok": True, "mode": "off"}
    assert sockets.handler.seen == [(Stop(), Peer(os.getuid(), os.getpid(), 1))]


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
def test_malformed_packets_are_answered(sockets: SocketRig, packet: bytes, expected: str) -> None:
    client = sockets.dial()
    sockets.poll()
    client.send(packet)
    sockets.poll()
    reply = reported(client)
    assert reply["ok"] is False
    assert expected in str(reply["message"])
    assert not sockets.handler.seen
    send(client, "stop")
    sockets.poll()
    assert reported(client)["ok"] is True


@pytest.mark.parametrize(
    ("command", "done"),
    [
        ("enable", False), ("start", False), ("arm", False), ("stop", True), ("disarm", True),
        ("pause", True), ("disable", True), ("reset", True),
    ],
)  # fmt: skip
def test_a_closed_connection_may_stop_the_arm_and_not_start_it(
    sockets: SocketRig, command: str, done: bool
) -> None:
    """Its command was not answered in time: the arm must not start later."""
    client = sockets.dial()
    sockets.poll()
    send(client, command)
    client.close()
    sockets.poll()
    assert bool(sockets.handler.seen) is done
    assert sockets.control.connections == 0


def test_largest_request_is_served(sockets: SocketRig) -> None:
    client = sockets.dial()
    sockets.poll()
    client.send(b'{"command": "stop"}'.ljust(8192))
    sockets.poll()
    assert reported(client)["ok"] is True


def test_ten_megabytes_never_reach_the_daemon(sockets: SocketRig) -> None:
    client = sockets.dial()
    sockets.poll()
    with pytest.raises(OSError, match="too long"):
        client.send(bytes(10_000_000))
    client.send(bytes(100_000))
    sockets.poll()
    assert "at most 8192 bytes" in str(reported(client)["message"])


@settings(max_examples=scaled(150), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(packet=st.binary(min_size=1, max_size=10000))
def test_garbage_is_refused(sockets: SocketRig, packet: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as client:
        client.connect(str(sockets.control.path))
        sockets.poll()
        client.send(packet)
        sockets.poll()
        client.setblocking(False)
        assert reported(client)["ok"] is False
    sockets.poll()
    assert sockets.control.connections == 0
    assert not sockets.handler.seen


def test_error_of_the_handler_is_a_refusal(sockets: SocketRig) -> None:
    def refuse(request: Request, peer: Peer) -> Reply:
        raise ModelError("no such joint")

    client = sockets.dial()
    sockets.control.poll(refuse)
    send(client, "arm")
    sockets.control.poll(refuse)
    assert reported(client) == {"ok": False, "message": "no such joint"}


def test_every_close_is_reported(sockets: SocketRig) -> None:
    gone: list[int] = []
    sockets.control.on_close = lambda peer: gone.append(peer.connection)
    first, second = sockets.dial(), sockets.dial()
    sockets.poll()
    second.close()
    sockets.poll()
    assert gone == [2]
    first.close()
    sockets.poll()
    assert gone == [2, 1]


@pytest.mark.parametrize("how", ["close", "shutdown", "empty packet"])
def test_half_connected_client_is_dropped(sockets: SocketRig, how: str) -> None:
    client = sockets.dial()
    sockets.poll()
    assert sockets.control.connections == 1
    if how == "close":
        client.close()
    elif how == "shutdown":
        client.shutdown(socket.SHUT_WR)
    else:
        client.send(b"")
    sockets.poll()
    assert sockets.control.connections == 0


def test_a_client_leaves_while_a_process_is_started(sockets: SocketRig) -> None:
    client = sockets.dial()
    sockets.poll()
    (served,) = sockets.control._connections.all.values()
    copy = os.dup(served.file)  # as every open file has one between a fork and its exec
    try:
        client.close()
        for _ in range(2):
            sockets.poll()
            assert sockets.control.connections == 0
    finally:
        os.close(copy)


def test_client_that_never_listens_is_dropped(sockets: SocketRig) -> None:
    client = sockets.dial()
    sockets.poll()
    for _ in range(100_000):
        try:
            send(client, "status")
        except OSError:
            break
        sockets.poll()
        if not sockets.control.connections:
            break
    assert sockets.control.connections == 0


def test_client_gone_before_its_answer(sockets: SocketRig) -> None:
    client = sockets.dial()
    sockets.poll()
    send(client, "stop")
    client.close()
    sockets.poll()
    assert sockets.handler.seen  # a stop counts although no one waits for the answer
    assert sockets.control.connections == 0
