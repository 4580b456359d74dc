"""Figures of `bench.loop` in a terminal."""

from collections.abc import Mapping

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.study.loop_run import Run
from bench.study.wakeups import Distribution


def show(run: Run) -> None:
    """Wake-up lateness beside the rival's, and what the ticks took."""
    console = Console(highlight=False)
    ticks = int(run.lateness_us.counts.sum())
    joints = f"{run.joints} {'joint' if run.joints == 1 else 'joints'}"
    console.print(
        f"\n[bold]{joints} at {run.hz} Hz[/], {ticks} ticks, {run.missed} deadlines missed"
    )
    console.print(Text(", ".join(run.realtime), "dim"))
    columns = {"CPU of tick": run.cpu_us}
    if run.waited:
        beside = {} if run.rival_us is None else {run.rival: run.rival_us}
        columns = {"woken late": run.lateness_us, **beside, **columns}
        columns["last frame"] = run.work_us
    columns["to setpoint"] = run.setpoint_us
    console.print(_percentiles(columns))
    if run.waited:
        console.print(f"deadlines missed: {run.missed}; by {run.rival}: {run.rivals_missed:g}")
    if run.repeated:
        console.print(f"turns repeated, as the machine stalled and the arm stopped: {run.repeated}")


def show_resident(memory: Mapping[str, float], seconds: float) -> None:
    """Memory of `contactd run`."""
    resident, anonymous = memory["resident_kB"] / 1024, memory["anonymous_kB"] / 1024
    print(
        f"run: {resident:.0f} MB resident, of it {anonymous:.0f} MB anonymous; grown in "
        f"{seconds:g} s of serving by {memory['resident_kB grown']:.0f} and "
        f"{memory['anonymous_kB grown']:.0f} kB"
    )


def _percentiles(columns: dict[str, Distribution]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for name in ("us", *columns):
        table.add_column(name, justify="right", no_wrap=True)
    for percent, label in ((50, "median"), (99, "99 %"), (99.9, "99.9 %"), (100, "worst")):
        table.add_row(label, *(f"{d.at(percent):.0f}" for d in columns.values()))
    return table
