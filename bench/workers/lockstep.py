"""Worker: the configured arm in lockstep, tracking. Asked for `seconds` of robot time, it answers
the CPU time `cpu_s` of its process."""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from bench.rigs.lockstep import lockstep_rig
from daemon.modes.table import Event


@contextmanager
def begin(options: dict[str, Any]) -> Iterator[Callable[[dict[str, Any]], dict[str, Any]]]:
    """options: the `seed` of the plant."""
    seed = options["seed"]
    with lockstep_rig(simulate=lambda s: msgspec.structs.replace(s, seed=seed)) as rig:
        rig.enable()
        rig.request(Event.START)
        rig.run(2.0)
        gc.collect()
        gc.freeze()  # as the daemon does before its loop

        def answer(request: dict[str, Any]) -> dict[str, Any]:
            begun = time.process_time()
            rig.run(request["seconds"])
            return {"cpu_s": time.process_time() - begun}

        yield answer
        gc.unfreeze()
