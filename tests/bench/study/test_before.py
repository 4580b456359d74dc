"""The code before: a commit's files in a folder, or nothing."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from bench.study.before import BEFORE, code_before


def git(folder: Path, *words: str) -> str:
    identity = ("-c", "user.name=t", "-c", "user.email=t@example.org")
    said = subprocess.run(
        ["git", "-C", folder, *identity, *words], check=True, capture_output=True, text=True
    )
    return said.stdout.strip()


@pytest.mark.skipif(not shutil.which("git"), reason="there is no git")
def test_it_is_the_commit_and_not_what_lies_in_the_folder(tmp_path: Path) -> None:
    git(tmp_path, "init", "--quiet")
    (tmp_path / "said").write_text("then")
    git(tmp_path, "add", "said")
    git(tmp_path, "commit", "--quiet", "-m", "Say it")
    commit = git(tmp_path, "rev-parse", "HEAD")
    (tmp_path / "said").write_text("now")
    with code_before(commit, tmp_path) as before:
        assert before is not None
        assert [path.name for path in before.iterdir()] == ["said"]
        assert (before / "said").read_text() == "then"
    assert not before.exists()
    with code_before("0" * 40, tmp_path) as before:
        assert before is None


def test_without_a_repository_or_without_git_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with code_before(BEFORE, tmp_path) as before:
        assert before is None
    monkeypatch.setenv("PATH", str(tmp_path))
    with code_before() as before:
        assert before is None


def test_the_commit_is_named_by_its_whole_hash() -> None:
    assert re.fullmatch("[0-9a-f]{40}", BEFORE)
