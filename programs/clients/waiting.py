"""Polling of a daemon until it gives the expected answer, or a timeout."""

import time
from collections.abc import Callable
from typing import TypeVar

from daemon.protocol.replies import Reply
from programs.clients.client import Client

POLL_S = 0.02
T = TypeVar("T")


def asked_until(ask: Callable[[], T], reached: Callable[[T], bool], timeout_s: float) -> T:
    """First answer to `ask` for which `reached` is true, or the last one on timeout [s]."""
    deadline = time.monotonic() + timeout_s
    while not reached(found := ask()) and time.monotonic() < deadline:
        time.sleep(POLL_S)
    return found


def reset(client: Client, timeout_s: float) -> Reply:
    """Reply to `reset`, which is repeated while it is refused because the arm is not confirmed at
    standstill yet, as is common just after a fault."""

    def ask() -> Reply:
        return client.request("reset")

    return asked_until(ask, lambda reply: reply.ok or not reply.unproved, timeout_s)
