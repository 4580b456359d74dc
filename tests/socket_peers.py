"""Peers of the control socket: who handles its requests, and who floods it."""

import contextlib
import json
import socket
from collections.abc import Callable

from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request
from daemon.protocol.socket_path import Peer
from daemon.protocol.state import Snapshot
from daemon.service.socket import ControlSocket

Dial = Callable[[], socket.socket]
"""Opens one more connection."""


class Handler:
    """Counts what arrives; answers a subscription with a snapshot."""

    def __init__(self, snapshot: Snapshot | None = None) -> None:
        self.seen: list[tuple[Request, Peer]] = []
        self.snapshot = snapshot

    def __call__(self, request: Request, peer: Peer) -> Reply:
        self.seen.append((request, peer))
        return Reply(ok=True, mode="off", snapshot=self.snapshot)


def reported(client: socket.socket) -> dict[str, object]:
    reply = json.loads(client.recv(1 << 20))
    assert isinstance(reply, dict)
    return reply


def inside(control: ControlSocket, dial: Dial, handler: Handler, count: int) -> list[socket.socket]:
    """So many more connections, let in: fewer wait outside at once."""
    made = []
    for _ in range(count):
        made.append(dial())
        control.poll(handler)
    return made


def flooding(control: ControlSocket, dial: Dial, handler: Handler) -> list[socket.socket]:
    """32 connections with as many requests as the kernel keeps."""
    loud = [dial() for _ in range(32)]
    control.poll(handler)
    for client in loud:
        with contextlib.suppress(BlockingIOError):
            while True:
                client.send(b'{"command": "status"}')
    return loud
