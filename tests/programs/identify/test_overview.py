"""Overview of the identification: what is known, how good, how old, and what is next."""

import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from daemon.config.identified import GapEntry, Identified, WiringEntry, write_identified
from daemon.config.load import Robot, load_robot
from programs.contactd.contactd import main
from programs.identify.merge import merged
from programs.identify.overview import Cell, overview

NOW = datetime(2026, 1, 12, 3, 4, 5, tzinfo=UTC)
DAY = {"date": "2026-01-02T03:04:05+00:00", "log": "0"}
FIRST, SECOND = "LShoulderPitch", "LShoulderYaw"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The left arm, of which nothing is known."""
    shutil.copytree(ROMEO, tmp_path / "arm")
    (tmp_path / "arm" / "identified.yaml").unlink()
    config = tmp_path / "arm" / "config.yaml"
    lines = config.read_text().splitlines(keepends=True)
    config.write_text("".join(line for line in lines if "known:" not in line))
    return tmp_path / "arm"


def written(place: Path, found: Identified) -> Robot:
    write_identified(place / "identified.yaml", found)
    return load_robot(place)


def test_what_is_missing_comes_in_the_order_of_the_steps(place: Path) -> None:
    robot = load_robot(place)
    names = robot.configuration.joint_names
    seen = overview(robot, NOW)
    assert seen.following == f"contactd identify wiring {' '.join(names)}"
    for row in seen.cells.values():
        assert row.pop("masses") == Cell("as the URDF", good=True)
        assert {cell.text for cell in row.values()} == {"missing"}
    wiring = {name: WiringEntry(**DAY, follows=1.0) for name in names}
    robot = written(place, merged(robot, "wiring", wiring, {}))
    gap = {FIRST: GapEntry(**DAY, half_gap=0.018, confidence=0.0004)}
    robot = written(place, merged(robot, "gap", gap, {}))
    seen = overview(robot, NOW)
    assert seen.following == f"contactd identify gap {' '.join(names[1:])}"
    assert seen.cells[FIRST]["gap"].text == "18.00 +- 0.40 mrad, 10 d ago"
    assert seen.cells[SECOND]["wiring"].text == "link/motor 1.000, 10 d ago"


def test_what_is_void_says_so(place: Path) -> None:
    robot = load_robot(place)
    names = robot.configuration.joint_names
    wiring = {name: WiringEntry(**DAY, follows=1.0) for name in names}
    robot = written(place, merged(robot, "wiring", wiring, {}))
    slower = msgspec.structs.replace(robot.configuration, period_ms=20.0)
    seen = overview(replace(robot, configuration=slower), NOW)
    assert seen.cells[FIRST]["wiring"].text == "void, was link/motor 1.000, 10 d ago"
    assert not seen.cells[FIRST]["wiring"].good
    assert seen.following.startswith(f"contactd identify wiring {FIRST}")


def test_the_command_shows_it_without_a_daemon(place: Path) -> None:
    result = CliRunner().invoke(main, ["identify", "--config", str(place)])
    assert result.exit_code == 1, result.output
    assert "missing" in result.output
    assert "next: contactd identify wiring LShoulderPitch" in result.output
    known = CliRunner().invoke(main, ["identify", "--config", str(SINGLE_JOINT)])
    assert "known: " in known.output
    astray = CliRunner().invoke(main, ["identify", "--config", str(place), "gap", "joint"])
    assert astray.exit_code == 2
    assert "must follow the step's name" in astray.output
