"""Punctuality of the loop and cost of a tick: the daemon's real loop, tick and doors on
python-can's virtual bus, in real time, with cyclictest beside it at the same interval.

    python -m bench.loop [--hz N] [--seconds S] [--load | --in-a-row] [--json]

Without --hz two runs: seven joints at 100 Hz, one joint at 1 kHz; with it one run, of seven joints
up to 250 Hz and of one joint above. The drives are a recording of the simulated ones, taken in
lockstep just before: they answer each SYNC inside its sending, and their CPU time is left out.
--load puts two CPU hogs on every CPU. --in-a-row leaves the waiting out: what the same ticks cost
when the processor's caches are warm. cyclictest comes with Debian's rt-tests; it and real-time
priorities need root or a high `ulimit -r`.
"""
# ruff: noqa: PLC0415 - numpy may be loaded only after its threads are switched off

import click

from daemon.modes.table import Mode
from daemon.service.realtime import single_threaded


@click.command(help=__doc__)
@click.option("--hz", type=click.IntRange(10, 1000), help="Ticks per second.  [100, then 1000]")
@click.option("--seconds", type=click.IntRange(2, 3600), default=60, show_default=True)
@click.option("--load", is_flag=True, help="With CPU hogs beside it.")
@click.option("--in-a-row", is_flag=True, help="Without waiting between ticks.")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON on the last line.")
def main(hz: int | None, seconds: int, load: bool, in_a_row: bool, as_json: bool) -> None:
    if load and in_a_row:
        raise click.UsageError("--load is for ticks that are waited for: not with --in-a-row")
    single_threaded()
    from bench.report import Target, print_report
    from bench.study.loop_run import Run, measure
    from bench.study.loop_view import show

    def targets_of(run: Run) -> list[Target]:
        at = f"{run.joints} {'joint' if run.joints == 1 else 'joints'} at {run.hz} Hz: "
        targets = [
            # A loop that counted its periods from its own wake-ups would lose whole periods.
            Target(at + "drift over the run", run.drift_us, 0.1 * 1e6 / run.hz, "us", "lower"),
        ]
        if run.joints > 1:
            cpu = run.cpu_us.at(50) / 1e3
            targets.append(Target(at + "CPU time of a tick, median", cpu, 0.5, "ms", "lower"))
        stalled = run.cyclictest_us is not None and run.cyclictest_us.beyond(1e6 / run.hz) > 0
        # Where the machine stalls the arm stops, and a tick of a stopped arm is another.
        if not stalled:
            tracking = float(run.mode == Mode.TRACKING)
            targets.append(Target(at + "tracking at the end", tracking, 1.0, "", "higher"))
        if run.cyclictest_us is not None:
            ratio = run.lateness_us.at(50) / max(run.cyclictest_us.at(50), 1.0)
            name = "median lateness over cyclictest's"
            targets.append(Target(at + name, ratio, 2.0, "", "lower"))
            late = float(run.lateness_us.beyond(1e6 / run.hz))
            others = float(run.cyclictest_us.beyond(1e6 / run.hz))
            name = "wake-ups later than a period, at most cyclictest's"
            targets.append(Target(at + name, late, others, "", "lower"))
        return targets

    targets: list[Target] = []
    data = {}
    for each in [hz] if hz else [100, 1000]:
        if not as_json:
            how = ", with CPU hogs" if load else ", in a row" if in_a_row else ""
            click.echo(f"{each} Hz for {seconds} s{how} ...", err=True)
        run = measure(each, seconds, load=load, waits=not in_a_row)
        targets += targets_of(run)
        data[f"{each}_Hz"] = run.data()
        if not as_json:
            show(run)
    print_report("loop", 1, targets, {"load": load, "in_a_row": in_a_row, **data}, as_json=as_json)


if __name__ == "__main__":
    main()
