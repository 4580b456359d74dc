"""What this machine grants of a real-time set-up; each step reported as achieved or not."""

import ctypes
import gc
import os

# A robot's loop goes before everything of the user, after the kernel's own interrupt threads.
FIFO_PRIORITY = 40
_MCL_CURRENT, _MCL_FUTURE = 1, 2


def go_realtime() -> list[str]:
    """Lock memory, take a real-time priority, freeze what the garbage collector would walk.

    A machine without the rights works all the same; each line says what was achieved.
    """
    return [_lock_memory(), _schedule(), _freeze()]


def _lock_memory() -> str:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
        return "memory locked"
    return f"memory not locked ({os.strerror(ctypes.get_errno())})"


def _schedule() -> str:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except OSError as error:
        return f"no real-time priority ({error.strerror})"
    return f"real-time priority {FIFO_PRIORITY} (FIFO)"


def _freeze() -> str:
    gc.collect()
    gc.freeze()
    gc.disable()
    return "garbage collector frozen"
