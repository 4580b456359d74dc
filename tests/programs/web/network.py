"""Network that may be bad, as between a browser and the page's server: it loses every connection
that is open, as when a phone goes from one access point to another, or lets little through."""

import contextlib
import select
import socket
import threading
import time
from collections.abc import Iterator

_PIECE = 1 << 14
_LOOKS_EVERY_S = 0.05


class Network:
    """Passes on what comes to `port` to the port `to` of this machine, and back."""

    def __init__(self, to: int) -> None:
        self.to = to
        self.bytes_per_s = float("inf")  # of each connection, towards the browser
        self.ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._lost = 0
        self._threads: list[threading.Thread] = []

    def lose(self) -> None:
        """Drop all bytes of the open connections from now on, without closing them."""
        self._lost += 1

    def run(self) -> None:
        """Pass on, until it has ended."""
        self._listener.settimeout(_LOOKS_EVERY_S)
        while not self.ended.is_set():
            with contextlib.suppress(TimeoutError):
                near, _ = self._listener.accept()
                passing = threading.Thread(target=self._pass_on, args=(near,))
                passing.start()
                self._threads.append(passing)
        self._listener.close()
        for passing in self._threads:
            passing.join()

    def _pass_on(self, near: socket.socket) -> None:
        lost = self._lost
        far = socket.socket()
        # Little room: what waits is to wait at the server.
        far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        with near, far, contextlib.suppress(OSError):
            far.connect(("127.0.0.1", self.to))
            while not self.ended.is_set():
                ready, _, _ = select.select([near, far], [], [], _LOOKS_EVERY_S)
                if self._lost != lost:
                    self.ended.wait()
                for one in ready:
                    slow = one is far and self.bytes_per_s < float("inf")
                    piece = one.recv(1024 if slow else _PIECE)
                    if not piece:
                        return
                    (near if one is far else far).sendall(piece)
                    if slow:
                        time.sleep(len(piece) / self.bytes_per_s)


@contextlib.contextmanager
def network(to: int) -> Iterator[Network]:
    """A network before the port `to`, while the context lasts."""
    one = Network(to)
    running = threading.Thread(target=one.run)
    running.start()
    try:
        yield one
    finally:
        one.ended.set()
        running.join()
