"""Worker: `contactd run` against a simulated arm in another process, in real time, over TCP. Asked
for `seconds`, it answers the daemon's memory, `resident_kB` and `anonymous_kB`, after them."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from bench.rigs.lockstep import ROMEO
from bench.rigs.processes import pair
from bench.soak.process import held


@contextmanager
def begin(options: dict[str, Any]) -> Iterator[Callable[[dict[str, Any]], dict[str, Any]]]:
    """It takes no options."""
    assert not options, options
    with pair(ROMEO) as both:
        client, _, states = both.subscribed()
        next(states)
        client.close()

        def answer(request: dict[str, Any]) -> dict[str, Any]:
            time.sleep(request["seconds"])
            now = held(both.daemon.pid)
            return {
                "resident_kB": now["resident memory"],
                "anonymous_kB": now["memory (anonymous)"],
            }

        yield answer
