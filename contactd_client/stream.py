"""Stream of targets to the arm: successive poses at the sender's own rate.

    with Client(control_socket) as client, client.follow() as arm:
        while leader.runs():
            arm.to(leader.pose())

The daemon answers each target; except for the first, answers are read without blocking.
docs/following.md explains the behaviour of the arm.
"""

from collections.abc import Sequence
from typing import Self

from contactd_client.connection import Connection
from contactd_client.errors import ControlError, UnreachableError
from contactd_client.targets import MOST_MISSING, PAUSE, TargetStream


class Stream(TargetStream[Connection]):
    """Stream of one client, from its first target to the end of the `with` block, which halts the
    arm.

    Every method raises ControlError with the reason if the arm does not follow, or no longer does
    (stopped, disabled, a fault), and UnreachableError if the daemon is gone or silent. Send no
    other requests on this connection meanwhile.
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None or not issubclass(error, ControlError):
            self.end()

    def to(
        self,
        q: Sequence[float],
        velocity: Sequence[float] | None = None,
        sent_s: float | None = None,
    ) -> None:
        """Send the next target: q of all joints [rad], their velocity [rad/s] if known, and the
        time of that pose [s] (default: now). The arm starts to follow with the first target."""
        if self.reply is None:
            self._exchange(self._targets.follow(q, sent_s))
            return
        self._connection.send(self._targets.target(q, velocity, sent_s))
        self._missing += 1
        while self._missing and self._connection.waits(0.0):
            self._take_answer()
        if self._missing > MOST_MISSING:
            raise UnreachableError("the daemon does not answer the stream")

    def rejoin(self, q: Sequence[float], sent_s: float | None = None) -> None:
        """Move the arm slowly to q (of all joints, [rad]) after a contact, and follow again; sent_s
        as for `to`. Raises ControlError if q is out of reach; the stream continues."""
        self._await_answers()
        self._exchange(self._targets.follow(q, sent_s))

    def end(self) -> None:
        """Halt the arm if it follows."""
        if self._targets.follows:
            self._await_answers()
            self._exchange(PAUSE)

    def _await_answers(self) -> None:
        while self._missing:
            self._take_answer()

    def _take_answer(self) -> None:
        packet = self._connection.packet()
        self._missing -= 1
        self._targets.accept(packet)

    def _exchange(self, request: bytes) -> None:
        self._targets.accept(self._connection.exchange(request, self._timeout_s))
