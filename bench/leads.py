"""Ends of leads, in lockstep: a hand takes the arm from its trajectory to random poses and lets go;
what the arm does then is counted.

    python -m bench.leads [--leads N] [--seed N] [--json]

Each pose is drawn within the middle 90 % of every joint's range. The hand (1500 N/m at the last
link) leads all joints there at once, rests for half a second and lets go; the arm is to go on with
its trajectory, from there or a bounded way back into the path's range. It is armed anew before each
lead, so that no bound of an arming ends it.
"""

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import click
import msgspec
import numpy as np

from bench.options import SEED, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import Rig, lockstep_rig
from bench.study.leading import takes
from daemon.config.motion import limits_of
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode

SHARE = 0.9  # of each joint's range
SPEED_RAD_S = 0.4
RESTS_S = 0.5
# The quiet time, and the longest way back within the bounds of an arming.
LATEST_S = 30.0


@dataclass(frozen=True, slots=True)
class Lead:
    """One lead of the arm, and where it ended."""

    end: str  # mode
    cause: str
    after_s: float  # since the hand let go
    back: bool  # by a way back into the path's range


def measure(leads: int, seed: int) -> list[Lead]:
    """Every lead, in one run."""
    rng = np.random.default_rng(seed)
    with lockstep_rig(
        configure=far, simulate=lambda s: msgspec.structs.replace(s, seed=seed)
    ) as rig:
        limits = limits_of(rig.robot.configuration)
        middle, half = (limits.lower + limits.upper) / 2.0, (limits.upper - limits.lower) / 2.0
        rig.enable()
        return [
            one(rig, middle + half * rng.uniform(-SHARE, SHARE, half.size)) for _ in range(leads)
        ]


def far(c: Configuration) -> Configuration:
    """The arm with bounds that let it be led anywhere within its limits."""
    admittance = msgspec.structs.replace(c.admittance, max_excursion=100.0, max_duration_s=600.0)
    return msgspec.structs.replace(c, admittance=admittance)


def one(rig: Rig, pose: np.ndarray) -> Lead:
    """Lead the arm from its trajectory to a pose (n,) [rad], and wait for what it does then."""
    controller = rig.tick.controller
    if rig.mode is Mode.HOLDING:
        rig.request(Event.START)
    controller.disarm("the bench", rig.time_s)
    rig.run(2.0)
    if reasons := rig.permit("the bench"):
        raise click.ClickException("; ".join(reasons))
    names = rig.robot.configuration.joint_names
    takes(rig.arm, names, dict(enumerate(pose.tolist())), SPEED_RAD_S, RESTS_S)
    while not rig.arm.hand.done:
        rig.step()
    released, back = rig.time_s, False
    while rig.mode not in (Mode.TRACKING, Mode.HOLDING) and rig.time_s < released + LATEST_S:
        rig.step()
        back = back or rig.mode is Mode.RETURNING
    return Lead(rig.mode, controller.machine.cause, round(rig.time_s - released, 2), back)


def targets_of(found: list[Lead]) -> list[Target]:
    """None ends in holding."""
    held = sum(each.end != Mode.TRACKING for each in found)
    return [Target(f"of {len(found)} leads, not gone on with", held, 0, "", "lower")]


@click.command(help=help_of(__doc__))
@click.option("--leads", type=click.IntRange(min=1), default=41, show_default=True)
@SEED
@click.option("--json", "as_json", is_flag=True)
def main(leads: int, seed: int, as_json: bool) -> None:
    found = measure(leads, seed)
    data: dict[str, Any] = {"leads": [asdict(each) for each in found]}
    if not as_json:
        for end, count in Counter(each.end for each in found).most_common():
            ways = sum(each.back for each in found if each.end == end)
            click.echo(f"  {count} ended {end}, {ways} of them by a way back into the path's range")
        for each in found:
            if each.end != Mode.TRACKING:
                click.echo(f"    {each.cause}")
    print_report("leads", seed, targets_of(found), data, as_json=as_json)


if __name__ == "__main__":
    main()
