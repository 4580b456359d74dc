"""The upright arm from zero to armed without a hand."""

from pathlib import Path
from typing import Any

from bench.report import Target
from bench.rigs import upright_arm
from bench.rigs.person import Person
from bench.study.commissioned import Show, judged
from programs.simulate.simulated_robot import true_arm


def upright(folder: Path, seed: int, show: Show) -> tuple[list[Target], dict[str, Any]]:
    """Commission it; targets of the project, and numbers behind them."""
    person = Person(
        folder,
        seed,
        show,
        upright_arm.write(folder / "upright"),
        pose=None,
        described=lambda robot, _: true_arm(robot)[0],
    )
    return judged("upright", person, person.from_zero_to_armed())
