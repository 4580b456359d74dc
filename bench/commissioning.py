"""Commissioning from zero to armed: every step of `contactd identify` on simulated arms.

    python -m bench.commissioning [--part romeo|upright|all] [--seed N] [--json]

romeo    The daemon's configuration has the wiring and the makers' figures of the Romeo arm; its
         half-gaps, friction, rotors and thresholds are poor guesses. Masses, torque constants,
         friction, gaps and rotors of the arm itself are off the nominal ones by the usual
         mismatch. Beside it: one whose inertias are the model's, and one whose drives do not
         filter their current.
upright  An upright arm of six joints with soft gears, weak wrists, encoders that err and masses
         that are 10 % off (bench/rigs/upright_arm.py), guessed as poorly.

Daemon and arm run in lockstep; the steps are the commands that a person types, and nobody touches
the arm. What they answer is shown, with --json on stderr. It takes some ten minutes of CPU time.
"""

import logging
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, get_args

import click

from bench.options import SEED, command
from bench.report import Target, print_report
from bench.rigs import upright_arm
from bench.rigs.person import Person
from bench.study.commissioned import Show, judged
from bench.study.romeo_commissioning import romeo
from programs.simulate.simulated_robot import true_arm

Part = Literal["romeo", "upright", "all"]
Commissioned = Callable[[Path, int, Show], tuple[list[Target], dict[str, Any]]]


def upright(folder: Path, seed: int, show: Show) -> tuple[list[Target], dict[str, Any]]:
    """Commission the upright arm; targets of the project, and numbers behind them."""
    model = upright_arm.write(folder / "upright")
    person = Person(
        folder, seed, show, model, pose=None, described=lambda robot, _: true_arm(robot)[0]
    )
    return judged("upright", person, person.from_zero_to_armed())


PARTS: Final[Mapping[str, Commissioned]] = {"romeo": romeo, "upright": upright}


@command(__doc__)
@click.option("--part", type=click.Choice(get_args(Part)), default="all")
@SEED
def main(part: Part, seed: int, as_json: bool) -> None:
    logging.getLogger("contactd").setLevel(logging.ERROR)

    def show(text: str) -> None:
        click.echo(text, err=as_json)

    targets: list[Target] = []
    data: dict[str, Any] = {}
    for name, commission in PARTS.items():
        if part not in (name, "all"):
            continue
        begun = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="commissioning-") as folder:
            own, about = commission(Path(folder), seed, show)
        lasted_s = round(time.monotonic() - begun, 1)
        click.echo(f"{name}: {lasted_s:.0f} s", err=True)
        targets += own
        data[name] = about | {"lasted_s": lasted_s}
    print_report("commissioning", seed, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
