"""Requests and answers of one stream of targets. Pure."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Final, Generic, TypeVar

from contactd_client.errors import ControlError
from contactd_client.messages import Reply, Request, StreamState
from contactd_client.packets import decode_reply, encode, refusal

ConnectionT = TypeVar("ConnectionT")
#: Request that halts the arm at the end of a stream.
PAUSE: Final = encode({"command": "pause"})
#: Missing answers from which the daemon counts as silent: half a second at 200 Hz.
MOST_MISSING: Final = 100


class Targets:
    """Targets of one sender, numbered and timed by `clock` [s], which must be monotonic."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._number = clock, 0
        self.reply: Reply | None = None
        """Latest answer."""
        self.follows = False
        """True once the arm has begun to follow, until an answer is a refusal."""

    @property
    def state(self) -> StreamState | None:
        """Latest report of the daemon; None before the first answer."""
        return None if self.reply is None else self.reply.get("stream")

    def follow(self, q: Sequence[float], sent_s: float | None) -> bytes:
        """Request to follow from q of all joints [rad] on, or to rejoin there."""
        return encode({"command": "follow", "q": _numbers("q", q), **self._stamp(sent_s)})

    def target(
        self, q: Sequence[float], velocity: Sequence[float] | None, sent_s: float | None
    ) -> bytes:
        """Request with the next target: q [rad] and, if known, velocity [rad/s]."""
        request: Request = {"command": "target", "q": _numbers("q", q), **self._stamp(sent_s)}
        if velocity is not None:
            request["velocity"] = _numbers("velocity", velocity)
        return encode(request)

    def accept(self, packet: bytes) -> None:
        """Take an answer. Raises ControlError for a refusal."""
        self.reply = decode_reply(packet)
        self.follows = self.reply["ok"]
        if not self.follows:
            raise ControlError(refusal(self.reply))

    def _stamp(self, sent_s: float | None) -> Request:
        number, self._number = self._number, self._number + 1
        return {"sent_s": self._clock() if sent_s is None else sent_s, "number": number}  # type: ignore[typeddict-item]


class TargetStream(Generic[ConnectionT]):
    """State of a stream: its connection, its targets, and the number of missing answers."""

    def __init__(
        self, connection: ConnectionT, timeout_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """clock: time of the targets [s]; must be monotonic."""
        self._connection, self._timeout_s = connection, timeout_s
        self._targets = Targets(clock)
        self._missing = 0  # answers

    @property
    def reply(self) -> Reply | None:
        """Latest answer; None before the first."""
        return self._targets.reply

    @property
    def state(self) -> StreamState | None:
        """Latest report: phase of the arm, delay, losses, a present contact; None before the first
        target."""
        return self._targets.state


def _numbers(name: str, values: Sequence[float]) -> list[float]:
    """Values as a list. Raises ControlError for one that is not a finite number."""
    numbers = list(values)
    for i, value in enumerate(numbers):
        try:
            finite = math.isfinite(value)
        except TypeError:
            finite = False
        if not finite:
            raise ControlError(f"{name}[{i}] is {value!r}; a target has a finite number per joint")
    return numbers
