"""Real-time set-up of the process; each step is reported as achieved or not.

A machine without the rights works all the same. Imports nothing that may start threads.
"""

import ctypes
import gc
import os
import threading
from pathlib import Path

from daemon.protocol.messages import Grant

# A robot's loop goes before everything of the user, after the kernel's own interrupt threads (50).
FIFO_PRIORITY = 40

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_THREAD_COUNTS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def single_threaded() -> None:
    """Have the numeric libraries, which read this when they are loaded, start no threads: on
    matrices of seven rows these cost more than they give, and spin beside the loop."""
    for name in _THREAD_COUNTS:
        os.environ[name] = "1"


def go_realtime() -> list[Grant]:
    """Lock memory, give this thread a real-time priority, freeze what the garbage collector would
    walk, and look at the rest. For the loop's thread, when all that it needs is loaded."""
    return [_lock_memory(), _schedule(), _freeze(), _cpus(), _threads()]


def leave_realtime() -> None:
    """Give back priority and frozen objects, so that what a loop leaves behind is collected, and
    files are read by a process in no hurry. Memory stays locked."""
    gc.unfreeze()
    gc.enable()
    # What was said of forks cannot be taken back without privilege.
    os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def _lock_memory() -> Grant:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
        return Grant("memory", True, "memory locked")
    return Grant("memory", False, f"memory not locked ({os.strerror(ctypes.get_errno())})")


def _schedule() -> Grant:
    # This thread alone: what it starts later (the log's writer has started) is in no hurry.
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(FIFO_PRIORITY))
    except OSError as error:
        return Grant("priority", False, f"no real-time priority ({error.strerror})")
    return Grant("priority", True, f"real-time priority {FIFO_PRIORITY} (FIFO)")


def _freeze() -> Grant:
    gc.collect()
    gc.freeze()
    gc.disable()
    return Grant("garbage collector", True, "garbage collector frozen")


def _cpus() -> Grant:
    """CPUs of the loop, which are the administrator's to say (`CPUAffinity=`, `taskset`)."""
    mine, there_are = sorted(os.sched_getaffinity(0)), os.cpu_count() or 1
    if len(mine) < there_are:
        names = ", ".join(map(str, mine))
        return Grant("cpu", True, f"bound to CPU {names} of {there_are}")
    if there_are == 1:
        return Grant("cpu", True, "bound to the only CPU")
    return Grant("cpu", False, f"not bound to a CPU (free to move among {there_are})")


def _threads() -> Grant:
    """Count what the kernel runs for this process beside Python's own threads."""
    there_are = len(list(Path("/proc/self/task").iterdir()))
    strange = there_are - threading.active_count()
    if strange <= 0:
        return Grant("threads", True, "numeric libraries single-threaded")
    return Grant("threads", False, f"numeric libraries run {strange} threads of their own")
