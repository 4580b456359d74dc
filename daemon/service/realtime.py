"""Real-time set-up of the process; each step is reported as achieved or not.

The daemon also runs on a machine without the rights. Imports nothing that may start threads.
"""

import ctypes
import gc
import os
import threading
from pathlib import Path

from daemon.protocol.replies import Grant

# Above all processes of the user, below the kernel's own interrupt threads (50).
FIFO_PRIORITY = 40

_MCL_CURRENT, _MCL_FUTURE = 1, 2


def go_realtime() -> list[Grant]:
    """Lock memory, give this thread a real-time priority, freeze the objects that the garbage
    collector would walk, and check the rest. For the loop's thread, when all that it needs is
    loaded."""
    return [_lock_memory(), _schedule(), _freeze(), _cpus(), _threads()]


def leave_realtime() -> None:
    """Give back priority and frozen objects, so that the remains of a loop are collected, and files
    are read at normal priority. Memory stays locked."""
    gc.unfreeze()
    gc.enable()
    # The reset of the policy on fork cannot be undone without privilege.
    os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def _lock_memory() -> Grant:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
        return Grant("memory", True, "memory locked")
    return Grant("memory", False, f"memory not locked ({os.strerror(ctypes.get_errno())})")


def _schedule() -> Grant:
    # This thread alone: threads that it starts later have normal priority, as has the log's writer.
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
    """CPUs of the loop, which the administrator sets (`CPUAffinity=`, `taskset`)."""
    mine, there_are = sorted(os.sched_getaffinity(0)), os.cpu_count() or 1
    if len(mine) < there_are:
        names = ", ".join(map(str, mine))
        return Grant("cpu", True, f"bound to CPU {names} of {there_are}")
    if there_are == 1:
        return Grant("cpu", True, "bound to the only CPU")
    return Grant("cpu", False, f"not bound to a CPU (free to move among {there_are})")


def _threads() -> Grant:
    """Count the threads of this process that are not Python's own."""
    there_are = len(list(Path("/proc/self/task").iterdir()))
    strange = there_are - threading.active_count()
    if strange <= 0:
        return Grant("threads", True, "numeric libraries single-threaded")
    return Grant("threads", False, f"numeric libraries run {strange} threads of their own")
