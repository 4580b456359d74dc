"""Punctuality of the loop and cost of a tick: the daemon's real loop, tick and doors on
python-can's virtual bus, in real time, with a control thread that only wakes up beside it.

    python -m bench.loop [--hz N] [--seconds S] [--load | --in-a-row] [--json]

Without --hz three runs: seven joints at 100 and at 250 Hz, one joint at 1 kHz; with it one run, of
seven joints up to 250 Hz and of one joint above. The drives are a recording of the simulated ones,
taken in lockstep just before: they answer each SYNC inside its sending, and their CPU time is left
out. "To setpoint" is the time from their last answer to the last setpoint of the tick.

--load puts two CPU hogs on every CPU. --in-a-row leaves the waiting out: what the same ticks cost
when the processor's caches are warm. The thread beside it is cyclictest (Debian's rt-tests), left
out where it is missing; real-time priorities need root or a high `ulimit -r`. At the end the
resident memory of `contactd run`, and how much it grows.
"""

import click

from bench.options import command
from bench.report import Target, print_report
from bench.study.loop_run import Run, measure, resident
from daemon.modes.table import Mode

RESIDENT_S = 30


def targets_of(run: Run, *, load: bool) -> list[Target]:
    """Targets that hold at this rate, and what they are held against."""
    at = f"{run.joints} {'joint' if run.joints == 1 else 'joints'} at {run.hz} Hz: "
    period_us = 1e6 / run.hz
    targets = [
        # A loop that counted its periods from its own wake-ups would lose whole periods.
        Target(at + "drift over the run", run.drift_us, 0.1 * period_us, "us")
    ]
    if run.joints > 1:
        cpu = run.cpu_us.at(50) / 1e3
        targets.append(Target(at + "CPU time of a tick, median", cpu, 0.5, "ms"))
    tracking = float(run.mode == Mode.TRACKING)
    targets.append(Target(at + "tracking all the time", tracking, 1.0, "", "higher"))
    if run.rival_us is not None:
        targets += _of_wakeups(run, at, period_us)
    if run.hz == 250 and load:
        late = run.work_us.at(99)
        targets.append(Target(at + "tick, p99", late, 0.5 * period_us, "us"))
    if run.hz == 250 and load and run.rival_us is not None:
        name = f"deadlines missed, at most the {run.rival}'s"
        targets.append(Target(at + name, run.missed, run.rivals_missed))
    return targets


def _of_wakeups(run: Run, at: str, period_us: float) -> list[Target]:
    assert run.rival_us is not None
    ratio = run.lateness_us.at(50) / max(run.rival_us.at(50), 1.0)
    late, others = run.lateness_us.beyond(period_us), run.rivals_late
    name = f"wake-ups later than a period, at most the {run.rival}'s"
    return [
        Target(f"{at}median lateness over the {run.rival}'s", ratio, 2.0),
        Target(at + name, late, others),
    ]


@command(__doc__)
@click.option("--hz", type=click.IntRange(10, 1000), help="Ticks per second.  [100, 250, 1000]")
@click.option("--seconds", type=click.IntRange(2, 3600), default=60)
@click.option("--load", is_flag=True, help="With CPU hogs beside it.")
@click.option("--in-a-row", is_flag=True, help="Without waiting between ticks.")
def main(hz: int | None, seconds: int, load: bool, in_a_row: bool, as_json: bool) -> None:
    if load and in_a_row:
        raise click.UsageError("--load is for ticks that are waited for: not with --in-a-row")
    targets, data = [], {}
    for each in [hz] if hz else [100, 250, 1000]:
        if not as_json:
            how = ", with CPU hogs" if load else ", in a row" if in_a_row else ""
            click.echo(f"{each} Hz for {seconds} s{how} ...", err=True)
        run = measure(each, seconds, load=load, waits=not in_a_row)
        if run.waited and not run.rival:
            click.echo("no cyclictest beside it: missing (rt-tests), or without rights", err=True)
        targets += targets_of(run, load=load)
        data[f"{each}_Hz"] = run.data()
    memory = {} if in_a_row else resident(min(seconds, RESIDENT_S))
    about = {"load": load, "in_a_row": in_a_row, "memory": memory}
    print_report("loop", 1, targets, {**about, **data}, as_json=as_json)


if __name__ == "__main__":
    main()
