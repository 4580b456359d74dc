"""Many arms at one Zenoh router: what each costs, how old what it says is, and a router that dies.

    python -m bench.fleet [--arms N] [--seconds S] [--json]

The arms replay a second of States of a simulated one, 100 a second each, in processes of a few arms
(their share of a core is that of `contactd-zenoh` without its socket); the router is a process of
its own. After S seconds it is killed, for S seconds; then there is another at the same port. Arms
go on: the longest time between two of their rounds is of all this. What they say without a router
is not kept: their processes' memory is looked at before and after. One arm's joint states and the
diagnostics of all are heard; what nobody hears is not sent. Figures in real time hold for an idle
machine only.
"""

import contextlib
import math
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import click
import numpy as np

from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO, lockstep_rig
from bench.rigs.replayed_arms import Played, arms_of, played, write
from bench.rigs.ros_listener import Arrival, listener_of
from bench.rigs.zenoh_router import free_port, router_of, session_at
from bench.study.beside import resident_mb
from daemon.ros.names import Distro
from daemon.ros.supervisor import Supervisor
from daemon.service.status import snapshot_of
from daemon.tick.tick import Tick

ARMS_A_PROCESS = 5
SETTLE_S = 2.0
PATIENCE_S = 60.0


def record(file: Path) -> None:
    """A second of the Romeo arm, off."""
    with lockstep_rig(ROMEO) as rig:
        tick: Tick = rig.tick
        rig.run(0.1)
        snapshot = snapshot_of(rig.robot, tick)
        states = []
        for _ in range(100):
            rig.step()
            states.append(rig.state())
    write(file, snapshot, states)


def waited_s(true: Callable[[], bool]) -> float:
    """Time until it is so [s]; NaN where that never comes."""
    begun_s = time.monotonic()
    while not true():
        if time.monotonic() - begun_s > PATIENCE_S:
            return float("nan")
        time.sleep(0.02)
    return time.monotonic() - begun_s


def ages_ms(arrivals: list[Arrival]) -> list[float]:
    """Age of each message when it came [ms]."""
    return [1e3 * (at_s - seconds - 1e-9 * nanoseconds) for seconds, nanoseconds, at_s in arrivals]


@click.command()
@click.option("--arms", "count", default=50, show_default=True, type=click.IntRange(1, 250))
@click.option("--seconds", default=10.0, show_default=True, type=click.FloatRange(1, 60))
@click.option("--json", "as_json", is_flag=True, help="Everything as one line of JSON.")
def main(count: int, seconds: float, as_json: bool) -> None:
    """Measure; exit status 1 where a target is missed."""
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with contextlib.ExitStack() as opened:
        file = Path(opened.enter_context(tempfile.TemporaryDirectory())) / "states"
        record(file)
        router = opened.enter_context(router_of(port))
        parts = [
            opened.enter_context(arms_of(endpoint, i, min(ARMS_A_PROCESS, count - i), file))
            for i in range(0, count, ARMS_A_PROCESS)
        ]
        session = opened.enter_context(contextlib.closing(session_at(endpoint, "client")))
        supervisor = opened.enter_context(Supervisor(session, 0, Distro.JAZZY))

        def alive() -> int:
            """Arms that the table shows as alive; all others are gone, or silent since a while."""
            now_s = time.monotonic()
            return sum(arm.alive and arm.silent_s(now_s) is None for arm in supervisor.arms())

        found_s = waited_s(lambda: alive() == count)
        with listener_of(endpoint, "0/arm_0/joint_states/**") as listener:
            time.sleep(SETTLE_S + seconds)
            arrivals = listener.arrivals()
        before_mb = [resident_mb(part.pid) for part in parts]
        router.process.kill()
        gone_s = waited_s(lambda: alive() == 0)
        time.sleep(seconds)
        grown_mb = max(
            resident_mb(part.pid) - mb for part, mb in zip(parts, before_mb, strict=True)
        )
        opened.enter_context(router_of(port))
        back_s = waited_s(lambda: alive() == count)
        stopped = {} if math.isnan(back_s) else supervisor.stop_all()
        took = [played(part) for part in parts]
    waits_s = (found_s, gone_s, back_s)
    report(count, took, ages_ms(arrivals), waits_s, stopped, grown_mb, as_json=as_json)


def report(
    count: int,
    took: list[Played],
    ages: list[float],
    waits_s: tuple[float, float, float],
    stopped: Mapping[str, tuple[str, str]],
    grown_mb: float,
    *,
    as_json: bool,
) -> None:
    """Print what was measured, and end with the exit status."""
    stand = sum(outcome == "stands" for outcome, _ in stopped.values())
    targets = [
        Target("arms that stand after the router's return", stand, count, "", "higher"),
        Target("memory that a process of arms kept without a router", grown_mb, 5.0, "MB", "lower"),
        Target("until all arms are silent", waits_s[1], 2.0, "s", "lower"),
        Target("until all arms are back", waits_s[2], 10.0, "s", "lower"),
    ]
    p50, p99 = np.percentile(ages, [50, 99]) if ages else (float("nan"), float("nan"))
    cpu = [one.cpu_s / one.elapsed_s / one.arms for one in took]
    data = {
        "arms": count,
        "cpu_per_arm_percent": 100 * float(np.mean(cpu)),
        "age_p50_ms": float(p50),
        "age_p99_ms": float(p99),
        "messages_heard": len(ages),
        "longest_gap_s": max(one.longest_gap_s for one in took),
        "peak_mb_of_a_process": max(one.peak_mb for one in took),
        "until_found_s": waits_s[0],
        "load_average": os.getloadavg()[0],
    }
    if not as_json:
        for name, value in data.items():
            click.echo(f"  {name}: {value:.4g}")
    print_report("fleet", 0, targets, data, as_json=as_json)
    raise SystemExit(0 if all(target.met for target in targets) else 1)


if __name__ == "__main__":
    main()
