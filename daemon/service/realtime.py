"""Real-time set-up of the process; each step is reported as achieved or not.

The daemon also runs without the privileges. Imports nothing that may start threads.
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
    """Lock memory, give this thread a real-time priority, freeze the garbage collector, and check
    CPU affinity and threads. To be called in the loop's thread, when all that it needs is
    loaded."""
    return [_lock_memory(), _schedule(), _freeze(), _cpus(), _threads()]


def leave_realtime() -> None:
    """Restore normal priority and unfreeze the garbage collector after the loop has ended, so that
    its objects are collected, and files are read at normal priority. Memory stays locked."""
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
    # Only this thread: threads that it starts later, and the log's writer, have normal priority.
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
    allowed, total = sorted(os.sched_getaffinity(0)), os.cpu_count() or 1
    if len(allowed) < total:
        names = ", ".join(map(str, allowed))
        return Grant("cpu", True, f"bound to CPU {names} of {total}")
    if total == 1:
        return Grant("cpu", True, "bound to the only CPU")
    return Grant("cpu", False, f"not bound to a CPU (free to move among {total})")


def _threads() -> Grant:
    """Check for threads of this process that are not Python's own."""
    total = len(list(Path("/proc/self/task").iterdir()))
    foreign = total - threading.active_count()
    if foreign <= 0:
        return Grant("threads", True, "numeric libraries single-threaded")
    return Grant("threads", False, f"numeric libraries run {foreign} threads of their own")
