"""`contactd identify masses` and `payload` on logs: from a CSV to the model of every other part."""

import csv
import dataclasses
import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from msgspec.structs import replace

from bench.rigs.lockstep import ROMEO
from bench.study.masses import Subjects, carrying, true_bodies
from common.errors import ConfigurationError, ModelError
from daemon.config.evidence import outdated, parameters_missing
from daemon.config.identified import same_residuals, write_identified
from daemon.config.load import Robot, load_robot, parse_configuration
from daemon.config.worst_loads import worst_loads
from daemon.protocol.requests import SetPayload
from daemon.service.payloads import Payloads
from estimator.model import Model
from estimator.payload import Payload
from identification.limit_cycle import LimitCycle
from identification.motion_log import MotionLog
from programs.contactd.contactd import main
from programs.identify.measured import read_measured
from programs.identify.overview import overview
from programs.identify.steps.masses import masses_outcome

NOW = datetime(2026, 11, 23, tzinfo=UTC)
LOAD = Payload.of(0.4, [0.03, 0.02, -0.06])
Columns = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def subjects() -> Subjects:
    """An arm whose masses are 20 % and whose centres are 20 mm off."""
    return Subjects(1, (7, 0))


@pytest.fixture(scope="module")
def motion(subjects: Subjects) -> Columns:
    return columns(subjects.moved(subjects.arms, 24.0, seed=3)[0])


@pytest.fixture(scope="module")
def carried(subjects: Subjects) -> Columns:
    arm = carrying(subjects.arms[0], subjects.model, LOAD)
    return columns(subjects.moved([arm], 10.0, 4, 10.0, 10.0)[0])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROMEO, tmp_path / "arm"))


def columns(log: MotionLog) -> Columns:
    quantities = ("current", "link_position", "motor_velocity", "motor_position")
    named = {
        f"{quantity}.{joint}": getattr(log, quantity)[:, i]
        for quantity in quantities
        for i, joint in enumerate(log.joints)
    }
    return {"time": log.time_s, **named}


def identify(folder: Path, data: Columns, *step: str) -> Result:
    path = folder / "log.csv"
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(data)
        rows.writerows(zip(*data.values(), strict=True))
    words = ["identify", *step, "--config", str(folder), "--log", str(path)]
    return CliRunner().invoke(main, words)


def gravity_off(robot: Robot, subjects: Subjects) -> float:
    """Largest deviation of the estimator's gravity from the true arm's over some poses [Nm]."""
    c = robot.configuration
    true = Model(robot.urdf, c.joint_names, true_bodies(subjects.arms[0]))
    model = robot.model
    poses = np.random.default_rng(1).uniform(*subjects.limits, (50, len(c.joints)))
    return float(max(np.abs(model.gravity(q) - true.gravity(q)).max() for q in poses))


def test_masses_of_a_csv_become_the_model_of_every_part(folder, subjects, motion) -> None:
    before = load_robot(folder)
    result = identify(folder, motion, "masses")
    assert result.exit_code == 0, result.output
    assert "Nm by the URDF" in result.output
    assert "friction and thresholds depend on them" in result.output
    assert (folder / "arm.urdf").read_text() == (ROMEO / "arm.urdf").read_text()
    robot = load_robot(folder)
    c = robot.configuration
    assert robot.urdf == before.urdf
    assert gravity_off(robot, subjects) < 0.05 * gravity_off(before, subjects)
    loads = [load.gravity for load in worst_loads(c, robot.model)]
    assert loads != [load.gravity for load in worst_loads(before.configuration, before.model)]
    # A replay of what this daemon records has the same model.
    again = parse_configuration(robot.text, "recorded", robot.identified_text)
    assert again == c
    assert not same_residuals(c, before.configuration)


def test_new_masses_void_friction_and_thresholds_that_were_identified(folder, motion) -> None:
    assert identify(folder, motion, "friction").exit_code in (0, 1)
    robot = load_robot(folder)
    assert outdated("friction", robot.identified, robot.configuration, robot.urdf) == []
    known = [n for n, j in robot.identified.joints.items() if j.friction is not None]
    assert known
    for joint in (text := (folder / "config.yaml").read_text()).splitlines():
        if "known:" in joint:
            text = text.replace(joint + "\n", "")
    (folder / "config.yaml").write_text(text)
    assert identify(folder, motion, "masses").exit_code == 0
    robot = load_robot(folder)
    c, urdf = robot.configuration, robot.urdf
    assert set(known) <= set(outdated("friction", robot.identified, c, urdf))
    assert outdated("masses", robot.identified, c, urdf) == []
    missing = "; ".join(parameters_missing(robot.identified, c, urdf))
    assert "identified masses were changed" in missing
    row = overview(robot, NOW).cells["LElbowRoll"]
    assert row["masses"].good
    assert "kg, |r|" in row["masses"].text


