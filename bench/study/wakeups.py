"""Wake-ups of control threads: histograms of their lateness, and a reference for the daemon's loop
that only wakes up: cyclictest of Debian's rt-tests."""

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.service.realtime import FIFO_PRIORITY

LONGEST_US: Final = 100_000  # of cyclictest's histogram


@dataclass(frozen=True, slots=True)
class Distribution:
    """Values in us with their counts, in ascending order."""

    values: NDArray[np.float64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, figures: Sequence[float] | NDArray[np.float64]) -> "Distribution":
        """Distribution of these values, rounded to a tenth of a microsecond; NaN are left out."""
        found = np.asarray(figures, dtype=np.float64)
        values, counts = np.unique(np.round(found[~np.isnan(found)], 1), return_counts=True)
        return cls(values, counts)

    def __add__(self, other: "Distribution") -> "Distribution":
        values, place = np.unique(np.append(self.values, other.values), return_inverse=True)
        counts = np.bincount(place, np.append(self.counts, other.counts), values.size)
        return Distribution(values, counts.astype(np.int64))

    def at(self, percent: float) -> float:
        """Smallest value that so many per cent do not exceed."""
        share = np.cumsum(self.counts) / max(self.counts.sum(), 1)
        return float(self.values[min(np.searchsorted(share, percent / 100.0), share.size - 1)])

    def beyond(self, limit: float) -> int:
        """Number of larger values."""
        return int(self.counts[self.values > limit].sum())

    def data(self) -> dict[str, float]:
        """Percentiles for JSON."""
        return {f"p{p:g}": round(self.at(p), 1) for p in (50, 90, 99, 99.9, 100)}


@contextlib.contextmanager
def a_rival(hz: int) -> Iterator["Cyclictest | None"]:
    """cyclictest, which wakes up as often as the loop, for each turn; None if it is not installed
    or lacks its privileges."""
    with tempfile.TemporaryDirectory(prefix="cyclictest-") as folder:
        program = shutil.which("cyclictest")
        if program is None:
            yield None
            return
        with contextlib.closing(Cyclictest(program, hz, Path(folder) / "json")) as cyclictest:
            yield cyclictest if cyclictest.works() else None


class Cyclictest:
    """cyclictest at the loop's interval and priority, with a thread on each CPU: a virtual machine
    loses one of them at a time."""

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
        """True if a trial run succeeds: it fails without the necessary privileges."""
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
        """Distribution of latencies. Raises RuntimeError if the run failed."""
        assert self._process is not None
        _, said = self._process.communicate()
        if self._process.returncode != 0 or not self._report.exists():
            raise RuntimeError(f"cyclictest failed: {said.strip()}")
        return histogram(json.loads(self._report.read_text()))

    def close(self) -> None:
        """Terminate it, if something else failed."""
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            self._process.communicate()


def histogram(report: dict[str, Any]) -> Distribution:
    """Distribution of latencies from cyclictest's JSON, of all its threads."""
    found: Counter[int] = Counter()
    for thread in report["thread"].values():
        shown = {int(us): count for us, count in thread["histogram"].items()}
        found.update(shown)
        if (lost := int(thread["cycles"]) - sum(shown.values())) > 0:
            found[int(thread["max"])] += lost  # beyond the histogram only the largest is known
    pairs = sorted(found.items())
    values = np.array([us for us, _ in pairs], dtype=np.float64)
    return Distribution(values, np.array([count for _, count in pairs]))
