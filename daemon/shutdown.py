"""Shutdown of the arm: brought to rest as configured and confirmed, or stopped at once on an error.

`bring_to_rest` is the orderly shutdown; `stop_on_error` commands a quick stop of the drives before
anything else is done, whatever fails in the loop.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from common.errors import ProgramError
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.modes.table import Event, Mode
from daemon.tick.loop import Loop
from daemon.tick.tick import Tick
from drivers.api import BootableDrives

# Time for the drives to reach their final state [s].
TIMEOUT_S = 1.0
# A frame may be lost: the quick stop is sent this many times, a period apart.
REPEATS = 3

_log = logging.getLogger("contactd")


def bring_to_rest(
    loop: Loop, doors: Callable[[], None], stop_timeout_s: float, why: str
) -> list[str]:
    """Decelerate, stop, bring every joint to its configured end, and confirm it.

    Returns the names of drives that did not follow. The loop continues meanwhile, and our heartbeat
    until the last tick.
    """
    tick = loop.tick
    machine = tick.controller.machine

    def tick_until(done: Callable[[], bool], timeout_s: float) -> None:
        end = loop.time_s + timeout_s
        loop.run(doors, lambda: not done() and loop.time_s < end)

    tick.controller.request(Event.DISABLE, why, loop.time_s)
    # A joint that does not stop in time becomes a fault, and then a quick stop. An arm that holds
    # is off at once, but the next tick sends this to the drives, and they latch it at the SYNC
    # after that.
    resting, heard = (Mode.OFF, Mode.FAULTED), tick.number + 2
    tick_until(lambda: machine.mode in resting and tick.number >= heard, stop_timeout_s + TIMEOUT_S)
    tick_until(lambda: not _stragglers(tick), TIMEOUT_S)
    return _stragglers(tick)


def _stragglers(tick: Tick) -> list[str]:
    """Names of drives that do not report, in this tick, the state that was last commanded."""
    last = tick.last
    if last is None or last.decision is None:
        return []
    joints = zip(last.samples.drives, last.decision.power, last.samples.arrived, strict=True)
    wrong = np.flatnonzero([not (arrived and d.condition.reached(on)) for d, on, arrived in joints])
    return [tick.drives.names[i] for i in wrong]


@contextmanager
def stop_on_error(
    drives: BootableDrives, period_s: float, sleep: Callable[[float], None] = time.sleep
) -> Iterator[None]:
    """Quick stop of all drives on any exception of the block. Its traceback is logged, and
    ProgramError is raised from it. From then on the drives hold by themselves."""
    try:
        yield
    except Exception as error:
        for _ in range(REPEATS):
            drives.quick_stop()
            sleep(period_s)
        finding = Finding(Condition.PROGRAM_ERROR, f"{type(error).__name__}: {error}")
        _log.critical("%s", finding, exc_info=error)
        raise ProgramError(f"{finding}; a quick stop was sent to the drives") from error
