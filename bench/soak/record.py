"""Record of one part of a soak: samples over time, checks, and what was seen."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import click

from bench.soak.trend import Bound, Trend, trend

CASES_REPORTED = 5  # Cases of each broken rule that are described in words

# The kinds of touches and faults come back in some minutes; a shared machine has no such rhythm.
RHYTHM_S, NEVER = 900.0, float("inf")

BOUNDS = {
    "memory (anonymous)": Bound("kB", share=0.01, least=512.0),
    "resident memory": Bound("kB", share=0.02, least=1024.0),
    "file descriptors": Bound("", share=0.0, least=0.5),
    "threads and helpers": Bound("", share=0.0, least=0.5),
    "theta's uncertainty": Bound("mrad", share=0.5, least=0.5, binding_from_s=RHYTHM_S),
    "error of theta, side known": Bound("mrad", share=0.5, least=1.0, binding_from_s=RHYTHM_S),
    "CPU time, simulation included": Bound("us", share=0.25, least=500.0, binding_from_s=NEVER),
    "CPU time of a tick": Bound("us", share=0.25, least=50.0, binding_from_s=NEVER),
    "lateness, median": Bound("us", share=0.25, least=100.0, binding_from_s=NEVER),
    "lateness, 99 %": Bound("us", share=0.5, least=1000.0, binding_from_s=NEVER),
    "time of a tick": Bound("us", share=0.25, least=100.0, binding_from_s=NEVER),
    "time of the doors": Bound("us", share=0.25, least=100.0, binding_from_s=NEVER),
}


@dataclass(slots=True)
class Ledger:
    """Number of checks of each rule, and the cases in which it was broken."""

    checked: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    cases: list[str] = field(default_factory=list)
    refusal: str = ""  # The last refusal that a person got.

    def check(self, rule: str, holds: bool, time_s: float, words: str = "") -> None:
        """Note that `rule` was looked at."""
        self.checked[rule] += 1
        if not holds:
            self.broken[rule] += 1
            if self.broken[rule] <= CASES_REPORTED:
                self.cases.append(f"{time_s:.2f} s: {rule}: {words}")


@dataclass(slots=True)
class Part:
    """One run, in lockstep or in real time."""

    name: str
    seed: int
    seconds: float = 0.0
    took_s: float = 0.0
    warm_up_s: float = 0.0  # what is sampled before is no part of the trends
    times_s: list[float] = field(default_factory=list)
    samples: dict[str, list[float]] = field(default_factory=dict)
    ledger: Ledger = field(default_factory=Ledger)
    counts: Counter[str] = field(default_factory=Counter)

    def sample(self, time_s: float, figures: dict[str, float]) -> None:
        """Add a row; every row has the same figures."""
        self.times_s.append(time_s)
        for name, value in figures.items():
            self.samples.setdefault(name, []).append(value)

    def settled(self, name: str) -> tuple[list[float], list[float]]:
        """Times and values after the warm-up."""
        first = next((i for i, t in enumerate(self.times_s) if t >= self.warm_up_s), 0)
        return self.times_s[first:], self.samples[name][first:]

    def trends(self) -> list[Trend]:
        """Trends of everything that was sampled."""
        return [trend(name, BOUNDS[name], *self.settled(name)) for name in self.samples]

    def data(self) -> dict[str, Any]:
        """Everything but the samples, for JSON."""
        return {
            "seed": self.seed,
            "seconds": self.seconds,
            "took_s": round(self.took_s, 1),
            "checked": dict(self.ledger.checked),
            "broken": dict(self.ledger.broken),
            "cases": self.ledger.cases,
            "counts": dict(sorted(self.counts.items())),
            "trends": {each.name: each.data() for each in self.trends()},
        }

    def sampled(self) -> dict[str, Any]:
        """The samples, for JSON."""
        return {
            "times_s": [round(t, 2) for t in self.times_s],
            "samples": {
                name: [float(f"{value:.5g}") for value in values]
                for name, values in self.samples.items()
            },
        }


Report = Callable[[float], None]  # Takes the share of a run that is done, 0 to 1.


class Progress:
    """A line on stderr for every tenth that is done."""

    def __init__(self, name: str) -> None:
        self._name, self._shown = name, 0

    def __call__(self, share: float) -> None:
        """Write the line if another tenth is done."""
        if share >= (self._shown + 1) / 10:
            self._shown = int(10 * share + 1e-9)
            click.echo(f"{self._name}: {10 * self._shown} % done", err=True)
