"""Sentences at a terminal: words stay whole; elsewhere they stay in one line, for who reads it."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.protocol.trend_row import trends_folder
from programs.command_line.console import on_stdout
from programs.command_line.sentences import folded, say
from programs.contactctl import contactctl
from programs.trends.day import write_day
from tests.programs.trends.test_findings import days, worn

ROOT = Path(contactctl.__file__).parents[2]

LONG = "  - changed since it was read: config.yaml, identified.yaml; `contactctl reload`"


@given(
    words=st.lists(st.text("ab-/`:", min_size=1, max_size=30), min_size=1, max_size=20),
    indent=st.integers(0, 6),
    width=st.integers(8, 90),
)
def test_words_are_neither_cut_nor_lost(words: list[str], indent: int, width: int) -> None:
    lines = folded(" " * indent + " ".join(words), width).splitlines()
    assert " ".join(lines).split() == words
    for line in lines:
        assert line.startswith(" " * indent)
        assert len(line) <= width or len(line.split()) == 1


def test_spaces_inside_a_line_stay() -> None:
    assert folded("  passed  limits    every joint inside", 80) == (
        "  passed  limits    every joint inside"
    )


@pytest.mark.parametrize("err", [False, True])
def test_a_terminal_gets_whole_words_and_a_pipe_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *, err: bool
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    say(LONG, err=err)
    assert "".join(capsys.readouterr()) == f"{LONG}\n"
    monkeypatch.setattr(sys.stderr if err else sys.stdout, "isatty", lambda: True)
    say(LONG, err=err)
    assert "".join(capsys.readouterr()) == (
        "  - changed since it was read: config.yaml, identified.yaml;\n  `contactctl reload`\n"
    )


@pytest.mark.parametrize(
    "words",
    [
        ["contactctl", "health", "--directory", "STATE"],
        ["contactctl", "--json", "health", "--directory", "STATE"],
        ["contactctl", "status"],
        ["contactd", "check", "configs/single_joint"],
    ],
)
def test_a_closed_pipe_is_not_taken_for_an_answer(
    fake_daemon: Any, tmp_path: Path, words: list[str]
) -> None:
    """Status 1 of `health` means that something is to be said of a joint."""
    for day in days(5, worn):
        write_day(trends_folder(tmp_path, "arm"), day)
    program, *arguments = [str(tmp_path) if word == "STATE" else word for word in words]
    main = f"from programs.{program}.{program} import main; main()"
    read, write = os.pipe()
    os.close(read)
    with open(write, "wb") as no_one:
        done = subprocess.run(
            [sys.executable, "-c", main, *arguments],
            cwd=ROOT,
            env={**os.environ, "CONTACTD_SOCKET": str(fake_daemon.path)},
            stdout=no_one,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize(("columns", "width"), [("60", 60), ("200", 200), ("", 120), ("0", 120)])
def test_a_pipe_has_the_columns_that_are_asked_for(
    monkeypatch: pytest.MonkeyPatch, columns: str, width: int
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert on_stdout().width == width
