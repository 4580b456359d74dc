"""Exit statuses of `contactd`, by what ends it."""

import os
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from common.errors import ConfigurationError
from daemon.config import load
from programs.contactd.contactd import main


@pytest.mark.parametrize(
    ("error", "status", "first", "last"),
    [
        (ConfigurationError("it is wrong"), 78, "contactd: it is wrong", "contactd: it is wrong"),
        (ZeroDivisionError("so it is"), 70, "Traceback", "ZeroDivisionError: so it is"),
        (click.UsageError("unheard of"), 2, "Usage:", "Error: unheard of"),
        (SystemExit(3), 3, "", ""),
    ],
)
def test_exit_status_of_a_start_that_ends(
    error: BaseException, status: int, first: str, last: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: object) -> None:
        raise error

    monkeypatch.setattr(load, "load_robot", fails)
    result = CliRunner().invoke(main, ["run", "configs/single_joint"])
    assert result.exit_code == status
    lines = result.stderr.splitlines() or [""]
    assert lines[0].startswith(first)
    assert lines[-1] == last


def test_no_command_starts_threads_of_numeric_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "8")
    CliRunner().invoke(main, ["identify", "--config", "nowhere"])
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_a_demo_does_not_overwrite_a_recording(tmp_path: Path) -> None:
    there = tmp_path / "there.mcap"
    there.write_text("precious")
    result = CliRunner().invoke(main, ["demo", "--record", str(there)])
    assert result.exit_code == 65
    assert "never overwritten" in result.stderr
    assert there.read_text() == "precious"
