"""Speed of working on recordings: replay beside the code before, in turns; what-ifs and plots.

    python -m bench.recordings [--minutes N] [--rounds N] [--seed N] [--no-many] [--json]

Both codes record both shipped arms in lockstep, so many minutes of robot time each: set in motion,
pushed every six seconds. Then each replays its own in turns with the other; the code before is that
of the last commit before the estimator's compiled kernel. Times are CPU times. To decode is to read
the file and to make arrays of it, to step is the estimator alone, the rest is comparison.

Then today's code is asked for 200 levels of one joint of the Romeo arm, with an empty cache and
from it, and for a page. With --no-many it ends there; otherwise it cuts 100 files of a minute out
of that recording for one and two workers in turns, and puts twelve together, to see how much more
memory a recording of twelve times the length takes.
"""

import statistics
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import click

from bench.options import SEED, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import DESK_ARM, ROMEO
from bench.study.before import code_before
from bench.study.pairs import Ratio, Sides, Worker, in_turns, named, ratio, sides
from bench.study.recording_answers import (
    cut,
    growth_mb,
    messages_of,
    times,
    worker_speed,
    write,
)

ARMS: Final = (ROMEO.name, DESK_ARM.name)
PARTS: Final = ("replay", "decode", "step")
JOINT: Final = "LElbowYaw"
LONGER: Final = 12  # times, to see what memory does


@dataclass(frozen=True, slots=True)
class Shares:
    """CPU time of a replay and its parts [us per state]."""

    replay: float
    decode: float
    step: float
    compare: float
    """all that is neither decoding nor a step; noise may make it less than nothing"""

    @classmethod
    def of(cls, rounds: Sequence[Mapping[str, float]]) -> "Shares":
        """Medians over the rounds, in each of which all PARTS were measured."""
        rest = [r["replay"] - r["decode"] - r["step"] for r in rounds]
        middle = {part: statistics.median(r[part] for r in rounds) for part in PARTS}
        return cls(**middle, compare=statistics.median(rest))

    @property
    def states_per_s(self) -> float:
        """Speed of a replay."""
        return 1e6 / self.replay

    def data(self) -> dict[str, float]:
        """Figures for JSON."""
        parts = {f"{name}_us": round(us, 2) for name, us in asdict(self).items()}
        return {**parts, "states_per_s": round(self.states_per_s)}

    def __str__(self) -> str:
        return (
            f"{self.states_per_s:7.0f} states/s, {self.replay:6.1f} us: decode {self.decode:.1f}, "
            f"step {self.step:.1f}, compare {self.compare:.1f}"
        )


def measure(found: Sides, arm: str, rounds: int) -> tuple[Shares, Shares | None, Ratio | None]:
    """Shares today and before, and how many times faster a replay is."""

    def parts(worker: Worker) -> dict[str, float]:
        answers = {part: worker.ask(arm=arm, part=part) for part in PARTS}
        return {part: 1e6 * answer["cpu_s"] / answer["states"] for part, answer in answers.items()}

    today, before = in_turns(found, rounds, parts)
    if not before:
        return Shares.of(today), None, None
    pairs = [(then["replay"], now["replay"]) for now, then in zip(today, before, strict=True)]
    return Shares.of(today), Shares.of(before), ratio(pairs)


def answers_of(
    path: Path, replayed: Mapping[str, Any], folder: Path, rounds: int, many: bool
) -> tuple[dict[str, Any], list[Target]]:
    """Figures of the answers from one recording, and their targets."""
    period_s = 0.01
    real_time = replayed["today"]["states_per_s"] * period_s
    found = [times(path, JOINT, folder) for _ in range(max(rounds // 2, 1))]
    middle = {
        name: statistics.median(getattr(one, name) for one in found)
        for name in ("whatif_cpu_s", "cached_s", "plot_s", "page_mb")
    }
    data: dict[str, Any] = {"real_time": round(real_time, 1)} | middle
    targets = [
        Target("replay, times real time", real_time, 150, "x", "higher"),
        Target("200 levels from the cache", middle["cached_s"], 0.3, "s", "lower"),
        Target("plot as a page", middle["plot_s"], 5.0, "s", "lower"),
        Target("page", middle["page_mb"], 5.0, "MB", "lower"),
    ]
    if "before" in replayed:
        snapshot, states = messages_of(path)
        before_s = 1e-6 * replayed["before"]["replay_us"] * len(states)
        share = middle["whatif_cpu_s"] / before_s
        targets.append(Target("200 levels over replay before", share, 0.2, "", "lower"))
    if many:
        snapshot, states = messages_of(path)
        long = folder / "long.mcap"
        write(long, [(snapshot, states)] * LONGER)
        data["growth_mb"] = growth_mb(path, long, JOINT, folder)
        worst = max(data["growth_mb"].values())
        targets.append(Target(f"memory of {LONGER} times the length", worst, 50, "MB", "lower"))
        long.unlink()
        cuts = folder / "cuts"
        cuts.mkdir()
        cut(path, cuts)
        data["two_workers"] = worker_speed(cuts, JOINT, folder, max(rounds // 2, 1))
        speed = statistics.median(data["two_workers"])
        targets.append(Target("100 files, two workers over one", speed, 1.6, "x", "higher"))
    return data, targets


@click.command(help=help_of(__doc__))
@click.option(
    "--minutes",
    type=click.FloatRange(0.02, 60.0),
    default=10.0,
    show_default=True,
    help="Of each arm.",
)
@click.option(
    "--rounds",
    type=click.IntRange(min=1),
    default=6,
    show_default=True,
    help="Replays of each, by each side.",
)
@SEED
@click.option("--many/--no-many", default=True, help="Files and workers, and memory, too.")
@click.option("--json", "as_json", is_flag=True)
def main(minutes: float, rounds: int, seed: int, many: bool, as_json: bool) -> None:
    targets: list[Target] = []
    data: dict[str, Any] = {}

    def say(text: str) -> None:
        if not as_json:
            click.echo(text)

    with code_before() as before, tempfile.TemporaryDirectory(prefix="recordings-") as folder:
        say(named(before))

        def options(side: str) -> dict[str, Any]:
            own = Path(folder) / side
            own.mkdir()
            return {"folder": str(own), "seconds": 60.0 * minutes, "seed": seed}

        with sides("replay", before, options) as found:
            for arm in ARMS:
                today, then, faster = measure(found, arm, rounds)
                say(f"replay, {arm}\n  today  {today}")
                data[arm] = {"today": today.data()}
                if then is not None and faster is not None:
                    say(f"  before {then}\n  speed: {faster}")
                    data[arm] |= {"before": then.data(), "faster": faster.data()}
                    name = f"replay speed over before's, {arm}"
                    targets.append(Target(name, faster.median, 4, "x", "higher"))
            made = Path(folder) / "today" / f"{ROMEO.name}.mcap"
            told_more, more = answers_of(made, data[ROMEO.name], Path(folder), rounds, many)
            targets += more
    told = {
        "before": named(before),
        "minutes": minutes,
        "rounds": rounds,
        "replay": data,
        "answers": told_more,
    }
    print_report("recordings", seed, targets, told, as_json=as_json)


if __name__ == "__main__":
    main()
