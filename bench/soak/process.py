"""Memory, descriptors and times of a process, from the kernel."""

import os
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def cpu_s(pid: int) -> float:
    """CPU time that it took so far, all threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def held(pid: int) -> dict[str, float]:
    """Memory [kB], open files, threads and children, by the names of the samples."""
    folder = Path(f"/proc/{pid}")
    status = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
    children = (folder / "task" / str(pid) / "children").read_text().split()
    return {
        "memory (anonymous)": float(status["RssAnon"].split()[0]),
        "resident memory": float(status["VmRSS"].split()[0]),
        "file descriptors": float(len(os.listdir(folder / "fd"))),
        "threads and helpers": float(status["Threads"]) + len(children),
    }


class Stopwatch:
    """CPU time per tick of a process between two looks."""

    def __init__(self, pid: int) -> None:
        self._pid, self._cpu_s, self._ticks = pid, cpu_s(pid), 0

    def per_tick_us(self, ticks: int) -> float:
        """Since the look before; `ticks` since the beginning."""
        now = cpu_s(self._pid)
        spent = 1e6 * (now - self._cpu_s) / max(ticks - self._ticks, 1)
        self._cpu_s, self._ticks = now, ticks
        return spent
