"""Limits of the house: `make house` prints each measure, its limit and its goal, and exits 1 beyond
a limit.

A limit is what was measured when it was written, and sinks with that; only a decision record raises
one (docs/decisions/0006-the-house.md). The goal is where it has to get.
"""

import ast
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PRODUCT: Final = (
    "common", "contactd_client", "daemon", "drivers", "estimator", "identification",
    "lerobot_robot_contactd", "programs",
    "simulator",
)  # fmt: skip
LONG_FILE: Final = 300  # lines
_DIALECT: Final = re.compile(r"\b(nobody|somebody|whoever|told|tells)\b", re.IGNORECASE)
_NO_NOUN: Final = re.compile(r'"{3}(What|Of|Where|How|Who|Whom|Whose|Which)\b')


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of the house, with the limit that `make check` holds and its goal."""

    name: str
    now: int
    limit: int
    goal: int
    where: tuple[str, ...] = ()
    """Files to look at where it is beyond."""


def sources(folders: Iterable[str], root: Path = ROOT) -> Iterator[Path]:
    """Python sources and declarations below the folders."""
    for folder in folders:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".pxd") and "node_modules" not in path.parts:
                yield path


def lines(folders: Iterable[str], root: Path = ROOT) -> int:
    """Number of lines of the sources."""
    return sum(len(path.read_text().splitlines()) for path in sources(folders, root))


def constructors(of: str, text: str) -> int:
    """Number of calls of a class in a source."""
    calls = (node.func for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    return sum(isinstance(call, ast.Name) and call.id == of for call in calls)


def words_of_docs(root: Path = ROOT) -> int:
    """Number of words of README, CONTRIBUTING and all pages below docs/."""
    pages = [root / "README.md", root / "CONTRIBUTING.md", *(root / "docs").rglob("*.md")]
    return sum(len(page.read_text().split()) for page in pages)


def long_files(root: Path = ROOT) -> tuple[str, ...]:
    """Files of the product over LONG_FILE lines, without those that `make reference` makes."""
    texts = ((path, path.read_text()) for path in sources(PRODUCT, root) if path.suffix == ".py")
    return tuple(
        f"{path.relative_to(root)}: {len(text.splitlines())} lines"
        for path, text in texts
        if len(text.splitlines()) > LONG_FILE and "by `make reference`" not in text[:400]
    )


def measures(root: Path = ROOT) -> list[Measure]:
    """All measures of the house."""
    python = [path.read_text() for path in sources(PRODUCT, root) if path.suffix == ".py"]
    written = [path.read_text() for path in sources((*PRODUCT, "bench", "docs", "tests"), root)]
    decisions = len(list((root / "docs/decisions").glob("[0-9]*.md")))
    long = long_files(root)
    return [
        Measure("lines of the product", lines(PRODUCT, root), 69_170, 44_000),
        Measure("lines of daemon/", lines(["daemon"], root), 15_190, 12_500),
        Measure("lines of bench/", lines(["bench"], root), 16_600, 12_000),
        Measure("lines of tests/", lines(["tests"], root), 69_610, 45_000),
        Measure(f"files of the product over {LONG_FILE} lines", len(long), 0, 0, long),
        Measure("words of README, CONTRIBUTING, docs/", words_of_docs(root), 49_950, 50_000),
        Measure("decision records", decisions, 28, 28),
        Measure("lines of README", len((root / "README.md").read_text().splitlines()), 90, 90),
        Measure("dialect words", sum(len(_DIALECT.findall(text)) for text in written), 10, 10),
        Measure("docstrings without a noun", sum(len(_NO_NOUN.findall(t)) for t in written), 0, 0),
        Measure("constructors of State", sum(constructors("State", t) for t in python), 1, 1),
    ]


def main() -> int:
    """Print all measures; the exit status is 1 where one is beyond its limit."""
    house = measures()
    width = max(len(measure.name) for measure in house)
    print(f"{'':{width}}      now    limit     goal")
    for m in house:
        beyond = ["  BEYOND", *m.where] if m.now > m.limit else [""]
        print(f"{m.name:{width}} {m.now:8,} {m.limit:8,} {m.goal:8,}" + "\n  ".join(beyond))
    return int(any(measure.now > measure.limit for measure in house))


if __name__ == "__main__":
    sys.exit(main())
