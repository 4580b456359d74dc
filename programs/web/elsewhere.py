"""Arms of other computers on the page: shows those at a Zenoh router, and stops them.

Equivalent to `contactd fleet`. Waiting for the router and for answers is done in threads, so that
the page is not delayed.
"""

import asyncio
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from common.errors import ContactdError
from programs.web.words import Elsewhere, Other, Outcome
from programs.zenoh.fleet import Arm
from programs.zenoh.graph import configuration
from programs.zenoh.names import Distro
from programs.zenoh.supervisor import Supervisor, supervising

MOST_SHOWN: Final = 64
MOST_STOPS: Final = 8  # stops that wait for answers at once
RETRY_S: Final = 5.0


class Router:
    """Connection to a Zenoh router, from construction to `close`. `where`: an endpoint or a file
    with a Zenoh configuration. Raises ConfigurationError for anything else."""

    def __init__(self, where: str, domain: int, distro: str) -> None:
        self._file = Path(where) if where.endswith(".json5") else None
        self._connect = () if self._file else (where,)
        self._domain, self._distro = domain, Distro(distro)
        configuration(self._connect, self._file, option="--fleet")
        self._supervisor: Supervisor | None = None
        self._why = f"no router yet at {where}"
        self._ended = threading.Event()
        self._stops = ThreadPoolExecutor(MOST_STOPS, "stop elsewhere")
        self._waiting = 0
        threading.Thread(target=self._listen, name="elsewhere", daemon=True).start()

    def close(self) -> None:
        """Disconnect; pending stops get no answer."""
        self._ended.set()
        self._stops.shutdown(wait=False, cancel_futures=True)

    def shown(self) -> Elsewhere:
        """Present state of all arms."""
        supervisor = self._supervisor
        if supervisor is None:
            return Elsewhere(self._why, [])
        return shown_of(supervisor.arms(), time.monotonic())

    async def stop(self, name: str) -> Mapping[str, Outcome] | None:
        """Stop the arm of this name, or for an empty name all that are alive; returns the outcome
        of each, or None if too many stops are pending."""
        supervisor = self._supervisor
        if supervisor is None:
            return {name: Outcome("no answer", self._why)} if name else {}
        if self._waiting >= MOST_STOPS:
            return None
        self._waiting += 1
        try:
            found = await asyncio.get_running_loop().run_in_executor(
                self._stops, lambda: supervisor.stop([name]) if name else supervisor.stop_all()
            )
        finally:
            self._waiting -= 1
        return {arm: Outcome(what, text) for arm, (what, text) in found.items()}

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                with supervising(
                    self._connect, self._file, self._domain, self._distro, -1
                ) as supervisor:
                    self._supervisor = supervisor
                    self._ended.wait()
            except ContactdError as error:
                self._why = str(error)
            self._supervisor = None
            self._ended.wait(RETRY_S)


def shown_of(arms: Sequence[Arm], now_s: float) -> Elsewhere:
    """Message with at most MOST_SHOWN arms, and the number of others."""
    more = len(arms) - MOST_SHOWN
    why = f"{more} more arms are not shown, but are stopped with all: `contactd fleet` shows them."
    return Elsewhere(why if more > 0 else "", [_other(arm, now_s) for arm in arms[:MOST_SHOWN]])


def _other(arm: Arm, now_s: float) -> Other:
    return Other(
        arm=arm.name,
        state=arm.state(now_s),
        silent=arm.silent_s(now_s) is not None,
        mode=arm.mode,
        armed=arm.armed == "true",
        level=arm.level.name,
        text=arm.says,
        contact=arm.contact,
    )
