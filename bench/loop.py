"""Punctuality of the loop and cost of a tick: the daemon's real loop, tick and doors on
python-can's virtual bus, in real time, with a control thread that only wakes up beside it.

    python -m bench.loop [--hz N] [--seconds S] [--load | --in-a-row] [--json]

Without --hz three runs: seven joints at 100 and at 250 Hz, one joint at 1 kHz; with it one run, of
seven joints up to 250 Hz and of one joint above. The drives are a recording of the simulated ones,
taken in lockstep just before: they answer each SYNC inside its sending, and their CPU time is left
out. "To setpoint" is the time from their last answer to the last setpoint of the tick.

--load puts two CPU hogs on every CPU. --in-a-row leaves the waiting out: what the same ticks cost
when the processor's caches are warm. The thread beside it is cyclictest (Debian's rt-tests), or
where that is missing a sleeping thread of ours; real-time priorities need root or a high
`ulimit -r`. At the end the resident memory of `contactd run`, and how much it grows.
"""

import click

from bench.options import command
from bench.report import print_report
from bench.study.loop_run import measure, resident
from bench.study.loop_targets import targets_of
from bench.study.loop_view import show, show_resident

RESIDENT_S = 30


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
        targets += targets_of(run, load=load)
        data[f"{each}_Hz"] = run.data()
        if not as_json:
            show(run)
    memory = {} if in_a_row else resident(min(seconds, RESIDENT_S))
    if memory and not as_json:
        show_resident(memory, min(seconds, RESIDENT_S))
    about = {"load": load, "in_a_row": in_a_row, "memory": memory}
    print_report("loop", 1, targets, {**about, **data}, as_json=as_json)


if __name__ == "__main__":
    main()
