"""Control socket that a test polls, and clients that send it requests."""

import json
import socket

from daemon.service.socket import ControlSocket
from tests.fake_daemon import snapshot_at
from tests.socket_peers import Dial, Handler, reported


def send(client: socket.socket, *commands: str) -> None:
    """Send each command as a request without fields."""
    for command in commands:
        client.send(json.dumps({"command": command}).encode())


class SocketRig:
    """Control socket with a handler that keeps the requests."""

    def __init__(self, control: ControlSocket, dial: Dial) -> None:
        self.control, self.dial, self.handler = control, dial, Handler()

    def poll(self, times: int = 1, **limits: float) -> None:
        for _ in range(times):
            self.control.poll(self.handler, **limits)

    def asking(self, *commands: str) -> socket.socket:
        """New connection, which has sent these commands."""
        client = self.dial()
        send(client, *commands)
        return client

    def reader(self) -> socket.socket:
        """New connection that has subscribed."""
        self.handler.snapshot = snapshot_at(0)
        client = self.asking("subscribe")
        self.poll(2)
        assert reported(client)["snapshot"]
        return client

    @property
    def commands(self) -> list[str]:
        """Commands that the handler was given, in their order."""
        return [request.command for request, _ in self.handler.seen]
