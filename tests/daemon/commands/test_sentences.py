"""Sentences at a terminal: words stay whole; elsewhere they stay in one line."""

import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.commands.sentences import folded, say

LONG = "  - changed since it was read: config.yaml, identified.yaml; `contactctl reload`"


@given(
    words=st.lists(st.text("ab-/`:", min_size=1, max_size=30), min_size=1, max_size=20),
    indent=st.integers(0, 6),
    width=st.integers(8, 90),
)
def test_no_word_is_cut_and_none_is_lost(words: list[str], indent: int, width: int) -> None:
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
