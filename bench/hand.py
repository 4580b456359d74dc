"""Torque and work of leading the arm by hand, in lockstep: a hand of 1500 N/m takes it from pose to
pose, against the same arm with its drives off, weightless, where only friction resists.

    python -m bench.hand [--speed RAD_S] [--gain K_A]... [--mass S] [--no-learning] [--no-even]
                         [--seed N] [--json]

The hand holds the last link; to each joint it is a spring of 1500 N/m and a damper of 20 N s/m at
its lever. First it leads each joint alone while the trajectory runs, lets go in full motion, and
waits until the trajectory goes on; then the whole arm through a round of poses, resting at each
before it lets go. The arm with its drives off is led the same ways from the same poses.
At last it leads the arm over ten poses, and at each every joint alone: the force at the hand that
each asks for, with these gains and with those of `contactctl gain --balance` (some minutes;
--no-even leaves it out).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import click
import msgspec
import numpy as np

from bench.options import SEED, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO, lockstep_rig
from bench.study.evenness import POSES, Evenness, balanced_of, evenness
from bench.study.leading import lead, lead_limp, stiffness, stroke
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from daemon.modes.table import Event

# The hand lets go of a single joint in full motion, of the whole arm when it has rested so long.
RESTS_S = 0.5
# A way shorter than this says nothing about forces or trembling [rad].
SHORT_RAD = 0.05
# Offsets from where the arm stands at first; the round ends where it began [rad].
ROUND = (
    (-0.4, 0.2, 0.4, -0.3, 0.4, 0.2, 0.3),
    (-0.7, 0.4, 0.0, 0.2, 0.0, -0.2, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


Tune = Callable[[Configuration], Configuration]


def measure(speed: float, tune: Tune, seed: int) -> dict[str, Any]:
    """Everything, in one run."""
    with lockstep_rig(
        configure=tune,
        simulate=lambda s: msgspec.structs.replace(s, seed=seed),
    ) as rig:
        c = rig.robot.configuration
        rig.enable()
        rig.request(Event.START)
        rig.run(2.0)
        if reasons := rig.permit("the bench"):
            raise click.ClickException("; ".join(reasons))
        origin = rig.arm.plant.q.copy()
        k, _ = stiffness(rig.arm)
        alone = [lead(rig, {i: stroke(c, rig.arm.plant.q, i)}, speed) for i in range(len(c.joints))]
        whole = [
            lead(rig, dict(enumerate(origin + np.array(pose))), speed, RESTS_S) for pose in ROUND
        ]
        gain = np.array([joint.admittance_gain for joint in c.joints])
        return {
            "speed_rad_s": speed,
            "gain": gain.tolist(),
            "stiffness_nm_rad": np.round(k, 1).tolist(),
            "gain_times_stiffness_1_s": np.round(gain * k, 1).tolist(),
            "alone": [asdict(row) for _, rows in alone for row in rows],
            "alone_off": [asdict(row) for way, _ in alone for row in lead_limp(rig, way, speed)],
            "whole": [[asdict(row) for row in rows] for _, rows in whole],
            "whole_off": [[asdict(row) for row in lead_limp(rig, way, speed)] for way, _ in whole],
        }


def how_even(speed: float, tune: Tune, seed: int) -> dict[str, Evenness]:
    """Forces at the hand with these gains, and with balanced ones."""
    robot = load_robot(ROMEO)
    c = tune(robot.configuration)
    return {
        "today": evenness(c, speed, seed),
        "balanced": evenness(balanced_of(c, robot.urdf), speed, seed),
    }


def even_data(found: Mapping[str, Evenness]) -> dict[str, Any]:
    """The forces for JSON."""
    return {
        when: {
            "led_N": np.round(each.led, 1).tolist(),
            "peak_N": np.round(each.peak, 1).tolist(),
            "ratio": round(each.ratio, 2),
            "ratio_at_a_pose": round(each.ratio_at_a_pose, 2),
        }
        for when, each in found.items()
    }


def print_even(names: Sequence[str], found: Mapping[str, Evenness]) -> None:
    """Forces at the hand, a line for each joint."""
    click.echo(f"\nforce at the hand over {POSES} poses, each joint led alone [N]")
    for i, name in enumerate(names):
        ranges = [f"{f.led[:, i].min():4.1f} to {f.led[:, i].max():4.1f}" for f in found.values()]
        click.echo(f"  {name:16} {' -> '.join(ranges)}")
    for what, ratio in (
        ("largest of all, of the smallest", [f.ratio for f in found.values()]),
        ("at one pose, the worst", [f.ratio_at_a_pose for f in found.values()]),
    ):
        click.echo(f"  {what}: {' -> '.join(f'{each:.1f}' for each in ratio)}")


def tuned(
    c: Configuration, gains: Mapping[str, float], mass_s: float | None, *, learning: bool
) -> Configuration:
    """The robot with other gains K_a, another virtual mass, or levels that know of no doubt."""
    if strangers := set(gains) - set(c.joint_names):
        raise click.BadParameter(f"{', '.join(strangers)}: none of {', '.join(c.joint_names)}")
    joints = [
        msgspec.structs.replace(j, admittance_gain=gains.get(j.name, j.admittance_gain))
        for j in c.joints
    ]
    admittance = c.admittance
    if mass_s is not None:
        admittance = msgspec.structs.replace(admittance, virtual_mass_s=mass_s)
    estimator = msgspec.structs.replace(c.estimator, learning=learning)
    return msgspec.structs.replace(c, joints=joints, admittance=admittance, estimator=estimator)


def print_rows(title: str, rows: Sequence[dict[str, Any]], off: Sequence[dict[str, Any]]) -> None:
    """The arm that yields, beside the arm with its drives off."""
    together = len({(row["coast_mrad"], row["resumed_s"]) for row in rows}) == 1
    click.echo(f"\n{title}" + (f": {after_release(rows[0])}" if together else ""))
    click.echo("                    moved   peak  usual   work | off: peak  usual   work | tremble")
    for row, limp in zip(rows, off, strict=True):
        trembles = f"{row['tremble']:.2f}" if abs(row["moved_rad"]) > SHORT_RAD else "-"
        line = (
            f"  {row['joint']:16} {row['moved_rad']:+6.2f} {row['peak_nm']:6.2f} "
            f"{row['usual_nm']:6.2f} {row['work_j']:6.2f} |    {limp['peak_nm']:6.2f} "
            f"{limp['usual_nm']:6.2f} {limp['work_j']:6.2f} | {trembles:>7}"
        )
        click.echo(line if together else f"{line}   {after_release(row)}")


def after_release(row: dict[str, Any]) -> str:
    """Line about the arm after the hand let go."""
    return (
        f"told to go on {row['commanded_mrad']:.0f}, coasts {row['coast_mrad']:.0f}, "
        f"links drift {row['drift_mrad']:.0f} mrad, "
        f"goes on after {row['resumed_s']:.2f} s"
    )


def even_targets(found: Mapping[str, Evenness]) -> list[Target]:
    """How even it is, as it is and balanced."""
    name = f"largest force at the hand over {POSES} poses, of the smallest"
    return [Target(f"{name}, {when}", each.ratio, 3, "x", "lower") for when, each in found.items()]


def targets_of(data: dict[str, Any]) -> list[Target]:
    """Held against what is reached since levels follow what is known of friction: at rest, where
    the hand begins, they are higher than before (decision 0040)."""
    alone = data["alone"]
    at_rest = [row["coast_mrad"] for rows in data["whole"] for row in rows]
    commanded = [row["commanded_mrad"] for rows in data["whole"] for row in rows]
    resumed = [row["resumed_s"] for row in alone]
    ratios = [
        row["work_j"] / limp["work_j"] for row, limp in zip(alone, data["alone_off"], strict=True)
    ]
    return [
        Target("usual torque, joints alone", max(r["usual_nm"] for r in alone), 4.6, "Nm", "lower"),
        Target("tremble, joints alone", max(r["tremble"] for r in alone), 0.25, "", "lower"),
        Target("work, of that with drives off, median", float(np.median(ratios)), 5, "x", "lower"),
        Target("coasting, let go at rest", max(at_rest), 31, "mrad", "lower"),
        Target("told to go on, let go at rest", max(commanded), 5, "mrad", "lower"),
        Target("let go in motion, soonest to go on", min(resumed), 2.0, "s", "higher"),
        Target("let go in motion, latest to go on", max(resumed), 2.1, "s", "lower"),
    ]


def read_gains(pairs: Sequence[str]) -> dict[str, float]:
    """JOINT=K_A, as often as wanted."""
    try:
        return {name: float(value) for name, value in (pair.split("=") for pair in pairs)}
    except ValueError:
        raise click.BadParameter("say JOINT=K_A, like LElbowRoll=0.3") from None


@click.command(help=help_of(__doc__))
@click.option("--speed", default=0.25, show_default=True, help="Of the hand [rad/s].")
@click.option("--gain", "gains", multiple=True, metavar="JOINT=K_A", help="Another K_a.")
@click.option("--mass", type=float, help="Another virtual mass, as its time constant [s].")
@click.option("--even/--no-even", default=True, show_default=True, help="How even it feels.")
@click.option("--learning/--no-learning", default=True, help="Of friction and levels.")
@SEED
@click.option("--json", "as_json", is_flag=True)
def main(
    speed: float, gains: tuple[str, ...], mass: float | None, even: bool, learning: bool, seed: int,
    as_json: bool,
) -> None:  # fmt: skip
    tune = partial(tuned, gains=read_gains(gains), mass_s=mass, learning=learning)
    data = measure(speed, tune, seed)
    found = how_even(speed, tune, seed) if even else {}
    data["even"] = even_data(found)
    if not as_json:
        click.echo(f"led at {speed:g} rad/s, seed {seed}; torques [Nm], work [J], moved [rad]")
        click.echo(f"K_a k_hand [1/s]: {data['gain_times_stiffness_1_s']}")
        print_rows("each joint alone", data["alone"], data["alone_off"])
        for i, (rows, off) in enumerate(zip(data["whole"], data["whole_off"], strict=True), 1):
            print_rows(f"the whole arm to pose {i}", rows, off)
        if found:
            print_even([row["joint"] for row in data["alone"]], found)
        click.echo("")
    targets = targets_of(data) + even_targets(found)
    print_report("hand", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
