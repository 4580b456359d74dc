"""Subscriber to an arm's topics as a process: when each message of `joint_states` came.

python -m bench.rigs.ros_listener ENDPOINT KEY    # until SIGTERM; then a line of JSON
"""

import contextlib
import json
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any, Final

from bench.rigs.zenoh_router import session_at

STAMP: Final = struct.Struct("<iI")  # behind the four bytes of CDR's header
#: Seconds and nanoseconds of the stamp, and the Unix time of arrival [s].
Arrival = tuple[int, int, float]


class Listener:
    """Running subscriber."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def arrivals(self) -> list[Arrival]:
        """End it: what came, in order."""
        self.process.terminate()
        said, _ = self.process.communicate()
        return [tuple(one) for one in json.loads(said)]


@contextlib.contextmanager
def listener_of(endpoint: str, key: str) -> Iterator[Listener]:
    """A subscriber while the context lasts."""
    command = [sys.executable, "-m", "bench.rigs.ros_listener", endpoint, key]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise RuntimeError("the listener does not start")
        try:
            yield Listener(process)
        finally:
            process.kill()


def main() -> None:
    """Listen until SIGTERM."""
    endpoint, key = sys.argv[1:]
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})  # for all threads of Zenoh, too
    came: list[Any] = []

    def take(sample: Any) -> None:
        came.append((*STAMP.unpack_from(sample.payload.to_bytes(), 4), time.time()))

    with session_at(endpoint, "client") as session:
        subscribed = session.declare_subscriber(key, take)
        print("listens", flush=True)
        signal.sigwait({signal.SIGTERM})
        subscribed.undeclare()
    print(json.dumps(came), flush=True)


if __name__ == "__main__":
    main()
