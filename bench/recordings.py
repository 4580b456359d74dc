"""Speed of working on recordings: replay, what-ifs and plots.

    python -m bench.recordings [--minutes N] [--rounds N] [--seed N] [--no-long] [--json]

Both shipped arms are recorded in lockstep, so many minutes of robot time each: set in motion,
pushed every six seconds; then replayed. Times are CPU times.

Then 200 levels of one joint of the Romeo arm are asked for, with an empty cache and from it, and a
page. Without --no-long it puts twelve of that recording together, to see how much more memory a
recording of twelve times the length takes.
"""

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import click

from bench.options import SEED, command
from bench.report import Target, print_report
from bench.rigs.lockstep import DESK_ARM, ROMEO
from bench.rigs.recorded_arm import made
from bench.study.recording_answers import growth_mb, messages_of, times, write
from programs.clients.replay import replay

PERIOD_S: Final = 0.01
JOINT: Final = "LElbowYaw"
LONGER: Final = 12  # times, to see what memory does


def replayed_us(path: Path) -> float:
    """CPU time of a replay per State [us]. Raises AssertionError if it differs."""
    begun = time.process_time()
    result = replay(path)
    took_s = time.process_time() - begun
    assert result.identical, result
    assert not result.broken, result
    return 1e6 * took_s / result.states


def answers_of(
    path: Path, replay_us: float, folder: Path, rounds: int, long: bool
) -> tuple[dict[str, Any], list[Target]]:
    """Figures of the answers from one recording, and their targets."""
    real_time = 1e6 * PERIOD_S / replay_us
    found = [times(path, JOINT, folder) for _ in range(max(rounds // 2, 1))]
    middle = {name: statistics.median(one[name] for one in found) for name in found[0]}
    data: dict[str, Any] = {"real_time": round(real_time, 1)} | middle
    targets = [
        Target("replay, times real time", real_time, 150, "x", "higher"),
        Target("200 levels from the cache", middle["cached_s"], 0.3, "s"),
        Target("plot as a page", middle["plot_s"], 5.0, "s"),
        Target("page", middle["page_mb"], 5.0, "MB"),
    ]
    if long:
        snapshot, states = messages_of(path)
        longer = folder / "long.mcap"
        write(longer, [(snapshot, states)] * LONGER)
        data["growth_mb"] = growth_mb(path, longer, JOINT, folder)
        worst = max(data["growth_mb"].values())
        targets.append(Target(f"memory of {LONGER} times the length", worst, 50, "MB"))
    return data, targets


@command(__doc__)
@click.option("--minutes", type=click.FloatRange(0.02, 60.0), default=10.0, help="Of each arm.")
@click.option("--rounds", type=click.IntRange(min=1), default=6, help="Replays of each.")
@SEED
@click.option("--long/--no-long", default=True, help="Memory, too.")
def main(minutes: float, rounds: int, seed: int, long: bool, as_json: bool) -> None:
    data: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="recordings-") as folder:
        for arm in (DESK_ARM, ROMEO):
            path = made(Path(folder) / f"{arm.name}.mcap", arm, 60.0 * minutes, seed)
            data[arm.name] = statistics.median(replayed_us(path) for _ in range(rounds))
        answers, targets = answers_of(path, data[ROMEO.name], Path(folder), rounds, long)
    measured = {"minutes": minutes, "rounds": rounds, "replay_us": data, "answers": answers}
    print_report("recordings", seed, targets, measured, as_json=as_json)


if __name__ == "__main__":
    main()