def test_masses_of_an_arm_that_swings_are_not_used(folder, motion, monkeypatch) -> None:
    robot = load_robot(folder)
    assert identify(folder, motion, "masses", "--dry-run").exit_code == 0
    measured = read_measured([folder / "log.csv"], robot.configuration)
    swings = LimitCycle("LElbowRoll", 2.1, 0.02, 20.0, 0.8)
    monkeypatch.setattr("identification.limit_cycle.limit_cycles", lambda *_: [swings])
    # Another controller's log does not tell what was commanded.
    assert masses_outcome(robot, measured, "2026-11-23").entries
    commanded = dataclasses.replace(measured, reference=measured.log.link_position)
    outcome = masses_outcome(robot, commanded, "2026-11-23")
    assert outcome.entries == {}
    (bad,) = (line for line in outcome.lines if not line.good)
    assert (bad.joint, bad.verdict) == ("LElbowRoll", "swings by itself")
    assert "Set control.position_gain to 2" in bad.reason


def test_nothing_is_written_dry(folder, motion) -> None:
    before = (folder / "identified.yaml").read_bytes()
    assert identify(folder, motion, "masses", "--dry-run").exit_code == 0
    assert (folder / "identified.yaml").read_bytes() == before


def still(data: Columns, *joints: str) -> Columns:
    def stands(name: str, values: np.ndarray) -> np.ndarray:
        if not name.endswith(joints):
            return values
        return np.zeros_like(values) if "velocity" in name else np.full_like(values, values[0])

    return {name: stands(name, values) for name, values in data.items()}


def positions(data: Columns) -> Columns:
    return {name: values for name, values in data.items() if not name.startswith("motor_")}


E = "link_position.LElbowRoll"
ALL = tuple(f".{name}" for name in load_robot(ROMEO).configuration.joint_names)


@pytest.mark.parametrize(
    ("change", "status", "says"),
    [
        (lambda d: {k: v[:900] for k, v in d.items()}, 65, "too short: 9.0 s, at least 20 s"),
        (lambda d: {**d, "current.LElbowYaw": np.full(len(d["time"]), np.nan)}, 65,
         ":2: current.LElbowYaw is nan, not a number"),
        (lambda d: {k: v for k, v in d.items() if "LWristYaw" not in k}, 65,
         "no column current.LWristYaw"),
        (lambda d: {k.replace("LWrist", "RWrist"): v for k, v in d.items()}, 65,
         "no column current.LWristRoll"),
        (lambda d: still(d, *ALL), 1, "LShoulderPitch: fastest 0 rad/s, 0 reversals"),
        (lambda d: still(d, *ALL[1:]), 1, "LWristPitch: fastest 0 rad/s, 0 reversals"),
        (lambda d: {**d, "current.LElbowRoll": 1000.0 * d["current.LElbowRoll"]}, 65,
         "unit wrong by 1000 (mA"),
        (lambda d: {**d, "current.LElbowRoll": -d["current.LElbowRoll"]}, 1,
         "friction comes out as -0."),
        (lambda d: {**d, "current.LElbowRoll": 0.3 + 0.0 * d["time"]}, 1,
         "check column, sign and unit of the current"),
        (lambda d: positions({**d, "time": 2.0 * d["time"]}), 65, "with times multiplied by 0.5"),
        (lambda d: positions({**d, E: 0.5 * d[E]}), 65, "of LElbowRoll multiplied by 1.4"),
    ],
)  # fmt: skip
def test_what_shows_nothing_writes_nothing(folder, motion, change, status, says) -> None:
    before = (folder / "identified.yaml").read_bytes()
    for step in ("masses", "friction")[: 1 + ("multiplied" in says)]:
        result = identify(folder, change(motion), step)
        assert result.exit_code == status, result.output
        assert says in " ".join(result.output.split())
    assert (folder / "identified.yaml").read_bytes() == before


# --- loads ----------------------------------------------------------------------------------------


