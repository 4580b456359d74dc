"""Stream of targets to the arm: a pose after the other, at the sender's own rate.

    with Client(control_socket) as client, client.follow() as arm:
        while leader.runs():
            arm.to(leader.pose())

The daemon answers each target; answers are read when they have come, never waited for, but that to
the first one. docs/following.md explains what the arm does.
"""

import time
from collections.abc import Callable, Sequence
from typing import Final, Self

from contactd_client.connection import Connection
from contactd_client.errors import ControlError, UnreachableError
from contactd_client.messages import Reply, Request, StreamState
from contactd_client.packets import decode_reply, encode, refusal

# Answers that may be missing before the daemon counts as silent: half a second at 200 Hz.
_MOST_MISSING: Final = 100


class Stream:
    """Stream of one client, from its first target to the end of the `with` block, which halts the
    arm.

    Every method raises ControlError with the reason when the arm does not follow, or not any more
    (stopped, disabled, a fault), and UnreachableError when the daemon is gone or silent. Nothing
    else is to be asked on this connection meanwhile.
    """

    def __init__(
        self, connection: Connection, timeout_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """clock: time of the targets [s]; it must never run back."""
        self._connection, self._timeout_s, self._clock = connection, timeout_s, clock
        self._number = 0
        self._missing = 0  # answers
        self.reply: Reply | None = None
        """latest answer"""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if self._number == 0 or (error is not None and issubclass(error, ControlError)):
            return
        self._await_answers()
        self._exchange({"command": "pause"})

    @property
    def state(self) -> StreamState | None:
        """Latest report: phase of the arm, delay, losses, a contact that lasts; None before the
        first target."""
        return None if self.reply is None else self.reply.get("stream")

    def to(
        self,
        q: Sequence[float],
        velocity: Sequence[float] | None = None,
        sent_s: float | None = None,
    ) -> None:
        """Send the next target: q of all joints [rad], their velocity [rad/s] if it is known, and
        the time at which they were there [s], now unless given. The arm begins with the first."""
        now_s = self._clock() if sent_s is None else sent_s
        number, self._number = self._number, self._number + 1
        if number == 0:
            self._exchange({"command": "follow", "q": list(q), "sent_s": now_s})
            return
        target: Request = {
            "command": "target", "q": list(q), "sent_s": now_s, "number": number
        }  # fmt: skip
        if velocity is not None:
            target["velocity"] = list(velocity)
        self._connection.send(encode(target))
        self._missing += 1
        while self._missing and self._connection.waits(0.0):
            self._take_answer()
        if self._missing > _MOST_MISSING:
            raise UnreachableError("the daemon does not answer the stream")

    def rejoin(self, q: Sequence[float], sent_s: float | None = None) -> None:
        """Let the arm go slowly to q (of all joints, [rad]) and follow again, after a contact;
        sent_s as of `to`."""
        self._await_answers()
        now_s = self._clock() if sent_s is None else sent_s
        number, self._number = self._number, self._number + 1
        self._exchange({"command": "follow", "q": list(q), "sent_s": now_s, "number": number})

    def _await_answers(self) -> None:
        while self._missing:
            self._take_answer()

    def _take_answer(self) -> None:
        self._accept(self._connection.packet())
        self._missing -= 1

    def _exchange(self, request: Request) -> None:
        self._accept(self._connection.exchange(encode(request), self._timeout_s))

    def _accept(self, packet: bytes) -> None:
        self.reply = decode_reply(packet)
        if not self.reply["ok"]:
            raise ControlError(refusal(self.reply))
