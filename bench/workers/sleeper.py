"""Worker: a control thread that does nothing but wake up, with the daemon's real-time set-up.

Asked for `seconds`, it answers how late it woke up each time, `lateness_us`. Stands in for
cyclictest where that is not installed.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from daemon.run import sleep_until
from daemon.service.realtime import go_realtime


@contextmanager
def begin(options: dict[str, Any]) -> Iterator[Callable[[dict[str, Any]], dict[str, Any]]]:
    """options: `hz`, how often it wakes up."""
    period_s = 1.0 / options["hz"]
    go_realtime()

    def answer(request: dict[str, Any]) -> dict[str, Any]:
        begun = time.monotonic()
        k, late = 1, []
        while k * period_s <= request["seconds"]:
            sleep_until(begun + k * period_s)
            woken_s = time.monotonic() - begun
            late.append(1e6 * (woken_s - k * period_s))
            k = max(k, int(woken_s / period_s)) + 1  # as cyclictest and the loop go on
        return {"lateness_us": late}

    yield answer
