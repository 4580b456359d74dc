"""Service `arm`: arming by calls from the network, through the daemon's control socket.

The lease belongs to one connection of this process and never outlasts the validity of the calls
(`holding.py`). It therefore expires by the daemon's own clock if the caller, router, network or
this process is gone or hangs.
"""

import time
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final, Literal, Protocol, Self

from common.errors import ContactdError
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Arm, Renew, Request
from daemon.protocol.text import on_behalf_of
from programs.clients.client import Client
from programs.zenoh.cdr import read_flag
from programs.zenoh.holding import HOLD_S, RELEASE_FIRST, ArmCall, Hold, Step, Verdict
from programs.zenoh.messages import outcome
from programs.zenoh.services import Act, Call, Offer, Outcome

SET_BOOL: Final = "std_srvs/srv/SetBool"


class Line(Protocol):
    """Connection to the control socket, such as `Client`; its lease ends with it."""

    def ask(self, request: Request) -> Reply:
        """Send a request and return the reply. Raises ContactdError."""

    def close(self) -> None:
        """Hang up."""


class Arming:
    """Handler of calls of `arm` for the daemon that `connect` reaches; `disarm` carries out a call
    with false. Only used by the thread of its service."""

    def __init__(
        self, connect: Callable[[], Line], disarm: Act, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._connect, self._disarm, self._clock = connect, disarm, clock
        self._hold = Hold()
        self._line: Line | None = None

    @classmethod
    def at(cls, control: Path, disarm: Act) -> Self:
        """Handler at this control socket, with the length of a lease as timeout of replies."""
        return cls(lambda: Client(control, HOLD_S), disarm)

    def offer(self) -> Offer:
        """Service offer of this handler."""
        return Offer(SET_BOOL, read_flag, self.answer, self.close)

    def answer(self, calls: Sequence[Call]) -> list[bytes]:
        """Answers to these calls in order; consecutive equal calls of one caller are carried out
        once, by the last of them."""
        answers: list[bytes] = []
        for _, group in groupby(calls, lambda call: (call.gid, read_flag(call.request))):
            same = list(group)
            payload = outcome(*self._carry_out(same[-1]))
            answers += [payload] * len(same)
        return answers

    def close(self) -> None:
        """Close the connection to the daemon, which ends the lease."""
        if self._line is not None:
            self._line.close()
        self._line = None

    def _carry_out(self, call: Call) -> Outcome:
        request = ArmCall(call.gid, read_flag(call.request), call.sent_s)
        if request.armed and not any(call.gid):
            return False, "a call without an attachment: its caller is unknown"
        verdict = self._hold.judge(request, self._clock())
        match verdict.step:
            case Step.NOTHING:
                return False, verdict.why
            case Step.DISARM:
                self._hold.release(request.caller)
                self.close()
                return self._disarm(call.caller)
            case Step.ARM:
                return self._arm(call, request, verdict)
            case Step.RENEW:
                return self._renew(call, request, verdict)

    def _arm(self, call: Call, request: ArmCall, verdict: Verdict) -> Outcome:
        self.close()
        try:
            self._line = self._connect()
            reply = self._ask("arm", call, verdict)
        except ContactdError as error:
            self.close()
            return False, f"not reached: {error}"
        if not reply.ok:
            self.close()
            return False, reply.refusal
        self._hold.granted(request, verdict.lease_s, self._clock())
        return True, reply.message

    def _renew(self, call: Call, request: ArmCall, verdict: Verdict) -> Outcome:
        try:
            reply = self._ask("renew", call, verdict)
        except ContactdError as error:
            self._lose()
            return False, f"not reached: {error}"
        if not reply.ok:
            self._lose()
            return False, f"{RELEASE_FIRST} ({reply.refusal})"
        self._hold.granted(request, verdict.lease_s, self._clock())
        return True, reply.message

    def _lose(self) -> None:
        self._hold.lose()
        self.close()

    def _ask(self, command: Literal["arm", "renew"], call: Call, verdict: Verdict) -> Reply:
        assert self._line is not None
        who = on_behalf_of(call.caller)
        return self._line.ask(
            {"arm": Arm, "renew": Renew}[command](lease_s=verdict.lease_s, on_behalf_of=who)
        )
