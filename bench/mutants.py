"""Mutation test: the code is broken on purpose, a little at a time, and a test must fail.

    python -m bench.mutants [NAME]... [--jobs N] [--python PROGRAM]     (make mutants)

Each file that judges or bounds is mutated by mutmut, and its own tests run on every mutant, in a
copy of the tree. Numbers, operators, names, arguments and keywords are changed; words for people
are not. What survives must be in tests/equivalent_mutants.yaml, with the reason why it changes no
reaction and no bound, and what is listed there must survive: else the exit status is 1.
"""

import json
import os
import queue
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import click
import yaml

from bench.options import help_of

ROOT: Final = Path(__file__).resolve().parent.parent
COPIED: Final = (
    "bench", "common", "configs", "daemon", "docs", "drivers", "estimator", "identification",
    "programs", "simulator", "tests", "pyproject.toml",
)  # fmt: skip
BUILD: Final = ROOT / "build" / "mutants"
LISTED: Final = ROOT / "tests" / "equivalent_mutants.yaml"
PATIENCE_S: Final = 120.0  # A mutant that takes longer is one that never ends [s]

TESTS: Final[dict[str, tuple[str, ...]]] = {
    "daemon/faults/conditions.py": ("tests/daemon/faults/test_table.py",),
    "daemon/faults/drives_and_bus.py": ("tests/daemon/faults/test_table.py",),
    "daemon/faults/table.py": ("tests/daemon/faults/test_table.py",),
    "daemon/faults/finding.py": ("tests/daemon/faults/test_finding.py",),
    "daemon/faults/detector.py": ("tests/daemon/faults/test_detector.py",),
    "daemon/faults/plausibility.py": ("tests/daemon/faults/test_plausibility.py",),
    "daemon/faults/following.py": ("tests/daemon/faults/test_following.py",),
    "daemon/motion/limits.py": ("tests/daemon/motion/test_limits.py",),
    "estimator/contact.py": ("tests/estimator/test_contact.py",),
    "estimator/contact_detector.py": (
        "tests/estimator/test_contact_detector.py",
        "tests/estimator/test_touched_link.py",
    ),
    "estimator/thresholds.py": ("tests/estimator/test_thresholds.py",),
    "drivers/canopen/heartbeat_watch.py": ("tests/drivers/canopen/test_heartbeat_watch.py",),
    "drivers/stopping/stop_watch.py": (
        "tests/drivers/stopping/test_stop_stages.py",
        "tests/drivers/stopping/test_stop_proof.py",
    ),
    "drivers/stopping/travel.py": ("tests/drivers/stopping/test_stop_stages.py",),
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed line of a file; `source` is all of the file."""

    file: str
    was: str
    became: str
    source: str = field(default="", compare=False)

    def __str__(self) -> str:
        return f"{self.file}\n  - {self.was}\n  + {self.became}"


def mutants(file: str, python: str) -> list[Mutant]:
    """All of a file's, by the Python that has mutmut. Raises ClickException."""
    command = [python, str(ROOT / "bench" / "mutate.py"), str(ROOT / file)]
    try:
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        text = f"mutmut does not run (make mutants): {error}\n{getattr(error, 'stderr', '')}"
        raise click.ClickException(text) from error
    return [Mutant(file, **made) for made in json.loads(said)]


def survivors(found: list[Mutant], jobs: int) -> Iterator[Mutant]:
    """Mutants that no test notices. Raises ClickException if the tests fail without any."""
    places: queue.SimpleQueue[Path] = queue.SimpleQueue()
    for job in range(jobs):
        places.put(_copy(BUILD / f"tree-{job}"))

    def alive(mutant: Mutant) -> bool:
        place = places.get()
        target = place / mutant.file
        original = target.read_text()
        try:
            target.write_text(mutant.source)
            return _passes(place, TESTS[mutant.file])
        finally:
            target.write_text(original)
            places.put(place)

    for file in {mutant.file for mutant in found}:
        if not _passes(BUILD / "tree-0", TESTS[file]):
            raise click.ClickException(f"{' '.join(TESTS[file])}: fails without any mutant")
    with ThreadPoolExecutor(jobs) as pool:
        for mutant, lives in zip(found, pool.map(alive, found), strict=True):
            if lives:
                yield mutant


def _copy(place: Path) -> Path:
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            # Without what is compiled: it would run in place of a mutant.
            shutil.copytree(source, place / name, ignore=shutil.ignore_patterns("out", "*.so"))
        else:
            shutil.copy(source, place)
    # Bytecode of the original must not pass for that of a mutant.
    for file in TESTS:
        for code in (place / file).parent.glob(f"__pycache__/{Path(file).stem}.*"):
            code.unlink()
    return place


def _passes(place: Path, tests: tuple[str, ...]) -> bool:
    # -B: no bytecode of a mutant. Without plugins it starts in half the time.
    command = [sys.executable, "-B", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    environment = {"PYTHONPATH": str(place), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    try:
        done = subprocess.run(
            command,
            cwd=place,
            env=os.environ | environment,
            capture_output=True,
            check=False,
            timeout=PATIENCE_S,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def equivalent(files: tuple[str, ...]) -> set[Mutant]:
    """Mutants that are known to change nothing that matters."""
    listed = yaml.safe_load(LISTED.read_text())
    return {
        Mutant(file, entry["was"], entry["became"])
        for file in files
        for entry in listed.get(file, [])
    }


@click.command(help=help_of(__doc__))
@click.argument("names", nargs=-1)
@click.option("--jobs", type=click.IntRange(1), default=os.cpu_count() or 1, help="At once.")
@click.option("--python", default=str(BUILD / "venv" / "bin" / "python"), help="With mutmut 2.5.")
def main(names: tuple[str, ...], jobs: int, python: str) -> None:
    files = tuple(file for file in TESTS if not names or Path(file).stem in names)
    known, found = equivalent(files), set[Mutant]()
    for file in files:
        made, alive = mutants(file, python), set[Mutant]()
        click.echo(f"{file}: {len(made)} mutants ...")
        for mutant in survivors(made, jobs):
            alive.add(mutant)
            if mutant not in known:
                click.echo(f"no test notices: {mutant}")
        found |= alive
        click.echo(f"{file}: {len(alive)} alive, {len(alive - known)} of them not listed")
    for mutant in sorted(known - found, key=str):
        click.echo(f"listed, but dead or gone: {mutant}")
    sys.exit(found != known)


if __name__ == "__main__":
    main()
