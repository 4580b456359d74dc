"""A newcomer with an arm of their own: from URDF and EDS to armed and led, and what is said of the
mistakes that are made on the way.

    python -m bench.newcomer [--owners N] [--arms N] [--no-mistakes] [--json]
    python -m bench.newcomer --owners 0 --no-mistakes     # the makers alone, some seconds
    python -m bench.newcomer --owners 3 --make damiao --no-mistakes

A scripted owner (`bench/rigs/owner.py`) takes each of N generated arms, which no test has seen, by
documented commands alone as far as it goes. Every mistake of `bench/study/mistakes.py` that files
can show is planted alone into one arm of each of six makes of drives, and looked for at the field
that is wrong; those that the check does not refuse, and those that only the wiring can show, are
taken to a simulated arm. Arms without a mistake must pass without a warning. Drives are
drafted from the EDS of ten makers (`bench/rigs/makers.py`): each object must be right or asked for.
All of it takes about half an hour of CPU time.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click

from bench.options import command
from bench.report import Target, print_report
from bench.rigs.generated_arms import GeneratedArm, generate
from bench.rigs.generated_makes import MAKES
from bench.rigs.makers import RIGHT, makers, verdict, wrong
from bench.rigs.motor_owner import MODELS, MotorOwner, motor_arm
from bench.rigs.owner import Owner, Story
from bench.study.mistakes import MISTAKES, checkable, reported
from bench.study.unrefused import met

LEAST = 57
COMMANDS, FIELDS = 15, 10


def planted(arm: GeneratedArm, folder: Path) -> dict[str, Any]:
    """Mistakes in one arm: how many were reported at their field, how many refused,
    and the words of those that were missed."""
    missed, refused = [], 0
    for mistake in checkable():
        said = reported(mistake.plant(arm, folder))
        refused += said.refused
        if not said.of(mistake.field):
            missed.append(mistake.words)
    there = sum(not mistake.only_wiring for mistake in MISTAKES)
    found = there - len(missed)
    return {"make": arm.make.name, "reported": found, "refused": refused, "missed": missed}


def of_mistakes(folder: Path, arms: int) -> tuple[list[Target], dict[str, Any]]:
    """Targets and data of the planted mistakes, and of arms without one."""
    makes = range(len(MAKES))
    found = [planted(generate(seed), folder / f"planted{seed}") for seed in makes]
    clean = [reported(generate(seed).write(folder / f"clean{seed}")) for seed in range(arms)]
    at_arms = [
        met(mistake, generate(k % len(MAKES)), folder / f"met{k}")
        for k, mistake in enumerate(MISTAKES)
    ]
    warned = sum(bool(said.lines) for said in clean)
    targets = [
        Target("mistakes reported at the right field, at least, of 60",
               min(f["reported"] for f in found), LEAST, better="higher"),
        Target(f"arms without mistakes that are warned of, of {arms}", warned, 0),
        Target(f"of {len(MISTAKES)} mistakes, those with which an arm was armed or ran, or that "
               "neither check nor wiring tell", sum(one.harmful for one in at_arms), 0),
    ]  # fmt: skip
    return targets, {"makes": found, "at arms": [asdict(one) for one in at_arms]}


def of_makers(folder: Path) -> tuple[list[Target], dict[str, Any]]:
    """Target and data of drives that are drafted from the EDS of their makers."""
    found = {name: wrong(maker, folder) for name, maker in makers().items()}
    verdicts = {name: verdict(maker, folder) for name, maker in makers().items()}
    of = sum(len(RIGHT[name]) for name in found)
    right = of - sum(map(len, found.values()))
    target = Target(f"drafted objects right or asked for, of {of} of {len(found)} makers",
                    100.0 * right / of, 100, "%", "higher")  # fmt: skip
    return [target], {"wrong": found, "verdicts": verdicts}


def targets_of(stories: Sequence[Story]) -> list[Target]:
    """Targets of the owners: who got there, and the worst of those who did."""
    led = [story for story in stories if story.led]

    gaps, coulomb, viscous, rotors = (
        [one for story in led for one in story.inside.get(name, ())]
        for name in ("gap", "K_theta_s", "K_theta_v", "B")
    )
    joints = sum(story.joints for story in led)

    def share(part: float, of: int) -> float:
        return 100.0 * part / of if of else float("nan")

    def worst(figures: Sequence[float]) -> float:
        return max(figures, default=float("nan"))

    return [
        Target(f"owners who armed and led their arm, of {len(stories)}", len(led), len(stories),
               better="higher"),
        Target("different commands of an owner who got there, at most",
               worst([len(set(s.commands)) for s in led]), COMMANDS),
        Target("commands typed, every start of the daemon among them, at most",
               worst([len(s.commands) for s in led]), COMMANDS),
        Target("fields that change beyond the data sheets, signs and zeros, at most",
               worst([len(set(s.seen)) for s in led]), FIELDS),
        *(
            target
            for name, found in (("gaps", gaps), ("Coulomb friction", coulomb),
                                ("viscous friction", viscous), ("rotors", rotors))
            for target in (
                Target(f"{name} answered, of {joints} joints", share(len(found), joints), 95, "%",
                       "higher"),
                Target(f"{name} within the interval", share(sum(found), len(found)), 95, "%",
                       "higher"),
            )
        ),
        Target("machine work of an owner, at most", worst([s.machine_s for s in led]), 1800, "s"),
    ]  # fmt: skip


@command(__doc__)
@click.option("--owners", default=20, type=click.IntRange(0, 1000))
@click.option("--first", default=0, help="Seed of the first owner's arm.")
@click.option(
    "--make",
    type=click.Choice(["canopen", *MODELS]),
    default="canopen",
    help="Of the owners' arms.",
)
@click.option("--arms", default=20, type=click.IntRange(1, 1000))
@click.option("--mistakes/--no-mistakes", default=True)
def main(owners: int, first: int, arms: int, make: str, *, mistakes: bool, as_json: bool) -> None:
    data: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        targets, data["makers"] = of_makers(Path(name))
        if mistakes:
            of_planted, planted_data = of_mistakes(Path(name), arms)
            targets, data = [*targets, *of_planted], data | planted_data
        if owners:
            seeds = range(first, first + owners)
            canopen = make == "canopen"
            owner, arms_of = (
                (Owner, generate) if canopen else (MotorOwner, partial(motor_arm, make=make))
            )
            stories = [owner(arms_of(seed), Path(name) / f"owner{seed}").go() for seed in seeds]
            targets = [*targets, *targets_of(stories)]
            data["owners"] = [asdict(story) for story in stories]
    print_report("newcomer", first, targets, data, as_json=as_json)


if __name__ == "__main__":
    main()
