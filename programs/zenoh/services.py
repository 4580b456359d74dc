"""Services of an arm, which carry out calls through the daemon's sockets, at a bounded rate.

`stop` and `disarm` use the view socket; `reset` requires the control socket. Each service has a
thread that takes all waiting calls, carries out the command once, and answers them all, so that a
thousand calls a second are a few commands. Services do not delay each other. `arm` is in
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
BUSY: Final = "busy: too many calls are waiting"

Outcome = tuple[bool, str]
Act = Callable[[str], Outcome]


class Call(Protocol):
    """Call from the network, answered once, by a payload or an error message."""

    @property
    def request(self) -> bytes:
        """Payload of the request."""

    @property
    def caller(self) -> str:
        """Name of the caller, as it states it."""

    @property
    def gid(self) -> bytes:
        """GID of the caller; zeros if unknown."""

    @property
    def sent_s(self) -> float:
        """Time at which it was sent, by the caller's clock [s]."""

    def answer(self, payload: bytes) -> None:
        """Answer with a payload."""

    def refuse(self, why: str) -> None:
        """Answer with an error."""


@dataclass(frozen=True, slots=True)
class Offer:
    """Service to offer: its type; `check`, which raises CdrError for an invalid request; `answer`,
    which returns a payload for each call; and `close`, called at its end."""

    type_name: str
    check: Callable[[bytes], object]
    answer: Callable[[Sequence[Call]], Sequence[bytes]]
    close: Callable[[], None] = lambda: None


def trigger(act: Act) -> Offer:
    """Service that carries out `act` once for all waiting calls."""

    def answer(calls: Sequence[Call]) -> list[bytes]:
        return [outcome(*act(calls[0].caller))] * len(calls)

    return Offer(TRIGGER, refuse_unless_empty, answer)


def actions(view: Path, control: Path | None) -> dict[str, Act]:
    """Acts of the services of type Trigger, by name; `reset` only with the control socket."""
    made: dict[str, Act] = {
        "stop": lambda who: _halt(view, "stop", who),
        "disarm": lambda who: _halt(view, "disarm", who),
    }
    if control is not None:
        made["reset"] = lambda who: _reset(control, who)
    return made


def endpoint(node: Node, name: str, type_name: str = TRIGGER) -> Endpoint:
    """Endpoint of a service."""
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
    """One service, from construction to `close`; `put` may be called from any thread."""

    def __init__(self, name: str, offer: Offer) -> None:
        self._offer = offer
        self._waiting: list[Call] = []
        self._changed = threading.Condition()
        self.ended = False
        self._thread = threading.Thread(target=self._run, name=f"service {name}", daemon=True)
        self._thread.start()

    def put(self, call: Call) -> None:
        """Queue a call; refuse it if it is invalid or the queue is full."""
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
        """End the service; waiting calls are refused."""
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
        except OSError as error:  # e.g. out of file descriptors, which `stop` must survive
            for call in calls:
                call.refuse(f"system error: {error}")
            return
        for call, payload in zip(calls, payloads, strict=True):
            call.answer(payload)
