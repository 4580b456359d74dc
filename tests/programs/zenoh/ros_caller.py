"""Caller of an arm's service `arm` as a process: five times a second, for as long as it lives.

    python -m tests.programs.zenoh.ros_caller ENDPOINT NAMESPACE

Refused because it lost the arm it lets go and begins anew. Says `armed` once it is.
"""

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Final

import zenoh

from programs.zenoh.arming import SET_BOOL
from programs.zenoh.holding import RELEASE_FIRST
from programs.zenoh.messages import read_outcome
from programs.zenoh.names import Distro, Node, attachment, gid_of
from programs.zenoh.services import endpoint
from tests.programs.zenoh.zenoh_router import session_at

EVERY_S: Final = 0.2
FLAG: Final = {True: b"\0\1\0\0\1", False: b"\0\1\0\0\0"}


class Caller:
    """Caller in a session."""

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        self._session = session
        node = Node(0, namespace, "contactd", Distro.JAZZY)
        self._key = node.key(endpoint(node, "arm", SET_BOOL))
        self._gid, self._number = gid_of(str(session.zid())), 0

    def call(self, flag: bool) -> tuple[bool, str] | None:
        """Call it; None where no answer comes in time."""
        self._number += 1
        about = attachment(self._number, time.time_ns(), self._gid)
        replies = self._session.get(self._key, payload=FLAG[flag], attachment=about, timeout=1.0)
        for reply in replies:
            if reply.ok is not None:
                return read_outcome(reply.ok.payload.to_bytes())
        return None

    def keep_calling(self) -> None:
        """Call for ever."""
        said = False
        while True:
            answer = self.call(True)
            if answer is not None and answer[0] and not said:
                said = True
                print("armed", flush=True)
            if answer is not None and answer[1].startswith(RELEASE_FIRST):
                self.call(False)
            time.sleep(EVERY_S)


@contextlib.contextmanager
def caller_of(endpoint: str, namespace: str) -> Iterator[subprocess.Popen[str]]:
    """A caller, which has armed the arm, while the context lasts."""
    command = [sys.executable, "-m", "tests.programs.zenoh.ros_caller", endpoint, namespace]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            if not process.stdout.readline():
                raise RuntimeError("the caller does not arm the arm")
            yield process
        finally:
            process.kill()


def main() -> None:
    """Call until it is killed."""
    where, namespace = sys.argv[1:]
    with session_at(where, "client") as session:
        Caller(session, namespace).keep_calling()


if __name__ == "__main__":
    main()
