"""The page "From a log to an answer": its commands, typed in their order at logs of a stranger's
arm, with the names, units and skew of another program."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bench.logs import look_up
from bench.rigs.foreign_logs import Style, stranger, urdf_of, write_csv
from common.arrays import Vector
from daemon.config.load import load_robot
from programs.contactd.contactd import main

PAGE = Path(__file__).parents[2] / "docs" / "logs.md"
STYLE = Style(degrees=True, jitter=0.1, late_s={"motor_velocity": 0.004})
TOUCH_S, LASTS_S, TOUCH = 20.0, 1.0, 1.5  # at the elbow [Nm]


def touch(t: float, q: Vector, q_dot: Vector) -> Vector:
    torque = np.zeros_like(q)
    torque[2] = TOUCH if TOUCH_S < t < TOUCH_S + LASTS_S else 0.0
    return torque


def typed(line: str) -> Result:
    return CliRunner().invoke(main, shlex.split(line)[1:])


def test_the_page_from_a_csv_to_levels_and_a_touch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    quiet = stranger(1, 60.0, tmp_path / "truth")
    touched = stranger(1, 60.0, tmp_path / "truth", touch)
    write_csv(quiet, STYLE, urdf_of(quiet, tmp_path).with_name("work.csv"))
    write_csv(touched, STYLE, tmp_path / "touched.csv")
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    commands = [line.strip() for line in lines if line.startswith("    contactd ")]
    assert len(commands) <= 10
    output = {}
    for line in commands:
        result = typed(line)
        output[line.split()[1] if "identify" not in line else line.split()[2]] = result.output
        if line.startswith("contactd new"):  # the page asks for it
            look_up(
                tmp_path / "my_arm" / "config.yaml", quiet, np.random.default_rng(1), torque=False
            )
        # Of a step that refuses one joint the others count.
        assert result.exit_code <= ("identify" in line), f"{line}\n{result.output}"
    assert "motor_velocity of elbow +4." in output["friction"]
    robot = load_robot(tmp_path / "my_arm")
    assert robot.identified is not None
    found = robot.identified.joints
    gap, friction = found["base"].gap, found["elbow"].friction
    assert gap is not None
    assert gap.half_gap == pytest.approx(quiet.truth.half_gap[0], abs=gap.confidence)
    assert friction is not None
    total = friction.friction.motor_coulomb + friction.friction.link_coulomb
    assert total == pytest.approx(quiet.friction[2], rel=0.1)
    assert robot.configuration.joints[2].thresholds.contact < TOUCH
    (contact,) = [
        one for one in output["replay"].splitlines() if " elbow  " in one and " s " in one
    ]
    assert float(contact.replace("contacts", "").split()[1]) == pytest.approx(TOUCH_S, abs=0.3)
    for name in ("touched.html", "levels.html"):
        assert (tmp_path / name).stat().st_size > 10_000
