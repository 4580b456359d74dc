"""The upright arm from zero to armed without a hand."""

from pathlib import Path
from typing import Any

from bench.report import Target
from bench.rigs import upright_arm
from bench.rigs.person import Person
from bench.study.commissioned import Show, judged
from daemon.commands.simulated_robot import true_arm


def at_upright_arm(folder: Path, seed: int, show: Show) -> Person:
    """A person at the upright arm, with poor guesses of it."""
    return Person(
        folder,
        seed,
        show,
        upright_arm.write(folder / "upright"),
        pose=None,
        described=lambda robot, _: true_arm(robot)[0],
    )


def upright(folder: Path, seed: int, show: Show) -> tuple[list[Target], dict[str, Any]]:
    """Commission it; targets of the project, and numbers behind them."""
    person = at_upright_arm(folder, seed, show)
    return judged("upright", person, person.from_zero_to_armed())
