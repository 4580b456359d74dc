"""Cost of rude clients for the loop, and whether `disarm` still comes through: clients that flood,
babble, cut messages off, never read, or connect a thousand times.

    python -m bench.flood [--seconds S] [--json]

Daemon, simulated arm and attackers are processes of their own, in real time. For each attack the
loop is watched without it and with it, one after the other, in the same run: lateness of the
wake-up, time of the tick, and time of the doors (clients and log) after it. Meanwhile a person
connects anew, again and again, and disarms. A last phase has the attackers as busy as in the
attacks, but with each other instead of the daemon: what the machine itself takes away.
"""

import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np

from bench.options import help_of
from bench.report import Target, print_report
from bench.rigs.besieged_person import EFFECT_TICKS, Stops, besieged_person
from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.processes import pair
from bench.rigs.rude_clients import ATTACKS, BESIDE, attacking
from daemon.clients.client import Client
from daemon.protocol.messages import State, Timing
from errors import ContactdError

PERIOD_US = 10_000.0
PERSON_EVERY_S = 0.1


@dataclass(slots=True)
class Phase:
    """Measurements of one phase."""

    name: str
    timings: list[Timing] = field(default_factory=list)
    disarms_ms: list[float] = field(default_factory=list)
    unserved: int = 0  # disarms that came to nothing

    def figures(self) -> dict[str, Any]:
        """Percentiles [us] and counts."""
        rows: dict[str, Any] = {
            what: {f"p{p}": round(float(np.percentile(values, p)), 1) for p in (50, 99, 100)}
            for what, values in self._columns().items()
        }
        missed = self.timings[-1].missed - self.timings[0].missed
        return {
            **rows,
            "ticks": len(self.timings),
            "missed": missed,
            "disarms": len(self.disarms_ms),
            "unserved": self.unserved,
            "disarm_ms": {
                "p50": round(float(np.median(self.disarms_ms)), 1) if self.disarms_ms else None,
                "max": round(max(self.disarms_ms), 1) if self.disarms_ms else None,
            },
        }

    def _columns(self) -> dict[str, list[float]]:
        return {
            "lateness_us": [t.lateness_us for t in self.timings],
            "tick_us": [t.work_us for t in self.timings],
            "doors_us": [t.doors_us for t in self.timings],
        }


def person(path: Path, phase: Phase, over: threading.Event) -> None:
    """Connects anew each time, as a command line does, and disarms."""
    while not over.wait(PERSON_EVERY_S):
        began = time.perf_counter()
        try:
            with Client(path) as client:
                done = client.request("disarm").ok
        except ContactdError:
            done = False
        if done:
            phase.disarms_ms.append(1e3 * (time.perf_counter() - began))
        else:
            phase.unserved += 1


def watch(path: Path, states: Iterator[State], name: str | None, seconds: float) -> Phase:
    """Take every State of the next `seconds` of the loop's time while `name` attacks."""
    phase = Phase(name or "quiet")
    over = threading.Event()
    somebody = threading.Thread(target=person, args=(path, phase, over))
    with attacking(name, path):
        first = next(states)
        while (state := next(states)).time_s < first.time_s + 0.3:
            pass  # until the attack is under way
        somebody.start()
        while (state := next(states)).time_s < first.time_s + 0.3 + seconds:
            phase.timings.append(state.timing)
    over.set()
    somebody.join()
    return phase


def phases(seconds: float) -> list[Phase]:
    """Quiet before each attack; at the end the busy neighbours."""
    made = []
    with pair(SINGLE_JOINT) as both:
        client, _, states = both.subscribed()
        with client:
            for name in [*ATTACKS, *BESIDE]:
                made += [watch(both.door, states, kind, seconds) for kind in (None, name)]
    return made


def stops(seconds: float) -> dict[str, Stops]:
    """Ticks from a person's stop to its effect, quiet and besieged."""
    with pair(SINGLE_JOINT) as both:
        client, _, states = both.subscribed()
        with client:
            return {
                name or "quiet": besieged_person(both.door, states, name, seconds)
                for name in (None, "siege")
            }


def _merged(some: list[Phase], name: str) -> Phase:
    merged = Phase(name)
    for phase in some:
        merged.timings += phase.timings
        merged.disarms_ms += phase.disarms_ms
        merged.unserved += phase.unserved
    return merged


@click.command(help=help_of(__doc__))
@click.option("--seconds", default=4.0, show_default=True, help="Of each phase.")
@click.option("--json", "as_json", is_flag=True)
def main(seconds: float, as_json: bool) -> None:
    made = phases(seconds)
    quiet = _merged([p for p in made if p.name == "quiet"], "quiet")
    attacked = _merged([p for p in made if p.name in ATTACKS], "attacked")
    calm, busy = quiet.figures(), attacked.figures()
    by_name = {"quiet": calm} | {p.name: p.figures() for p in made if p.name != "quiet"}
    stopped = stops(2.5 * seconds)
    besieged = stopped["siege"]
    worst_median = max(by_name[name]["doors_us"]["p50"] for name in ATTACKS)
    missed = 1000.0 * sum(by_name[name]["missed"] for name in ATTACKS) / busy["ticks"]
    # What the service allows to those who enter, and with those whose turn it is.
    entering_us, at_most_us = 0.3 * PERIOD_US, 0.4 * PERIOD_US
    targets = [
        Target(
            "tick time, median, attacked over quiet",
            busy["tick_us"]["p50"] / calm["tick_us"]["p50"],
            1.5,
            "x",
            "lower",
        ),
        Target("doors, median of the worst attack", worst_median, entering_us, "us", "lower"),
        Target("doors, p99 attacked", busy["doors_us"]["p99"], at_most_us, "us", "lower"),
        Target("deadlines missed attacked, of 1000 ticks", missed, 1.0, "", "lower"),
        Target(
            "lateness, median, attacked less quiet",
            busy["lateness_us"]["p50"] - calm["lateness_us"]["p50"],
            0.1 * PERIOD_US,
            "us",
            "lower",
        ),
        Target("disarms that came to nothing", attacked.unserved, 0, "", "lower"),
        Target("slowest disarm attacked", busy["disarm_ms"]["max"] or np.inf, 1000, "ms", "lower"),
        Target("stop to effect, p99 besieged", besieged.p(99), EFFECT_TICKS, "ticks", "lower"),
        Target("stop to effect, most besieged", besieged.p(100), EFFECT_TICKS, "ticks", "lower"),
        Target("stops besieged", besieged.number, 3.0 * seconds, "", "higher"),
    ]
    if not as_json:
        click.echo(f"{os.cpu_count()} cores; us, median / p99 / max of {seconds:g} s a phase")
        for name, row in by_name.items():
            columns = "   ".join(
                f"{what} {row[f'{what}_us']['p50']:7.0f} {row[f'{what}_us']['p99']:7.0f} "
                f"{row[f'{what}_us']['p100']:7.0f}"
                for what in ("lateness", "tick", "doors")
            )
            click.echo(
                f"  {name:7} {columns}   missed {row['missed']:3}   disarm "
                f"{row['disarm_ms']['p50']} ms, {row['disarm_ms']['max']} ms at most, "
                f"{row['unserved']} not served"
            )
        for name, counted in stopped.items():
            click.echo(f"  {name:7} {counted}")
    data = {"phases": by_name, "stops": {name: s.figures() for name, s in stopped.items()}}
    print_report("flood", 0, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
