"""Limits of the house: `make house` prints each measure, its limit and its goal, and exits 1 beyond
a limit.

A limit is what was measured when it was written, and sinks with that; only a decision record raises
one (docs/decisions/0006-the-house.md). The goal is where it has to get.
"""

import ast
import re
import statistics
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parent))
from house_walk import Walk

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


def named(text: str) -> set[str]:
    """Names that a source lists: fields that it declares, keywords that it passes, keys of its
    tables, and modules that it imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.AnnAssign):
            found.add(ast.unparse(node.target))
        elif isinstance(node, ast.keyword):
            found.add(node.arg or "")
        elif isinstance(node, ast.Dict):
            found |= {str(key.value) for key in node.keys if isinstance(key, ast.Constant)}
        elif isinstance(node, ast.ImportFrom):
            found |= {each.name for each in node.names}
    return found


def fields_of(name: str, text: str) -> list[str]:
    """Fields that a class declares."""
    classes = [n for n in ast.parse(text).body if isinstance(n, ast.ClassDef) and n.name == name]
    declared = [each for one in classes for each in one.body if isinstance(each, ast.AnnAssign)]
    return [ast.unparse(each.target) for each in declared]


def files_for_field(fields: Iterable[str], texts: Iterable[str]) -> int:
    """Median, over the fields, of the number of sources that list one."""
    lists = [named(text) for text in texts]
    return round(statistics.median(sum(name in each for each in lists) for name in fields))


def files_that_list(names: Iterable[str], texts: Iterable[str]) -> int:
    """Number of sources that list more than half of the names."""
    wanted = set(names)
    return sum(2 * len(wanted & named(text)) > len(wanted) for text in texts)


def loaded_from(start: str, texts: dict[str, str]) -> set[str]:
    """Files that a file imports, and all that these import; texts: by file."""
    found, left = set[str](), [start]
    while left:
        file = left.pop()
        if file in texts and file not in found:
            found.add(file)
            for node in ast.walk(ast.parse(texts[file])):
                if isinstance(node, ast.ImportFrom) and node.module:
                    names = ["", *(f"/{each.name}" for each in node.names)]
                    left += [f"{node.module.replace('.', '/')}{name}.py" for name in names]
    return found


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
    daemon = {str(p.relative_to(root)): p.read_text() for p in sources(["daemon"], root)
              if p.suffix == ".py"}  # fmt: skip
    loaded = loaded_from("daemon/run.py", daemon)
    beside = tuple(f for f in daemon if f not in loaded and not f.endswith("__init__.py"))
    walk = Walk(daemon, "daemon/tick/controller.py")
    walk.enter("Controller", "step", {"observed"})
    # A field that Status has as well goes through its files, too.
    status = set(fields_of("Status", daemon["daemon/protocol/replies.py"]))
    state = set(fields_of("State", daemon["daemon/protocol/state.py"])) - status
    steps = {path.stem for path in (root / "programs/identify/steps").glob("[a-z]*.py")}
    return [
        Measure("lines of the product", lines(PRODUCT, root), 69_640, 44_000),
        Measure("lines of daemon/", lines(["daemon"], root), 15_120, 12_500),
        Measure("lines of bench/", lines(["bench"], root), 16_610, 12_000),
        Measure("lines of tests/", lines(["tests"], root), 68_660, 45_000),
        Measure(f"files of the product over {LONG_FILE} lines", len(long), 0, 0, long),
        Measure("words of README, CONTRIBUTING, docs/", words_of_docs(root), 50_000, 50_000),
        Measure("decision records", decisions, 28, 28),
        Measure("lines of README", len((root / "README.md").read_text().splitlines()), 90, 90),
        Measure("dialect words", sum(len(_DIALECT.findall(text)) for text in written), 10, 10),
        Measure("docstrings without a noun", sum(len(_NO_NOUN.findall(t)) for t in written), 0, 0),
        Measure("files of daemon/ that `contactd run` does not load", len(beside), 0, 0, beside),
        Measure("constructors of State", sum(constructors("State", t) for t in python), 1, 1),
        # That a start calls it once is a test of tests/daemon/service/test_reload.py.
        Measure(
            "constructors of Model in daemon/",
            sum(constructors("Model", text) for text in daemon.values()),
            1,
            1,
        ),
        Measure("returns in the walk of Controller.step:observed", walk.returns, 4, 5),
        Measure(
            "files for a field of State (median)", files_for_field(state, daemon.values()), 3, 3
        ),
        # Its mathematics, its Step, and what lists all steps.
        Measure("files for a step of the identification", 2 + files_that_list(steps, python), 3, 3),
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
