"""Ending of the arm: at rest as configured and seen to be so, or stopped at once on an error.

`bring_to_rest` ends an undisturbed program; `stop_on_error` tells the drives to quick-stop before
anything else is done, whatever breaks in the loop.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from daemon.faults.finding import Finding
from daemon.faults.table import Condition
from daemon.modes.table import Event, Mode
from daemon.tick.loop import Loop
from daemon.tick.tick import Tick
from drivers.cia402 import reached
from drivers.drives import Drives
from errors import ProgramError

# How long the drives may take to reach the state they end in [s].
PATIENCE_S = 1.0
# A frame may be lost: the quick stop is sent so often, a period apart.
REPEATS = 3

_log = logging.getLogger("contactd")


def bring_to_rest(
    loop: Loop, doors: Callable[[], None], stop_timeout_s: float, why: str
) -> list[str]:
    """Decelerate, stop, let every joint end as configured, and see that it did.

    Returns the names of drives that did not follow. The loop goes on ticking meanwhile, and so does
    our heartbeat; it ends with the last tick.
    """
    tick = loop.tick
    machine = tick.controller.machine

    def tick_until(done: Callable[[], bool], patience_s: float) -> None:
        end = loop.time_s + patience_s
        loop.run(doors, lambda: not done() and loop.time_s < end)

    tick.controller.request(Event.DISABLE, why, loop.time_s)
    # A joint that does not stop in time becomes a fault, and then a quick stop. An arm that holds
    # is off at once, but the next tick tells the drives so, and the SYNC after it makes them hear.
    resting, heard = (Mode.OFF, Mode.FAULTED), tick.number + 2
    tick_until(
        lambda: machine.mode in resting and tick.number >= heard, stop_timeout_s + PATIENCE_S
    )
    tick_until(lambda: not _stragglers(tick), PATIENCE_S)
    return _stragglers(tick)


def _stragglers(tick: Tick) -> list[str]:
    """Names of drives that do not say, in this tick, that they have reached the state that was last
    asked of them."""
    last = tick.last
    if last is None or last.decision is None:
        return []
    told = zip(last.samples.states, last.decision.power, last.samples.fresh, strict=True)
    wrong = np.flatnonzero([not (fresh and reached(state, on)) for state, on, fresh in told])
    return [tick.drives.names[i] for i in wrong]


@contextmanager
def stop_on_error(
    drives: Drives, period_s: float, sleep: Callable[[float], None] = time.sleep
) -> Iterator[None]:
    """Quick stop of all drives on any exception of the block; its traceback goes to the log, and
    ProgramError is raised from it. The drives hold by themselves from then on."""
    try:
        yield
    except Exception as error:
        for _ in range(REPEATS):
            drives.quick_stop()
            sleep(period_s)
        finding = Finding(Condition.PROGRAM_ERROR, f"{type(error).__name__}: {error}")
        _log.critical("%s", finding, exc_info=error)
        raise ProgramError(f"{finding}; the drives were told to quick-stop") from error
