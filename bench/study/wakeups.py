"""Wake-ups of control threads: how late they come, as histograms, and a rival of the daemon's loop
that does nothing else than wake up.

The rival is cyclictest of Debian's rt-tests. Where that is not installed, or lacks the rights that
it needs, a sleeping thread with the daemon's own real-time set-up takes its place.
"""

import contextlib
import json
import multiprocessing
import os
import shutil
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.run import sleep_until
from daemon.service.realtime import FIFO_PRIORITY, go_realtime

LONGEST_US: Final = 100_000  # of cyclictest's histogram


@dataclass(frozen=True, slots=True)
class Distribution:
    """Figures in us with how often each came up, in rising order."""

    values: NDArray[np.float64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, figures: Sequence[float] | NDArray[np.float64]) -> "Distribution":
        """Distribution of these, to a tenth of a microsecond; NaN are left out."""
        found = np.asarray(figures, dtype=np.float64)
        values, counts = np.unique(np.round(found[~np.isnan(found)], 1), return_counts=True)
        return cls(values, counts)

    def __add__(self, other: "Distribution") -> "Distribution":
        values, place = np.unique(np.append(self.values, other.values), return_inverse=True)
        counts = np.bincount(place, np.append(self.counts, other.counts), values.size)
        return Distribution(values, counts.astype(np.int64))

    def at(self, percent: float) -> float:
        """The smallest value that so many per cent do not exceed."""
        share = np.cumsum(self.counts) / max(self.counts.sum(), 1)
        return float(self.values[min(np.searchsorted(share, percent / 100.0), share.size - 1)])

    def beyond(self, limit: float) -> int:
        """Number of larger ones."""
        return int(self.counts[self.values > limit].sum())

    def data(self) -> dict[str, float]:
        """Percentiles for JSON."""
        return {f"p{p:g}": round(self.at(p), 1) for p in (50, 90, 99, 99.9, 100)}


class Spawned:
    """Process of its own that answers one request after the other, by a pipe."""

    def __init__(self, serve: Callable[..., None], *arguments: object) -> None:
        """`serve(connection, *arguments)` runs in it, and says once that it is ready. Raises
        EOFError if it ends before that, having said why on stderr."""
        spawned = multiprocessing.get_context("spawn")
        self.connection, theirs = spawned.Pipe()
        self._process = spawned.Process(target=serve, args=(theirs, *arguments), daemon=True)
        self._process.start()
        theirs.close()
        self.connection.recv()

    def close(self) -> None:
        """End it and wait."""
        self.connection.close()
        self._process.join()


@contextlib.contextmanager
def a_rival(hz: int) -> Iterator["Rival"]:
    """A control thread that only wakes up, as often as the loop, beside each turn: cyclictest, or
    where it cannot be had a sleeping thread of ours."""
    with tempfile.TemporaryDirectory(prefix="cyclictest-") as folder:
        if program := shutil.which("cyclictest"):
            with contextlib.closing(Cyclictest(program, hz, Path(folder) / "json")) as cyclictest:
                if cyclictest.works():
                    yield cyclictest
                    return
        with contextlib.closing(Sleeper(hz)) as sleeper:
            yield sleeper


class Sleeper(Spawned):
    """A process whose thread does nothing but wake up, with the daemon's real-time set-up."""

    name, threads = "sleeper", 1

    def __init__(self, hz: int) -> None:
        super().__init__(_sleep, 1.0 / hz)

    def begin(self, seconds: int) -> None:
        self.connection.send(seconds)

    def result(self) -> Distribution:
        return Distribution.of(self.connection.recv())


def _sleep(connection: Connection, period_s: float) -> None:
    go_realtime()
    connection.send(None)
    with contextlib.suppress(EOFError):
        while True:
            connection.send(_lateness_us(connection.recv(), period_s))


def _lateness_us(seconds: float, period_s: float) -> list[float]:
    begun = time.monotonic()
    k, late = 1, []
    while k * period_s <= seconds:
        sleep_until(begun + k * period_s)
        woken_s = time.monotonic() - begun
        late.append(1e6 * (woken_s - k * period_s))
        k = max(k, int(woken_s / period_s)) + 1  # as cyclictest and the loop go on
    return late


class Cyclictest:
    """cyclictest at the loop's interval and priority, with a thread on each CPU: a machine that is
    a guest of another loses one of them at a time."""

    name = "cyclictest"
    threads = os.cpu_count() or 1

    def __init__(self, program: str, hz: int, report: Path) -> None:
        self._report = report
        self._words = [
            *(program, "--quiet", "--mlockall", f"--priority={FIFO_PRIORITY}"),
            *(f"--interval={1_000_000 // hz}", "--smp"),
            *(f"--histogram={LONGEST_US}", f"--json={report}"),
        ]
        self._process: subprocess.Popen[str] | None = None

    def works(self) -> bool:
        """Try it: without the rights that it needs it fails."""
        try:
            self.begin(1)
            self.result()
        except RuntimeError:
            return False
        return True

    def begin(self, seconds: int) -> None:
        self._process = subprocess.Popen(
            [*self._words, f"--duration={seconds}"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def result(self) -> Distribution:
        """Latencies. Raises RuntimeError if it failed."""
        assert self._process is not None
        _, said = self._process.communicate()
        if self._process.returncode != 0 or not self._report.exists():
            raise RuntimeError(f"cyclictest failed: {said.strip()}")
        return histogram(json.loads(self._report.read_text()))

    def close(self) -> None:
        """End it, if something else went wrong."""
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            self._process.communicate()


Rival = Cyclictest | Sleeper


def histogram(report: dict[str, Any]) -> Distribution:
    """Latencies in the JSON of cyclictest, of all its threads."""
    found: Counter[int] = Counter()
    for thread in report["thread"].values():
        shown = {int(us): count for us, count in thread["histogram"].items()}
        found.update(shown)
        if (lost := int(thread["cycles"]) - sum(shown.values())) > 0:
            found[int(thread["max"])] += lost  # beyond the histogram there is only the largest one
    pairs = sorted(found.items())
    values = np.array([us for us, _ in pairs], dtype=np.float64)
    return Distribution(values, np.array([count for _, count in pairs]))
