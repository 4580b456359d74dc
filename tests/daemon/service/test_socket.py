"""The control socket: requests and their answers, malformed ones, and clients that leave."""

import json
import os
import socket

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import ModelError
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request, Stop
from daemon.protocol.socket_path import Peer
from daemon.service.socket import ControlSocket
from tests.examples import scaled
from tests.socket_peers import Dial, Handler, reported


def test_request_is_answered_and_the_peer_known(control: ControlSocket, dial: Dial) -> None:
    handler = Handler()
    client = dial()
    control.poll(handler)
    client.send(b'{"command": "stop"}')
    control.poll(handler)
    assert reported(client) == {"ok": True, "mode": "off"}
    assert handler.seen == [(Stop(), Peer(os.getuid(), os.getpid(), 1))]


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
def test_malformed_is_reported_and_the_connection_kept(
    control: ControlSocket, dial: Dial, packet: bytes, expected: str
) -> None:
    handler = Handler()
    client = dial()
    control.poll(handler)
    client.send(packet)
    control.poll(handler)
    reply = reported(client)
    assert reply["ok"] is False
    assert expected in str(reply["message"])
    assert not handler.seen
    client.send(b'{"command": "stop"}')
    control.poll(handler)
    assert reported(client)["ok"] is True


@pytest.mark.parametrize(
    ("command", "done"),
    [
        ("enable", False), ("start", False), ("arm", False), ("stop", True), ("disarm", True),
        ("pause", True), ("disable", True), ("reset", True),
    ],
)  # fmt: skip
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
    assert reported(client)["ok"] is True


def test_ten_megabytes_never_reach_the_daemon(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    control.poll(Handler())
    with pytest.raises(OSError, match="too long"):
        client.send(bytes(10_000_000))
    client.send(bytes(100_000))
    control.poll(Handler())
    assert "at most 8192 bytes" in str(reported(client)["message"])


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
        assert reported(client)["ok"] is False
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
    assert reported(client) == {"ok": False, "message": "no such joint"}


def test_every_close_is_reported(control: ControlSocket, dial: Dial) -> None:
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


def test_a_client_leaves_while_a_process_is_started(control: ControlSocket, dial: Dial) -> None:
    client = dial()
    control.poll(Handler())
    (served,) = control._connections.all.values()
    copy = os.dup(served.file)  # as every open file has one between a fork and its exec
    try:
        client.close()
        for _ in range(2):
            control.poll(Handler())
            assert control.connections == 0
    finally:
        os.close(copy)


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
    assert handler.seen  # a stop counts although no one waits for the answer
    assert control.connections == 0
