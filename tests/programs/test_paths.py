"""Paths on both command lines: empty ones, and sockets that are none."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from programs.contactctl import contactctl
from programs.contactd import contactd

ROOT = Path(contactctl.__file__).parents[2]


@pytest.mark.parametrize(
    ("program", "words", "name"),
    [
        (contactctl, ["start", ""], "FILE.csv"),
        (contactctl, ["record", ""], "FILE"),
        (contactctl, ["--socket", "", "status"], "--socket"),
        (contactctl, ["status", "--socket", ""], "--socket"),
        (contactd, ["new", "", "--urdf", "a.urdf", "--eds", "a.eds"], "DIR"),
        (contactd, ["check", ""], "CONFIG"),
        (contactd, ["whatif", "a.mcap", ""], "FILE|DIR"),
    ],
)
def test_an_empty_path_is_not_this_folder(program: Any, words: list[str], name: str) -> None:
    result = CliRunner().invoke(program.main, words)
    assert (result.exit_code, result.stderr.splitlines()[-1]) == (2, f"Error: {name} is empty")


@pytest.mark.parametrize("name", ["README.md", "docs"])
def test_a_file_that_is_no_socket_is_refused(name: str) -> None:
    result = CliRunner().invoke(contactctl.main, ["--socket", str(ROOT / name), "status"])
    assert (result.exit_code, result.stderr) == (69, f"contactctl: {ROOT / name} is not a socket\n")
