"""Histograms of `bench.loop` in a terminal."""

from collections.abc import Mapping

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.study.loop_run import Run
from bench.study.wakeups import Distribution

EDGES_US = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, np.inf)
BAR_WIDTH = 6


def show(run: Run) -> None:
    """Wake-up lateness beside the rival's, what the ticks took, and the same over before."""
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
    console.print(_histogram(columns))
    if run.waited:
        console.print(f"deadlines missed: {run.missed}; by {run.rival}: {run.rivals_missed:g}")
    if run.repeated:
        console.print(f"turns repeated, as the machine stalled and the arm stopped: {run.repeated}")
    for name, ratio in run.to_before.items():
        console.print(f"  {name}: {ratio}")


def show_resident(memory: Mapping[str, Mapping[str, float]], seconds: float) -> None:
    """Memory of `contactd run`, by side."""
    for side, of in memory.items():
        resident, anonymous = of["resident_kB"] / 1024, of["anonymous_kB"] / 1024
        print(
            f"run, {side}: {resident:.0f} MB resident, of it {anonymous:.0f} MB anonymous; "
            f"grown in {seconds:g} s of serving by {of['resident_kB grown']:.0f} and "
            f"{of['anonymous_kB grown']:.0f} kB"
        )


def _histogram(columns: dict[str, Distribution]) -> Table:
    """One row per range; bars by the logarithm of the count, so that the tail is seen."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("us", justify="right", no_wrap=True)
    for name in columns:
        table.add_column(name, no_wrap=True, min_width=BAR_WIDTH + 6)
    low = 0.0
    counts = {}
    for high in EDGES_US:
        for name, d in columns.items():
            counts[name, high] = int(d.counts[(d.values >= low) & (d.values < high)].sum())
        low = high
    used = [high for high in EDGES_US if any(counts[name, high] for name in columns)]
    shown = [high for high in EDGES_US if used[0] <= high <= used[-1]]
    for high in shown:
        label = f"< {high:g}" if np.isfinite(high) else "more"
        table.add_row(label, *(_bar(counts[name, high], columns[name]) for name in columns))
    for percent, label in ((50, "median"), (99, "99 %"), (99.9, "99.9 %"), (100, "worst")):
        table.add_row(label, *(f"{d.at(percent):.0f}" for d in columns.values()))
    return table


def _bar(count: int, of: Distribution) -> Text:
    if not count:
        return Text()
    width = np.log1p(count) / np.log1p(of.counts.sum()) * BAR_WIDTH
    return Text("#" * max(round(width), 1), "cyan").append(f" {count}", "dim")
