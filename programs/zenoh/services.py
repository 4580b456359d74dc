"""Services of an arm: calls carried out at the daemon's sockets, bounded.

`stop` and `disarm` go through the view socket; `reset` only where the control socket was given. One
thread for each service takes all calls that wait, carries the command out once, and answers them
all: a thousand calls a second are a few commands. No call waits behind another service. `arm` is in
`arming.py`.
"""

import asyncio
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from common.errors import ContactdError
from daemon.protocol.requests import Reset
from daemon.protocol.text import on_behalf_of
from programs.clients.client import Client
from programs.clients.stopping import Command, carry_out
from programs.zenoh.cdr import CdrError, refuse_unless_empty
from programs.zenoh.messages import outcome
from programs.zenoh.names import Endpoint, Kind, Node, Qos

MOST_WAITING: Final = 64
TRIGGER: Final = "std_srvs/srv/Trigger"
BUSY: Final = "busy: too many calls wait"

Outcome = tuple[bool, str]
Act = Callable[[str], Outcome]


class Call(Protocol):
    """A call from outside that is answered once: by a payload, or by an error in words."""

    @property
    def request(self) -> bytes:
        """Its payload."""

    @property
    def caller(self) -> str:
        """Name of the caller, as it states it."""

    @property
    def gid(self) -> bytes:
        """GID of the caller, zeros where it is not known."""

    @property
    def sent_s(self) -> float:
        """Time at which it was sent, by the caller's clock [s]."""

    def answer(self, payload: bytes) -> None:
        """Answer it."""

    def refuse(self, why: str) -> None:
        """Answer that it was no call."""


@dataclass(frozen=True, slots=True)
class Offer:
    """A service: its type; `check`, which raises CdrError for what is no request; `answer`, one
    payload for each call; and what is to be closed at its end."""

    type_name: str
    check: Callable[[bytes], object]
    answer: Callable[[Sequence[Call]], Sequence[bytes]]
    close: Callable[[], None] = lambda: None


def trigger(act: Act) -> Offer:
    """A service that does `act` once for all calls that wait."""

    def answer(calls: Sequence[Call]) -> list[bytes]:
        return [outcome(*act(calls[0].caller))] * len(calls)

    return Offer(TRIGGER, refuse_unless_empty, answer)


def actions(view: Path, control: Path | None) -> dict[str, Act]:
    """Acts of the services of type Trigger, by name: without the control socket none that needs
    it."""
    made: dict[str, Act] = {
        "stop": lambda who: _halt(view, "stop", who),
        "disarm": lambda who: _halt(view, "disarm", who),
    }
    if control is not None:
        made["reset"] = lambda who: _reset(control, who)
    return made


def endpoint(node: Node, name: str, type_name: str = TRIGGER) -> Endpoint:
    """The service's endpoint."""
    return Endpoint(Kind.SERVICE, node.absolute(name), type_name, Qos.DEFAULT)


def _halt(view: Path, command: Command, who: str) -> Outcome:
    stopped = asyncio.run(carry_out(view, command, on_behalf_of(who)))
    done = stopped.outcome in ("stands", "disarmed")
    return done, f"{stopped.outcome}: {stopped.text}" if stopped.text else stopped.outcome


def _reset(control: Path, who: str) -> Outcome:
    try:
        with Client(control) as client:
            reply = client.ask(Reset(on_behalf_of=on_behalf_of(who)))
    except ContactdError as error:
        return False, f"not reached: {error}"
    return reply.ok, reply.message if reply.ok else reply.refusal


class Service:
    """One service, from construction to `close`; `put` is called from any thread."""

    def __init__(self, name: str, offer: Offer) -> None:
        self._offer = offer
        self._waiting: list[Call] = []
        self._changed = threading.Condition()
        self.ended = False
        self._thread = threading.Thread(target=self._run, name=f"service {name}", daemon=True)
        self._thread.start()

    def put(self, call: Call) -> None:
        """Take a call, or refuse it: what is no request, and what finds no place."""
        try:
            self._offer.check(call.request)
        except CdrError as error:
            call.refuse(str(error))
            return
        with self._changed:
            full = len(self._waiting) >= MOST_WAITING or self.ended
            if not full:
                self._waiting.append(call)
                self._changed.notify()
        if full:
            call.refuse(BUSY)

    def close(self) -> None:
        """End; calls that wait are refused."""
        with self._changed:
            self.ended = True
            self._changed.notify()
        self._thread.join()
        self._offer.close()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self.ended:
                    self._changed.wait()
                calls, self._waiting = self._waiting, []
                ended = self.ended
            if ended:
                for call in calls:
                    call.refuse("the bridge is ending")
                return
            self._answer(calls)

    def _answer(self, calls: Sequence[Call]) -> None:
        try:
            payloads = self._offer.answer(calls)
        except OSError as error:  # as without a file descriptor left: `stop` must outlive that
            for call in calls:
                call.refuse(f"this machine fails: {error}")
            return
        for call, payload in zip(calls, payloads, strict=True):
            call.answer(payload)
