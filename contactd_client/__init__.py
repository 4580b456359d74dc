"""Client of contactd: live States and requests over the daemon's socket.

A separate package for other programs: it depends on the standard library only, not on contactd
(decision 0001). Messages are plain dictionaries, typed in `contactd_client.messages`.
`contactd_client.aio` is the equivalent for asyncio. docs/programs.md explains the messages, with
examples.
"""

from contactd_client.client import Client, Joined, Lost, watch
from contactd_client.errors import ClosedError, ContactdError, ControlError, UnreachableError
from contactd_client.paths import usual_socket_path, view_socket_path
from contactd_client.stream import Stream

__all__ = [
    "Client",
    "ClosedError",
    "ContactdError",
    "ControlError",
    "Joined",
    "Lost",
    "Stream",
    "UnreachableError",
    "usual_socket_path",
    "view_socket_path",
    "watch",
]
