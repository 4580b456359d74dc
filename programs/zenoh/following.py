"""Following from the network: forwards JointState messages on `joint_targets` as a stream of
targets to the daemon's control socket.

Only one publisher is followed at a time: the first that sends, until it is silent for SILENT_S or
its stream ends. A publisher whose stream was refused or ended (by a stop, a fault, a target out of
reach) must be silent before it may start again, as a timer that repeats messages must not undo a
`stop`.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol, Self

from common.errors import ContactdError
from contactd_client.client import Client
from contactd_client.stream import Stream
from programs.zenoh.cdr import CdrError
from programs.zenoh.messages import JointTarget, read_joint_target

SILENT_S: Final = 0.5
"""Silence that ends a stream, and allows its publisher to start again [s]."""
MOST_WAITING: Final = 32


class Line(Protocol):
    """Stream on a separate connection."""

    def to(
        self, q: Sequence[float], velocity: Sequence[float] | None, sent_s: float | None
    ) -> None:
        """Send a target. Raises ContactdError."""

    def close(self) -> None:
        """Close the connection, which halts the arm."""


class _ClientLine:
    """Line through a client."""

    def __init__(self, control: Path) -> None:
        self._client = Client(control)
        self._stream: Stream = self._client.follow()

    def to(
        self, q: Sequence[float], velocity: Sequence[float] | None, sent_s: float | None
    ) -> None:
        self._stream.to(q, velocity, sent_s)

    def close(self) -> None:
        self._client.close()


@dataclass(slots=True)
class Following:
    """Streams from publishers to the arm with these joints; `connect` opens a line, `say` reports
    to the user. Time is an argument."""

    connect: Callable[[], Line]
    joints: Callable[[], Sequence[str]]
    say: Callable[[str], object]
    _publisher: bytes = b""
    _heard_s: float = 0.0
    _line: Line | None = None
    _waits: dict[bytes, float] = field(default_factory=dict)  # publishers that must be silent first

    def take(self, payload: bytes, publisher: bytes, sent_s: float, now_s: float) -> None:
        """Process a message that a publisher sent at `sent_s` by its own clock [s]."""
        self.look(now_s)
        if publisher in self._waits:
            self._waits[publisher] = now_s
            return None
        if not any(publisher):
            return self._refuse(publisher, "its messages lack a GID", now_s)
        if self._line is not None and publisher != self._publisher:
            return self._refuse(publisher, "another publisher is streaming", now_s)
        self._publisher, self._heard_s = publisher, now_s
        try:
            target = read_joint_target(payload)
            q, velocity = in_order(target, self.joints())
            if self._line is None:
                self._line = self.connect()
                self.say(f"follows publisher {publisher.hex()}")
            self._line.to(q, velocity, target.stamp_s or sent_s)
        except (CdrError, ContactdError, OSError) as error:
            self._refuse(publisher, str(error), now_s)
            self.close()
        return None

    def look(self, now_s: float) -> None:
        """End the stream of a silent publisher, and allow silent publishers to start again."""
        if self._line is not None and now_s - self._heard_s > SILENT_S:
            self.say(f"publisher {self._publisher.hex()} fell silent: its stream is ended")
            self.close()
        for publisher in [p for p, then_s in self._waits.items() if now_s - then_s > SILENT_S]:
            del self._waits[publisher]

    def close(self) -> None:
        """End the stream."""
        line, self._line, self._publisher = self._line, None, b""
        if line is not None:
            line.close()

    def _refuse(self, publisher: bytes, why: str, now_s: float) -> None:
        self._waits[publisher] = now_s
        self.say(f"does not follow publisher {publisher.hex()} until it falls silent: {why}")


def in_order(target: JointTarget, joints: Sequence[str]) -> tuple[list[float], list[float] | None]:
    """Positions [rad] and velocities [rad/s] (or None) in the order of the arm's joints. Raises
    CdrError unless each joint is named exactly once."""
    if sorted(target.names) != sorted(joints) or len(target.position) != len(joints):
        raise CdrError(
            f"a target must name each joint once, with a position: {', '.join(joints)}; this one "
            f"names {', '.join(target.names) or 'none'}"
        )
    at = [target.names.index(joint) for joint in joints]
    moving = len(target.velocity) == len(joints)
    velocity = [target.velocity[i] for i in at] if moving else None
    return [target.position[i] for i in at], velocity


class FollowingThread:
    """Thread that processes messages, from construction to `close`; `put` may be called from any
    thread."""

    def __init__(
        self, control: Path, joints: Callable[[], Sequence[str]], say: Callable[[str], object]
    ) -> None:
        self._following = Following(lambda: _ClientLine(control), joints, say)
        self._waiting: deque[tuple[bytes, bytes, float]] = deque(maxlen=MOST_WAITING)
        self._changed, self._ended = threading.Condition(), False
        self._thread = threading.Thread(target=self._run, name="following", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def put(self, payload: bytes, publisher: bytes, sent_s: float) -> None:
        """Queue a message, dropping the oldest if the queue is full."""
        with self._changed:
            self._waiting.append((payload, publisher, sent_s))
            self._changed.notify()

    def close(self) -> None:
        """End the stream and the thread."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                if not self._waiting and not self._ended:
                    self._changed.wait(SILENT_S)
                taken, ended = list(self._waiting), self._ended
                self._waiting.clear()
            if ended:
                break
            for payload, publisher, sent_s in taken:
                self._following.take(payload, publisher, sent_s, time.monotonic())
            self._following.look(time.monotonic())
        self._following.close()
