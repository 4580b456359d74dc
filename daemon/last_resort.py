"""Whatever breaks in the loop, the drives are told to stop before anything else is done."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from daemon.faults.table import Condition, Finding
from drivers.arm import Arm
from errors import ProgramError

# A frame may be lost: the quick stop is sent so often, a period apart.
REPEATS = 3

_log = logging.getLogger("contactd")


@contextmanager
def stop_on_error(
    arm: Arm, period_s: float, sleep: Callable[[float], None] = time.sleep
) -> Iterator[None]:
    """Quick stop of all drives on any exception of the block; its traceback goes to the log, and
    ProgramError is raised from it. The drives hold by themselves from then on."""
    try:
        yield
    except Exception as error:
        for _ in range(REPEATS):
            arm.quick_stop()
            sleep(period_s)
        finding = Finding(Condition.PROGRAM_ERROR, f"{type(error).__name__}: {error}")
        _log.critical("%s", finding, exc_info=error)
        raise ProgramError(f"{finding}; the drives were told to quick-stop") from error
