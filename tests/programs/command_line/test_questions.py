"""Questions at a terminal: an answer is what was typed after them."""

import os
import pty
import subprocess
import sys
from typing import IO

import pytest


def answers(ask: str, ahead: bytes, answer: bytes) -> str:
    """Answer to a question of which `ahead` was typed before it stood at the terminal, and
    `answer` after it."""
    terminal, standard_input = pty.openpty()
    os.write(terminal, ahead)
    program = f"from programs.command_line.questions import choice, confirmed; print({ask})"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=standard_input, stdout=subprocess.PIPE
    ) as asking:
        assert asking.stdout is not None
        said = until(asking.stdout, b"]:" if "confirmed" in ask else b"):")
        os.write(terminal, answer)
        said += asking.stdout.read()
    os.close(terminal)
    os.close(standard_input)
    return said.decode().split()[-1]


def until(stream: IO[bytes], end: bytes) -> bytes:
    """Output up to a question's end."""
    said = b""
    while not said.endswith(end) and (byte := stream.read(1)):
        said += byte
    return said


@pytest.mark.parametrize(("answer", "may"), [(b"n\n", "False"), (b"\n", "False"), (b"y\n", "True")])
def test_a_yes_typed_before_the_question_does_not_count(answer: bytes, may: str) -> None:
    assert answers("confirmed('Move the arm?')", b"y\ny\n", answer) == may


def test_a_sign_typed_before_the_push_does_not_count() -> None:
    assert answers("choice('Which way did it go', ['+', '-'])", b"+\n+", b"-\n") == "-"
