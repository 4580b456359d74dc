"""Break the code on purpose, a little at a time, and see that a test fails.

    python -m bench.mutants [NAME]... [--mutmut PROGRAM]     (make mutants)

Each file that judges or bounds is mutated by mutmut in a copy of the tree, and its own tests run on
every mutant. Numbers, operators, names, arguments and keywords are changed; words for people are
not. What survives must be in tests/equivalent_mutants.yaml, with the reason why it changes no
reaction and no bound, and what is listed there must survive: else the exit status is 1.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click
import yaml

ROOT: Final = Path(__file__).resolve().parent.parent
COPIED: Final = (
    "daemon", "drivers", "estimator", "simulator", "bench", "tests", "configs", "docs",
    "errors.py", "pyproject.toml",
)  # fmt: skip
BUILD: Final = ROOT / "build" / "mutants"
LISTED: Final = ROOT / "tests" / "equivalent_mutants.yaml"
# Words; and whether a dataclass is frozen.
LEFT_ALONE: Final = "string,fstring,decorator"

TESTS: Final = {
    "daemon/supervisor.py": "tests/daemon/test_supervisor.py",
    "daemon/observation.py": "tests/daemon/test_observation.py",
    "daemon/plausibility.py": "tests/daemon/test_plausibility.py",
    "daemon/following.py": "tests/daemon/test_following.py",
    "daemon/limits.py": "tests/daemon/test_limits.py",
    "drivers/obedience.py": "tests/drivers/test_obedience.py",
    "drivers/heartbeat.py": "tests/drivers/test_heartbeat.py",
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed line of a file."""

    file: str
    was: str
    became: str

    def __str__(self) -> str:
        return f"{self.file}\n  - {self.was}\n  + {self.became}"


def survivors(file: str, mutmut: str) -> Iterator[Mutant]:
    """Mutate one file; the mutants that no test notices. Raises ClickException."""
    copy = BUILD / Path(file).stem
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir(parents=True)
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(
                source, copy / name, ignore=shutil.ignore_patterns("__pycache__", "out")
            )
        else:
            shutil.copy(source, copy)
    # Bytecode of one mutant must not pass for that of the next (-B). For mutmut only an exit status
    # of 1 is a failure; a mutant that cannot even be imported has another.
    # Nor may the runner have children, which mutmut would wait for after a time-out.
    pytest = "import sys, pytest; sys.exit(bool(pytest.main(sys.argv[1:])))"
    options = "-x -q --tb=no -p no:cacheprovider"
    said = _run(
        copy,
        mutmut,
        "run",
        f"--paths-to-mutate={file}",
        f"--runner={sys.executable} -B -c '{pytest}' {options} {TESTS[file]}",
        f"--disable-mutation-types={LEFT_ALONE}",
        "--tests-dir=tests",
        "--simple-output",
        "--no-progress",
    )
    for number in _run(copy, mutmut, "result-ids", "survived").split():
        shown = _run(copy, mutmut, "show", number)
        changed = re.findall(r"^[-+](?![-+])\s*(.*)$", shown, re.MULTILINE)
        if len(changed) != 2:
            raise click.ClickException(f"mutmut is not understood:\n{said}\n{shown}")
        yield Mutant(file, *changed)


def _run(folder: Path, *command: str) -> str:
    environment = {
        "PATH": "/usr/bin:/bin",
        "LANG": "C.UTF-8",
        "PYTHONPATH": str(folder),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # a second of each run
    }
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    # The exit status of `run` is a sum of bits that say what has survived; 1 is a failure.
    if done.returncode & 1:
        raise click.ClickException(f"{' '.join(command)}:\n{done.stdout}{done.stderr}")
    return done.stdout


def equivalent(files: tuple[str, ...]) -> set[Mutant]:
    """Those that are known to change nothing that matters."""
    listed = yaml.safe_load(LISTED.read_text())
    return {
        Mutant(file, entry["was"], entry["became"])
        for file in files
        for entry in listed.get(file, [])
    }


@click.command(help=__doc__)
@click.argument("names", nargs=-1)
@click.option("--mutmut", default=str(BUILD / "venv" / "bin" / "mutmut"), help="2.5, not 3.")
def main(names: tuple[str, ...], mutmut: str) -> None:
    files = tuple(file for file in TESTS if not names or Path(file).stem in names)
    known, found = equivalent(files), set[Mutant]()
    for file in files:
        alive = list(survivors(file, mutmut))
        found.update(alive)
        click.echo(f"{file}: {len(alive)} alive, {len(known.intersection(alive))} of them known")
    for mutant in sorted(found - known, key=str):
        click.echo(f"no test notices: {mutant}")
    for mutant in sorted(known - found, key=str):
        click.echo(f"listed, but dead or gone: {mutant}")
    sys.exit(found != known)


if __name__ == "__main__":
    main()
