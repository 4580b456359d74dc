"""Loads in logs of other programs: those that are stated, and those that are recognised."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.foreign_logs import Style, stranger, urdf_of, write_csv
from daemon.config.load import load_robot
from daemon.protocol.state import State
from programs.contactd.contactd import main
from programs.identify.foreign import foreign_states, read_aligned
from programs.recordings.over_log import over_log

SEED, LOAD_KG = 1, 0.4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of an arm whose hand is empty, then not; its configuration is of the first."""
    folder = tmp_path_factory.mktemp("logs")
    for name, kg in (("empty", 0.0), ("loaded", LOAD_KG)):
        of = stranger(SEED, 30.0, folder / "truth", load_kg=kg)
        write_csv(of, Style(torque=True), folder / f"{name}.csv")
    arm, empty = str(folder / "arm"), str(folder / "empty.csv")
    given = ["new", arm, "--log-only", "--urdf", str(urdf_of(of, folder)), empty]
    assert CliRunner().invoke(main, given).exit_code == 0
    for step in ("gap", "friction", "thresholds"):
        CliRunner().invoke(main, ["identify", step, "--config", arm, "--log", empty])
    return folder


def loaded(folder: Path, payload: str) -> Path:
    names = (folder / "empty.yaml").read_text()
    (folder / "loaded.yaml").write_text(names + payload)
    return folder / "loaded.csv"


def size(states: list[State]) -> float:
    """Residual of the shoulder [Nm]."""
    return float(np.sqrt(np.mean([s.residual[1] ** 2 for s in states[100:]])))


def test_a_load_that_is_not_stated_is_recognised_as_at_work(folder: Path) -> None:
    robot = load_robot(folder / "arm")
    states = foreign_states(loaded(folder, ""), robot)[1]
    found = [one.recognised.mass for one in states if one.recognised]
    assert len(found) > 0.1 * len(states)
    assert found[-1] == pytest.approx(LOAD_KG, rel=0.15)  # as docs state for a load
    news = [n.text for s in states for n in s.notices if "looks like a load" in n.text]
    assert any("`contactctl payload 0.4" in text for text in news)
    assert not any(s.recognised for s in foreign_states(folder / "empty.csv", robot)[1])


@pytest.mark.parametrize("payload", [f"payload: {LOAD_KG}\n", f"payload: {{mass: {LOAD_KG}}}\n"])
def test_a_load_that_is_stated_is_carried_and_taken_off_for_steps(
    folder: Path, payload: str
) -> None:
    robot = load_robot(folder / "arm")
    without = foreign_states(loaded(folder, ""), robot)[1]
    path = loaded(folder, payload)
    states = foreign_states(path, robot)[1]
    assert {s.payload.mass if s.payload else 0.0 for s in states} == {LOAD_KG}
    assert not any(s.recognised for s in states)
    assert size(states) < 0.2 * size(without)
    log, notes = read_aligned(path, robot.configuration, robot.model)
    assert notes[0].startswith("the hand carries 0.4 kg")
    assert size(over_log(log, robot)[1]) < 0.2 * size(without)


def test_a_load_that_no_arm_carries_is_refused(folder: Path) -> None:
    arm = str(folder / "arm")
    path = str(loaded(folder, "payload: -1\n"))
    result = CliRunner().invoke(main, ["replay", path, "--config", arm])
    assert result.exit_code == 65
    assert "payload" in result.output
