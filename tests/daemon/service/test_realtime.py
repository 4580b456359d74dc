"""Report of the real-time set-up, compared with the kernel's; in a separate process, as most of it
cannot be undone."""

import json
import os
import subprocess
import sys

PROGRAM = """
import json, os, resource, sys, threading
sys.argv = json.loads(sys.argv[1])
mode, cpus = sys.argv
if mode == "no rights":
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
from common.numeric_threads import single_threaded
from daemon.service.realtime import go_realtime
if mode != "many threads":
    single_threaded()
else:
    os.environ["OPENBLAS_NUM_THREADS"] = "3"
import numpy as np
np.ones((300, 300)) @ np.ones((300, 300))
if mode == "no rights" and os.getuid() == 0:
    os.setuid(65534)
if cpus:
    os.sched_setaffinity(0, cpus)
report = {grant.name: (grant.achieved, grant.text) for grant in go_realtime()}
status = dict(line.split(":", 1) for line in open("/proc/self/status").read().splitlines())
late = []
thread = threading.Thread(target=lambda: late.append(os.sched_getscheduler(0)))
thread.start()
thread.join()
print(json.dumps({
    "report": report,
    "locked_kB": int(status["VmLck"].split()[0]),
    "policy": os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK,
    "policy_of_later_threads": late[0],
    "threads": int(status["Threads"]),
}))
"""


def outcome(mode: str, cpus: tuple[int, ...] = ()) -> dict:
    program = [sys.executable, "-c", PROGRAM, json.dumps([mode, cpus])]
    done = subprocess.run(program, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def test_the_report_agrees_with_the_kernel() -> None:
    found = outcome("as it is")
    report = found["report"]
    assert report["memory"][0] is (found["locked_kB"] > 10_000)
    assert report["priority"][0] is (found["policy"] == os.SCHED_FIFO)
    assert found["policy_of_later_threads"] == os.SCHED_OTHER
    assert report["garbage collector"][0]
    assert report["threads"] == [True, "numeric libraries single-threaded"]
    assert found["threads"] == 1
    assert report["cpu"][0] is ((os.cpu_count() or 1) == 1)


def test_missing_rights_are_reported_and_the_program_runs() -> None:
    found = outcome("no rights")
    report = found["report"]
    reasons = ("Cannot allocate memory", "Operation not permitted")
    assert report["memory"] in [[False, f"memory not locked ({reason})"] for reason in reasons]
    assert report["priority"] == [False, "no real-time priority (Operation not permitted)"]
    assert found["locked_kB"] == 0
    assert found["policy"] == os.SCHED_OTHER


def test_threads_of_the_numeric_libraries_are_reported() -> None:
    found = outcome("many threads")
    achieved, text = found["report"]["threads"]
    # OpenBLAS starts no more than there are CPUs.
    assert achieved is (found["threads"] == 1)
    more = found["threads"] - 1
    assert achieved or text == f"numeric libraries run {more} threads of their own"


def test_one_cpu_of_many_is_named() -> None:
    there_are = os.cpu_count() or 1
    first = min(os.sched_getaffinity(0))
    achieved, text = outcome("as it is", (first,))["report"]["cpu"]
    assert achieved
    assert text == (
        f"bound to CPU {first} of {there_are}" if there_are > 1 else "bound to the only CPU"
    )
