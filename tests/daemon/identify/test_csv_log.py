"""Logs of anybody's arm: only the columns that a step needs, at times that are not even."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import SINGLE_JOINT
from daemon.commands.contactd import main
from daemon.identify.csv_log import read_csv
from errors import LogError

T = 0.01


def save(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return path


def pressed(alpha: float) -> dict[str, np.ndarray]:
    """A hand that leads a link from border to border of its gap while the motor stands."""
    t = T * np.arange(2400)
    phi = alpha * np.clip(3.0 * np.sin(2.0 * np.pi * t / 1.2), -1.0, 1.0)
    return {
        "time": t,
        "link_position.joint": phi,
        "motor_position.joint": np.zeros_like(t),
        "torque.joint": -np.sign(phi) * (np.abs(phi) > 0.95 * alpha),
        "weather": np.zeros_like(t),
    }


def test_a_gap_needs_two_positions_and_a_torque(tmp_path: Path) -> None:
    path = save(tmp_path / "log.csv", pressed(0.02))
    given = ["--config", str(SINGLE_JOINT), "--log", str(path), "--dry-run"]
    result = CliRunner().invoke(main, ["identify", "gap", "joint", *given])
    assert result.exit_code == 0, result.output
    assert "alpha 20.00 mrad" in result.output
    friction = CliRunner().invoke(main, ["identify", "friction", *given])
    assert friction.exit_code != 0
    assert "no column motor_velocity.joint" in friction.output


@pytest.mark.parametrize("without", ["link_position.joint", "motor_position.joint", "torque.joint"])
def test_what_a_gap_needs_is_asked_for(tmp_path: Path, without: str) -> None:
    columns = pressed(0.02)
    del columns[without]
    path = save(tmp_path / "log.csv", columns)
    name = "current.joint" if without.startswith("torque") else without
    with pytest.raises(LogError, match=f"no column.*{name}"):
        read_csv(path, ["joint"], {"joint": 3.0}, of_gap=True)


def test_other_joints_need_not_be_in_the_log_of_a_gap(tmp_path: Path) -> None:
    path = save(tmp_path / "log.csv", pressed(0.02))
    log, notes = read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
    assert log.joints == ("joint",)
    assert notes == ()
    np.testing.assert_allclose(np.abs(log.current).max(), 0.5)


def test_a_clock_that_jitters_is_resampled_and_said(tmp_path: Path) -> None:
    columns = pressed(0.02)
    rng = np.random.default_rng(1)
    uneven = columns["time"] + rng.uniform(-0.4, 0.4, len(columns["time"])) * T
    columns["time"] = np.where(np.arange(len(uneven)) >= 1200, uneven + 20.0, uneven)
    columns["link_position.joint"] = np.sin(uneven)
    log, notes = read_csv(save(tmp_path / "a.csv", columns), ["joint"], {"joint": 1.0}, of_gap=True)
    (note,) = notes
    assert note.startswith("times jitter by ")
    assert "resampled every" in note
    first, second = log.stretches(1.0)  # the pause is left as it is
    for rows, late in ((first, 0.0), (second, 20.0)):
        steps = np.diff(log.time_s[rows])
        np.testing.assert_allclose(steps, log.period_s, rtol=1e-6)
        true = np.sin(log.time_s[rows] - late)
        np.testing.assert_allclose(log.link_position[rows, 0], true, atol=1e-4)


def test_rounded_times_are_said(tmp_path: Path) -> None:
    columns = pressed(0.02)
    columns["time"] = np.round(columns["time"] * 0.4, 2)
    log, notes = read_csv(save(tmp_path / "a.csv", columns), ["joint"], {"joint": 1.0}, of_gap=True)
    assert notes == ("times are rounded to 10 ms: spread evenly",)
    np.testing.assert_allclose(np.diff(log.time_s), log.period_s, rtol=1e-6)
