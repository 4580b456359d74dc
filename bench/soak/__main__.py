"""Soak test: an arm, a hand, faults and people, all at random, for hours: nothing grows or breaks.

    python -m bench.soak [--minutes N] [--hours H] [--jobs J] [--seed S] [--json]   (make soak)

Two parts, one after the other. In *lockstep*, H simulated hours: every random choice comes from the
seed, and a second run with it goes the same way. In *real time*, N minutes of `contactd simulate`
and `contactd run` as processes, as at a robot, with rude clients and a recorder beside. In both a
hand pushes, leads and holds the arm; faults come and go, and a person resets them; people and
programs arm, start, pause, stop, upload trajectories, change gains, let leases run out, hang up.

In every tick it is checked that no setpoint leads a joint out of its limits, that none is further
out than the hand can press its drive, and is led back; that nothing moves where some joint has not
sensed contact for more than five ticks in a row, that no quiet time runs meanwhile, and that what a
contact interrupted goes on only after a quiet time in which every joint sensed; that setpoints and
their steps are bounded, that nothing moves while it is latched, that after a fault every stop is
proved within 1 s or the arm silent, that no motor moves 300 ms after the proof, that no joint goes
further than `contactd check` prints unless a hand moves it, that one reset ends a fault whose cause
is gone, that it is not armed longer than the lease, that every change of mode is one of the table
and reported with its cause, that contacts are reported only in modes that detect them, and that it
comes back after each fault.
Memory, descriptors, helpers, theta's uncertainty, lateness and the time of a tick must not
grow: Theil-Sen's slope over the second half, 95 % sure, against a stated tolerance.

Writes bench/out/soak.json. Exit status 1 when a rule was broken, or when memory,
descriptors, helpers or (in 15 minutes or more) uncertainty grow; lateness and times are reported
only, for the machine may be to blame. 0 minutes, or 0 hours, leave that part out.
"""

import json
import sys
from pathlib import Path

import click

from bench.options import command
from bench.report import print_report
from bench.soak.real_time import run_real_time
from bench.soak.record import Progress
from bench.soak.report import failures, targets_of
from bench.soak.simulated import simulate_hours

OUT = Path("bench/out")


@command(__doc__)
@click.option("--minutes", type=click.FloatRange(0.0), default=20.0, help="Of real time.")
@click.option("--hours", type=click.FloatRange(0.0), default=3.0, help="Simulated.")
@click.option(
    "--jobs",
    type=click.IntRange(1, 64),
    default=1,
    help="Processes that share the simulated hours; on one CPU an hour takes some 20 minutes.",
)
@click.option("--seed", type=click.IntRange(0), default=1)
def main(minutes: float, hours: float, jobs: int, seed: int, as_json: bool) -> None:
    if not (minutes or hours):
        raise click.UsageError("neither minutes nor hours: nothing to do")
    for words, value, least in (("--minutes", minutes, 0.2), ("--hours", hours / jobs, 0.003)):
        if 0.0 < value < least:
            text = f"{value:g} is too short for a trend: at least {least:g}, or 0"
            raise click.BadParameter(text, param_hint=words)
    parts = simulate_hours(seed, hours, jobs) if hours else []
    if minutes:
        # Alone: how punctual it is would otherwise say what the lockstep part takes.
        parts.append(run_real_time(seed, 60.0 * minutes, Progress("real time")))
    data = {part.name: part.data() for part in parts}
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "soak.json").write_text(json.dumps({p.name: p.data() | p.sampled() for p in parts}))
    print_report("soak", seed, targets_of(parts), data, as_json=as_json)
    found = failures(parts)
    for line in found:
        click.echo(f"FAILED: {line}", err=True)
    if not as_json:
        click.echo(f"{OUT / 'soak.json'} written; {len(found)} failures")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
