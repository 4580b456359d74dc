"""How soon an arm that is kept armed over Zenoh is not armed any more, once its caller is silent.

    python -m bench.silences [--rounds N] [--json]

Simulated arm, daemon, `contactd-zenoh --allow-arm`, a Zenoh router, a caller of `arm` (five calls a
second) and the network between the last two: each but the network is a process of its own. In each
round, for each way to fall silent, all but arm and daemon are begun, the way is gone, and the time
is from there to the first State that is not armed. Time on a busy machine is longer.
"""

import os
import time

import click

from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO
from bench.rigs.processes import Pair, pair
from bench.rigs.silences import SILENCES, Way, way_to
from daemon.clients.client import Client

LIMIT_S = 1.0
MOST_S = 10.0


def ended_after_s(both: Pair, way: Way, silence: str) -> float:
    """Time until it is not armed any more [s], MOST_S where it still is after that."""
    client, _, states = both.subscribed()
    with client:
        while not next(states).armed:
            pass
        begun_s = time.monotonic()
        SILENCES[silence](way)
        for state in states:
            since_s = state.timing.monotonic_s - begun_s
            if not state.armed or since_s > MOST_S:
                return since_s
    raise AssertionError("States never end")


@click.command()
@click.option("--rounds", "count", default=5, show_default=True, type=click.IntRange(1, 100))
@click.option("--json", "as_json", is_flag=True, help="Everything as one line of JSON.")
def main(count: int, as_json: bool) -> None:
    """Measure; exit status 1 where a target is missed."""
    found: dict[str, list[float]] = {silence: [] for silence in SILENCES}
    with pair(ROMEO) as both:
        client, _, _ = both.subscribed()
        client.close()
        with Client(both.door) as person:
            person.demand("enable")
        for _ in range(count):
            for silence, times in found.items():
                with way_to(both.door) as way:
                    times.append(ended_after_s(both, way, silence))
                    way.go_on()
    targets = [
        Target(silence, max(times), LIMIT_S, "s", "lower") for silence, times in found.items()
    ]
    data = {"rounds": count, "ended_after_s": found, "load_average": os.getloadavg()[0]}
    print_report("silences", 0, targets, data, as_json=as_json)
    raise SystemExit(0 if all(target.met for target in targets) else 1)


if __name__ == "__main__":
    main()
