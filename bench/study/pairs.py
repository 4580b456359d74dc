"""Measurements in pairs: today's code and the code before, in turns in one run.

A machine that others use is now fast, now slow. Two figures taken one after the other have met much
the same machine, so their ratio is worth more than the ratio of two long runs; the median of many
such ratios has bounds that need no assumption about their distribution.
"""

import contextlib
import json
import math
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from bench.study.before import BEFORE, ROOT

RUNNER: Final = ROOT / "bench" / "workers" / "runner.py"
CONFIDENCE: Final = 0.95
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Ratio:
    """Ratios of pairs: their median with the bounds of a confidence interval, and percentiles."""

    median: float
    low: float
    """the true median is at least this, with `high` in 95 % of all runs"""
    high: float
    p10: float
    p90: float
    pairs: int

    def __str__(self) -> str:
        return (
            f"{self.median:.3g} of before ({self.low:.3g} to {self.high:.3g}, {self.pairs} pairs)"
        )

    def data(self) -> dict[str, float]:
        """Figures for JSON."""
        names = ("median", "low", "high", "p10", "p90", "pairs")
        return {name: round(getattr(self, name), 4) for name in names}


def ratio(pairs: Sequence[tuple[float, float]]) -> Ratio:
    """Ratios of the first to the second of each pair. Raises ValueError without any."""
    ratios = sorted(today / before for today, before in pairs)
    if not ratios:
        raise ValueError("no pairs: nothing to compare")
    lowest = _rank(len(ratios))
    return Ratio(
        median=statistics.median(ratios),
        low=ratios[lowest],
        high=ratios[-1 - lowest],
        p10=_percentile(ratios, 0.1),
        p90=_percentile(ratios, 0.9),
        pairs=len(ratios),
    )


def _rank(n: int) -> int:
    """Index of the lower bound of the median among `n` sorted values: the largest for which both
    tails of the sign test together stay within 5 %, 0 where even the extremes are not enough."""
    tail, rank = 0.0, 0
    for k in range(n // 2):
        tail += math.comb(n, k) / 2.0**n
        if 2.0 * tail > 1.0 - CONFIDENCE:
            break
        rank = k
    return rank


def _percentile(ordered: Sequence[float], share: float) -> float:
    """The smallest value that this share does not exceed."""
    return ordered[max(math.ceil(share * len(ordered)) - 1, 0)]


class Worker:
    """A process of `bench.workers.runner` on the code in a folder."""

    def __init__(self, name: str, code: Path, options: Mapping[str, Any]) -> None:
        self._name, self._options = f"worker {name} on {code}", options
        self._start = partial(_started, name, code)
        self._process = self._start()
        self.send(options)

    def begin_anew(self) -> None:
        """Put a new process in its place, that is ready."""
        self.close()
        self._process = self._start()
        self.ask(**self._options)

    def send(self, request: Mapping[str, Any]) -> None:
        """Ask for something, whose answer `receive` waits for."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise RuntimeError(f"{self._name} has ended") from None

    def receive(self) -> dict[str, Any]:
        """The next answer. Raises RuntimeError if the process ends before it, having said why on
        stderr."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self._name} ended with status {self._process.wait()}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a request."""
        self.send(request)
        return self.receive()

    def close(self) -> None:
        """End it and wait, so that it can clean up; killed if it does not."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(60.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


def _started(name: str, code: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-P", str(RUNNER), name],
        cwd=code,
        env={**os.environ, "PYTHONPATH": str(code)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@dataclass(frozen=True, slots=True)
class Sides:
    """The same worker on both codes; no `before` where its commit is not there."""

    today: Worker
    before: Worker | None

    def both(self) -> list[Worker]:
        """Those that there are, today's first."""
        return [self.today] if self.before is None else [self.today, self.before]


@contextlib.contextmanager
def sides(
    name: str, before: Path | None, options: Callable[[str], Mapping[str, Any]]
) -> Iterator[Sides]:
    """Workers that are ready; `options` for "today" and for "before"."""
    with contextlib.ExitStack() as stack:

        def begun(side: str, code: Path) -> Worker:
            worker = Worker(name, code, options(side))
            stack.callback(worker.close)
            return worker

        today = begun("today", ROOT)
        found = Sides(today, None if before is None else begun("before", before))
        for worker in found.both():
            worker.receive()
        yield found


def in_turns(found: Sides, rounds: int, measure: Callable[[Worker], T]) -> tuple[list[T], list[T]]:
    """Measurements of today and of before, a pair per round, each round beginning with the other
    side: whatever drifts hits both."""
    today: list[T] = []
    before: list[T] = []
    for number in range(rounds):
        workers = found.both()
        for worker in reversed(workers) if number % 2 else workers:
            (today if worker is found.today else before).append(measure(worker))
    return today, before


def named(before: Path | None) -> str:
    """What today's figures are held against, in one line."""
    return "before: missing" if before is None else f"before: {BEFORE[:12]}"
