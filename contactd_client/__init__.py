"""Client of contactd: States as they come, and requests, over the daemon's socket.

A package of its own for programs that are not contactd: it needs nothing but the standard library,
and brings none of contactd along (decision 0001). Messages are plain dictionaries, typed in
`contactd_client.messages`. `contactd_client.aio` is the same for asyncio. docs/programs.md explains
the messages, and has examples.
"""

from contactd_client.client import Client, Joined, Lost, watch
from contactd_client.errors import ContactdError, ControlError, HungUpError, UnreachableError
from contactd_client.paths import usual_socket_path, view_socket_path
from contactd_client.stream import Stream

__all__ = [
    "Client",
    "ContactdError",
    "ControlError",
    "HungUpError",
    "Joined",
    "Lost",
    "Stream",
    "UnreachableError",
    "usual_socket_path",
    "view_socket_path",
    "watch",
]
