"""`contactd` run for tests, and the folders that `contactd new` drafts."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import yaml
from click.testing import CliRunner, Result

from bench.rigs.lockstep import Rig, lockstep_rig
from programs.contactd.contactd import main
from programs.simulate.simulated_robot import true_arm

GOLDEN: Final = Path(__file__).with_name("golden")


def contactd(*words: object, **options: Any) -> Result:
    """Result of a command line."""
    return CliRunner().invoke(main, [str(word) for word in words], **options)


def each(option: str, *values: object) -> list[str]:
    """Words that give an option once for each value."""
    return [word for value in values for word in (option, str(value))]


def config_of(folder: Path) -> Any:
    """The folder's config.yaml."""
    return yaml.safe_load((folder / "config.yaml").read_text())


@contextmanager
def rehearsal(folder: Path) -> Iterator[Rig]:
    """A drafted arm in lockstep with its simulation, enabled."""
    with lockstep_rig(folder, described=lambda robot, _: true_arm(robot)[0]) as rig:
        rig.enable()
        yield rig