def test_a_load_is_written_by_its_name_and_set_by_it(folder, motion, carried) -> None:
    assert identify(folder, motion, "masses").exit_code == 0
    result = identify(folder, carried, "payload", "cup")
    assert result.exit_code == 0, result.output
    assert "`contactctl payload cup` once the daemon has taken it up" in " ".join(
        result.output.split()
    )
    robot = load_robot(folder)
    named = Payloads(robot).named["cup"]
    assert named.mass == pytest.approx(LOAD.mass, rel=0.01)
    assert named.com == pytest.approx(LOAD.com, abs=0.001)
    assert (folder / "config.yaml").read_text() == (ROMEO / "config.yaml").read_text()
    assert overview(robot, NOW).payloads["cup"].good
    assert CliRunner().invoke(main, ["identify", "--config", str(folder)]).output.count("cup") == 1
    # Another step leaves it there; other masses void it.
    assert identify(folder, motion, "masses").exit_code == 0
    assert "cup" in load_robot(folder).identified.payloads
    text = (folder / "identified.yaml").read_text()
    (folder / "identified.yaml").write_text(text.replace("mass: 1.", "mass: 1.0", 1))
    changed = load_robot(folder)
    assert "void" in overview(changed, NOW).payloads["cup"].text
    with pytest.raises(ModelError, match=r"cup was weighed before .* payload cup` again; until"):
        Payloads(changed).asked_for(SetPayload(name="cup"))


def test_without_masses_a_load_says_what_it_may_be_off(folder, carried) -> None:
    result = identify(folder, carried, "payload", "cup")
    assert "masses" in result.output
    identified = load_robot(folder).identified
    assert "cup" not in identified.payloads or identified.payloads["cup"].mass_error > 0.005


@pytest.mark.parametrize("name", ["none", "0.5", "-1e3", "", "a\tb", "x" * 65])
def test_a_name_that_means_something_else_is_refused_before_anything_is_read(folder, name) -> None:
    missing = str(folder / "missing.csv")
    words = ["identify", "payload", "--config", str(folder), "--log", missing, "--", name]
    result = CliRunner().invoke(main, words)
    assert isinstance(result.exception, ConfigurationError | SystemExit)
    assert "is no payload name" in result.output + str(result.exception)


@pytest.mark.parametrize(
    ("mass", "says"), [(2.5, "LWristPitch: the current was at its limit"), (0.7, "too heavy")]
)
def test_a_load_that_the_motors_cannot_hold_is_not_written(
    folder, subjects, motion, monkeypatch, mass, says
) -> None:
    """Seen by the current, or, where the motion did not ask so much, by poses within the limits."""
    if says == "too heavy":
        monkeypatch.setattr("identification.payload_fit.saturated", lambda cut: "")
    assert identify(folder, motion, "masses").exit_code == 0
    heavy = Payload.of(mass, [0.0, 0.0, -0.1])
    log = subjects.moved([carrying(subjects.arms[0], subjects.model, heavy)], 10.0, 4, 10.0)[0]
    result = identify(folder, columns(log), "payload", "anvil")
    assert result.exit_code == 1, result.output
    assert says in result.output
    assert "anvil" not in load_robot(folder).identified.payloads


def test_a_body_that_cannot_exist_is_refused_where_it_stands(folder, motion) -> None:
    assert identify(folder, motion, "masses").exit_code == 0
    robot = load_robot(folder)
    elbow = robot.identified.joints["LElbowRoll"]
    thin = replace(elbow.masses.body, inertia=(-0.1, 0.0, 0.0, 0.1, 0.0, 0.1))
    spoilt = replace(elbow, masses=replace(elbow.masses, body=thin))
    joints = robot.identified.joints | {"LElbowRoll": spoilt}
    write_identified(folder / "identified.yaml", replace(robot.identified, joints=joints))
    where = (
        r"identified\.yaml:\d+: .*body\.inertia: body of LElbowRoll: principal moments of -0\.1,"
    )
    with pytest.raises(ConfigurationError, match=where):
        load_robot(folder)


def test_the_model_is_built_in_one_place() -> None:
    """Elsewhere identified masses would be forgotten."""
    root = Path(__file__).parents[3]
    builders = {
        str(path.relative_to(root))
        for folder in ("daemon", "programs")
        for path in (root / folder).rglob("*.py")
        if " Model(" in path.read_text()
    }
    # A draft has nothing identified, and where a known force acts masses do not matter.
    assert builders == {
        "daemon/config/dynamics.py",
        "programs/contactd/drafts/configuration.py",
        "programs/identify/known_mass.py",
    }
