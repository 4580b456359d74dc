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
        late = []
        for k in range(1, round(request["seconds"] / period_s) + 1):
            deadline = begun + k * period_s
            sleep_until(deadline)
            late.append(1e6 * (time.monotonic() - deadline))
        return {"lateness_us": late}

    yield answer
