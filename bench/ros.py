"""Cost of the door to ROS 2 for daemon and machine, and the age of what a subscriber hears.

    python -m bench.ros [--rounds N] [--seconds S] [--json]

Simulated arm, daemon, `contactd-zenoh`, a Zenoh router and two subscribers are processes of their
own, in real time; the arm holds. In each round the loop is watched alone, and then without the
bridge and with it, beside a router, a subscriber that reads and one that is stopped (SIGSTOP).
Ratios are of the same round; the one against the daemon alone is told, too. A State is lost where
the daemon published it, by a reader of ours at its socket, and no `joint_states` with its stamp
came. Figures in real time hold for an idle machine only.
"""

import os
import signal
import time
from dataclasses import dataclass, field

import click
import numpy as np

from bench.report import Target, print_report
from bench.rigs.bridge import bridge_of
from bench.rigs.lockstep import ROMEO
from bench.rigs.processes import Pair, pair
from bench.rigs.ros_listener import Arrival, listener_of
from bench.rigs.zenoh_router import free_port, router_of
from bench.study.beside import cpu_s, median_ratio, p99_us, peak_mb, watch
from daemon.clients.client import Client
from daemon.protocol.messages import State
from daemon.ros.messages import stamp

KEY = "0/contactd/joint_states/**"
ALL = "0/**"
SETTLE_S = 1.0


@dataclass(slots=True)
class Rounds:
    """Figures of all rounds."""

    alone: list[dict[str, float]] = field(default_factory=list)
    without: list[dict[str, float]] = field(default_factory=list)
    beside: list[dict[str, float]] = field(default_factory=list)
    lost: int = 0
    heard: int = 0
    cpu: list[float] = field(default_factory=list)  # share of a core
    memory_mb: float = 0.0
    delays_ms: list[float] = field(default_factory=list)  # from a tick to the subscriber

    def play(self, both: Pair, seconds: float, *, bridge_first: bool) -> None:
        """One round; which comes first alternates."""
        self.alone.append(p99_us(watch(both, seconds)))
        with (
            router_of(free_port()) as router,
            listener_of(router.endpoint, KEY) as reader,
            listener_of(router.endpoint, ALL) as stalled,
        ):
            stalled.process.send_signal(signal.SIGSTOP)
            time.sleep(SETTLE_S)
            if bridge_first:
                states = self._with(both, router.endpoint, seconds)
            self.without.append(p99_us(watch(both, seconds)))
            if not bridge_first:
                states = self._with(both, router.endpoint, seconds)
            self._compare(states, reader.arrivals())

    def _with(self, both: Pair, endpoint: str, seconds: float) -> list[State]:
        with bridge_of(both.door, endpoint) as bridge:
            time.sleep(SETTLE_S)
            before_s, begun_s = cpu_s(bridge.pid), time.monotonic()
            states = watch(both, seconds)
            passed_s = time.monotonic() - begun_s
            self.cpu.append((cpu_s(bridge.pid) - before_s) / passed_s)
            self.memory_mb = max(self.memory_mb, peak_mb(bridge.pid))
            time.sleep(SETTLE_S)  # what is on its way
        self.beside.append(p99_us(states))
        return states

    def _compare(self, states: list[State], arrivals: list[Arrival]) -> None:
        came = {(seconds, nanoseconds): at_s for seconds, nanoseconds, at_s in arrivals}
        for state in states:
            at_s = came.get(stamp(state.timing.wall_s))
            if at_s is None:
                self.lost += 1
            else:
                self.heard += 1
                self.delays_ms.append(1e3 * (at_s - state.timing.wall_s))


def targets_of(rounds: Rounds) -> list[Target]:
    """Figures and what they are held against."""
    delay = float(np.percentile(rounds.delays_ms, 99)) if rounds.delays_ms else float("nan")
    ratio = median_ratio(rounds.beside, rounds.without, "both")
    return [
        Target("bridge", 100 * float(np.median(rounds.cpu)), 4.0, "% of a core", "lower"),
        Target("memory of the bridge", rounds.memory_mb, 80.0, "MB", "lower"),
        Target("tick and doors at p99, with over without", ratio, 1.1, "", "lower"),
        Target("states lost beside one that stalls", rounds.lost, 0, "", "lower"),
        Target("from a tick to a subscriber, p99", delay, 5.0, "ms", "lower"),
    ]


@click.command()
@click.option("--rounds", "count", default=10, show_default=True, type=click.IntRange(1, 100))
@click.option("--seconds", default=4.0, show_default=True, type=click.FloatRange(1, 60))
@click.option("--json", "as_json", is_flag=True, help="Everything as one line of JSON.")
def main(count: int, seconds: float, as_json: bool) -> None:
    """Measure; exit status 1 where a target is missed."""
    rounds = Rounds()
    with pair(ROMEO) as both:
        client, _, _ = both.subscribed()
        client.close()
        with Client(both.door) as person:
            person.demand("enable")
        for number in range(count):
            rounds.play(both, seconds, bridge_first=number % 2 == 1)
    targets = targets_of(rounds)
    data = {
        "rounds": count,
        "with_over_alone": median_ratio(rounds.beside, rounds.alone, "both"),
        "alone_p99_us": rounds.alone,
        "without_p99_us": rounds.without,
        "beside_p99_us": rounds.beside,
        "states_heard": rounds.heard,
        "delay_p50_ms": float(np.median(rounds.delays_ms)) if rounds.delays_ms else None,
        "load_average": os.getloadavg()[0],
    }
    print_report("ros", 0, targets, data, as_json=as_json)
    raise SystemExit(0 if all(target.met for target in targets) else 1)


if __name__ == "__main__":
    main()
