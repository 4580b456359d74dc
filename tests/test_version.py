"""The version of these sources, by tags, by CHANGELOG.md, and without git."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from version import released, version

ROOT = Path(__file__).parents[1]
CHANGES = "# Changelog\n\n## [Unreleased]\n\n## [0.1.0] - 2026-11-23\n\n## [0.0.9] - 2026-01-02\n"


def git(root: Path, *words: str) -> str:
    who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    command = ("git", *who, "-c", "init.defaultBranch=main", *words)
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout


def commit(root: Path) -> None:
    with (root / "file").open("a") as file:
        file.write("more\n")
    git(root, "add", ".")
    git(root, "commit", "-m", "more")


def clone(root: Path) -> None:
    git(root, "init")
    commit(root)


def tag(name: str) -> Callable[[Path], object]:
    return lambda root: git(root, "tag", name)


def edit(root: Path) -> None:
    (root / "file").write_text("another\n")


CASES: dict[str, tuple[list[Callable[[Path], object]], str]] = {
    "no git": ([], "0.1.0"),
    "a clone without tags": ([clone], "0.1.0+gHASH"),
    "that is edited": ([clone, edit], "0.1.0+gHASH.edited"),
    "a release": ([clone, tag("v0.2.0")], "0.2.0"),
    "a release that is edited": ([clone, tag("v0.2.0"), edit], "0.2.0+0.gHASH.edited"),
    "behind it": ([clone, tag("v0.2.0"), commit, commit], "0.2.0+2.gHASH"),
    "a later one": ([clone, tag("v0.2.0"), commit, tag("v0.10.0")], "0.10.0"),
    "a tag that is no version": ([clone, tag("v-good"), tag("before")], "0.1.0+gHASH"),
    "a .git that is none": ([lambda root: (root / ".git").mkdir()], "0.1.0"),
    "inside another's clone": (
        [lambda root: clone(root.parent), lambda root: tag("v7.0.0")(root.parent)],
        "0.1.0",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_it_follows_from_the_tag_and_how_far_it_lies_behind(tmp_path: Path, case: str) -> None:
    steps, reported = CASES[case]
    root = tmp_path / "clone"
    root.mkdir()
    (root / "CHANGELOG.md").write_text(CHANGES)
    for step in steps:
        step(root)
    name = git(root, "rev-parse", "--short", "HEAD").strip() if "HASH" in reported else ""
    assert version(root) == reported.replace("HASH", name)


def test_a_changelog_without_a_release_is_refused(tmp_path: Path) -> None:
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## [Unreleased]: 0.1.0\n")
    with pytest.raises(ValueError, match="no line such as"):
        version(tmp_path)


def test_ours_has_one_and_what_comes_next_has_its_place() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    assert text.index("\n## [Unreleased]\n") < text.index(f"\n## [{released(ROOT)}] - ")
