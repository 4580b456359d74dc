"""The door to ROS 2 in a thread of this process, between any daemon's socket and a router."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from contactd_client.paths import view_socket_path
from daemon.ros.names import Distro, Node
from daemon.ros.serve import Settings, serve

LONGEST_S: Final = 60.0


def until(true: Callable[[], Any]) -> Any:
    """What `true` returns once it is something. Raises TimeoutError where that never comes."""
    end_s = time.monotonic() + LONGEST_S
    while not (found := true()):
        if time.monotonic() > end_s:
            raise TimeoutError("it never came")
        time.sleep(0.005)
    return found


class Bridge:
    """`contactd-zenoh` of the daemon at this control socket; `said` is what it tells its log."""

    def __init__(self, control: Path, endpoint: str, name: str = "left_arm") -> None:
        self.said: list[str] = []
        self.node = Node(0, f"/{name}", "contactd", Distro.JAZZY)
        settings = Settings(view_socket_path(control), None, self.node, (endpoint,), None)
        self._ended = threading.Event()
        self.thread = threading.Thread(target=serve, args=(settings, self.said.append, self._ended))
        self.thread.start()

    def heard(self, words: str) -> bool:
        """True if it said so."""
        return any(words in line for line in self.said)

    def joined(self) -> None:
        """Wait until it has joined the daemon."""
        until(lambda: self.heard("joined"))

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self.thread.join()
