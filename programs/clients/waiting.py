"""Waiting for a daemon's answer: asked again until it is the one, or patience ends."""

import time
from collections.abc import Callable
from typing import TypeVar

from daemon.protocol.replies import Reply
from programs.clients.client import Client

POLL_S = 0.02
T = TypeVar("T")


def asked_until(ask: Callable[[], T], reached: Callable[[T], bool], patience_s: float) -> T:
    """First answer to `ask` of which `reached` is true, or the last one once patience [s] ended."""
    deadline = time.monotonic() + patience_s
    while not reached(found := ask()) and time.monotonic() < deadline:
        time.sleep(POLL_S)
    return found


def reset(client: Client, patience_s: float) -> Reply:
    """Reply to `reset`, which is asked again while the only reason against it is that the arm is
    not confirmed at standstill yet: it is often asked for in the moment of the fault."""

    def ask() -> Reply:
        return client.request("reset")

    return asked_until(ask, lambda reply: reply.ok or not reply.unproved, patience_s)
