"""Arms of other machines on the page, as a Zenoh router knows them, and stops for them.

The same as `contactd fleet` shows and does, and no more. Waiting for the router, and for answers,
is done in threads: the page goes on without.
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
MOST_STOPS: Final = 8  # that wait for their answers at once
RETRY_S: Final = 5.0


class Router:
    """Router where other arms are, from construction to `close`: `where` is an endpoint or a file
    with a Zenoh configuration. Raises ConfigurationError for what is neither."""

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
        """End; who waits for an answer gets none."""
        self._ended.set()
        self._stops.shutdown(wait=False, cancel_futures=True)

    def shown(self) -> Elsewhere:
        """All arms, as of now."""
        supervisor = self._supervisor
        if supervisor is None:
            return Elsewhere(self._why, [])
        return shown_of(supervisor.arms(), time.monotonic())

    async def stop(self, name: str) -> Mapping[str, Outcome] | None:
        """Stop the arm of this name, or with an empty one all that are alive; returns the outcome
        of each. None where too many stops wait."""
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
    """These arms, and how many there are beyond those that have room."""
    more = len(arms) - MOST_SHOWN
    why = f"{more} more are known, and stopped with all of them: `contactd fleet` shows them."
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
