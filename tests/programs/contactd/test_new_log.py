"""Configurations for logs alone: columns guessed by name and content, and what cannot be run."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from bench.rigs.foreign_logs import Stranger, Style, stranger, urdf_of, write_csv
from common.errors import ConfigurationError
from daemon.config.load import load_robot
from daemon.drives import build_setups
from estimator.urdf import JointRange
from programs.contactd.drafts.log_arm import with_movable_joints
from programs.contactd.drafts.log_columns import guessed, named_columns
from programs.identify.csv_log import read_csv
from programs.identify.guesses import guessed_constants
from programs.identify.log_names import beside
from tests.programs.contactd.drafting import contactd

JOINTS = ["shoulder_pan_joint", "elbow_joint", "joint_3"]
STYLE = Style()


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return stranger(1, 30.0, tmp_path_factory.mktemp("stranger"))


def new(folder: Path, arm: Stranger, *logs: object) -> Result:
    """Result of `contactd new` for folder/arm, of folder/log.csv if no other logs are given."""
    given = ["--urdf", urdf_of(arm, folder), *(logs or [folder / "log.csv"])]
    return contactd("new", folder / "arm", "--log-only", *given)


def drafted(folder: Path, arm: Stranger, style: Style = STYLE) -> Result:
    """Result of `new` of a written log, which must succeed."""
    write_csv(arm, style, folder / "log.csv")
    result = new(folder, arm)
    assert result.exit_code == 0, result.output
    return result


def identify(step: str, folder: Path) -> Result:
    log, config = folder / "log.csv", folder / "arm"
    return contactd("identify", step, "--config", config, "--log", log)


def friction_of(folder: Path, joint: str) -> tuple[float, dict[str, float]]:
    """Identified Coulomb friction [Nm] of both sides of the gear, and the errors of its entry."""
    identified = load_robot(folder / "arm").identified
    entry = identified.joints[joint].friction if identified else None
    assert entry is not None
    return entry.friction.motor_coulomb + entry.friction.link_coulomb, entry.errors


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ("time,position.elbow_joint", {("", "time"): 0, ("elbow_joint", "link_position"): 1}),
        ("date_time,position.elbow_joint", {("elbow_joint", "link_position"): 1}),
        ("t,ElbowPos,ElbowMotorPos", {("elbow_joint", "link_position"): 1,
                                      ("elbow_joint", "motor_position"): 2}),
        ("stamp,q_0,q_1,q_2", {(name, "link_position"): k + 1 for k, name in enumerate(JOINTS)}),
        ("t,actual_qd_2,target_qd_2", {("elbow_joint", "motor_velocity"): 1,
                                       ("elbow_joint", "setpoint"): 2}),
        ("t,shoulder_pan_effort,shoulder_pan_temp,shoulder_pan_pos_error",
         {("shoulder_pan_joint", "torque"): 1}),
        ("t,effort[2],joint_3_iq", {("joint_3", "current"): 2, ("elbow_joint", "torque"): 1}),
    ],
)  # fmt: skip
def test_columns_are_guessed_by_their_names(header: str, found: dict[tuple[str, str], int]) -> None:
    columns = header.split(",")
    named = named_columns(columns, JOINTS)
    expected = {key: columns[k] for key, k in found.items()}
    assert {**named, ("", "time"): columns[0]} == {("", "time"): columns[0], **expected}


@pytest.mark.parametrize("degrees", [False, True])
def test_units_and_signs_are_guessed_by_the_numbers(
    tmp_path: Path, arm: Stranger, degrees: bool
) -> None:
    """Its motors count against its links, behind a gear of 50, in ms and mA."""
    path = write_csv(arm, Style(degrees=degrees), tmp_path / "log.csv")
    header = path.read_text().splitlines()[0]
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    for i, name in enumerate(header.split(",")):
        factor = {"motor": -50.0, "cur": -1000.0, "timestamp": 1000.0}
        rows[:, i] *= next((f for of, f in factor.items() if of in name), 1.0)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    result = new(tmp_path, arm)
    assert result.exit_code == 0, result.output
    assert beside(path).read_text() in result.output
    names = list(arm.log.joints)
    log, _ = read_csv(path, names, dict.fromkeys(names, 1.0))
    rows_of = [np.argmin(np.abs(arm.log.time_s - t)) for t in log.time_s[::50]]
    for name in ("link_position", "motor_velocity", "current"):
        measured = getattr(arm.log, name)[rows_of]
        error = np.abs(getattr(log, name)[::50] - measured).max(axis=0)
        assert (error < 0.03 * np.ptp(measured, axis=0)).all(), name
    assert log.motor_position is not None
    assert np.abs(log.motor_position - log.link_position).max() < 0.03
    robot = load_robot(tmp_path / "arm")
    constants = np.array([joint.torque_constant for joint in robot.configuration.joints])
    # The first joint turns about the vertical: nothing weighs there.
    assert constants[1:] == pytest.approx(arm.truth.torque_constant[1:], rel=0.05)


@pytest.mark.parametrize(("rate_Hz", "noise"), [(25.0, 0.0), (1000.0, 2e-5)])
def test_a_motor_that_swings_through_its_gap_is_not_taken_for_geared(
    rate_Hz: float, noise: float
) -> None:
    """It swings further than its link, too fast for 25 Hz; at 1 kHz a change is mostly noise."""
    t = np.arange(0.0, 20.0, 1.0 / rate_Hz)
    theta = 0.3 * np.sin(t) + 0.1 * np.sin(14.0 * t)
    theta_dot = 0.3 * np.cos(t) + 1.4 * np.cos(14.0 * t)
    q = 0.3 * np.sin(t) + 0.09 * np.sin(14.0 * t - 0.3)
    q = q + noise * np.random.default_rng(0).standard_normal(len(t))
    table = {"time": t, "link_position": np.degrees(q), "motor_position": np.degrees(theta),
             "motor_velocity": np.degrees(theta_dot), "current": q}  # fmt: skip
    named = {("elbow" if name != "time" else "", name): name for name in table}
    its = guessed(named, table, [JointRange("elbow", 1, lower=-1.5, upper=1.5)]).joints
    for name, unit in (("motor_position", "deg"), ("motor_velocity", "deg/s")):
        assert (its["elbow"][name].unit, its["elbow"][name].scale) == (unit, 1.0)


def test_a_velocity_that_follows_nothing_is_in_the_unit_of_the_others() -> None:
    """In rad/s among deg/s, its viscous friction was 57 times too small."""
    t = np.arange(0.0, 20.0, 0.02)
    table = {"time": t, "q": np.sin(t), "x": np.degrees(np.cos(t)), "i": t,
             "y": np.degrees(np.cos(t + 7.0 * np.sin(9.0 * t)))}  # fmt: skip
    ranges = [JointRange(name, 1, lower=-1.5, upper=1.5) for name in ("a", "b")]
    named = {("", "time"): "time", ("a", "motor_velocity"): "x", ("b", "motor_velocity"): "y"}
    for one in ("a", "b"):
        named |= {(one, "link_position"): "q", (one, "current"): "i"}
    its = guessed(named, table, ranges).joints
    assert [its[one]["motor_velocity"].unit for one in ("a", "b")] == ["deg/s", "deg/s"]
    assert "CHECK what it is" in its["b"]["motor_velocity"].doubt


def test_the_next_steps_name_no_log_in_which_the_arm_is_touched(
    tmp_path: Path, arm: Stranger
) -> None:
    assert "once columns and constants are right:" in drafted(tmp_path, arm).output
    log, touched, folder = tmp_path / "log.csv", tmp_path / "touched 1.csv", tmp_path / "arm"
    shutil.copy(log, touched)
    shutil.rmtree(folder)
    said = new(tmp_path, arm, log, touched).output
    assert "and --log LOG added for other logs without a touch:" in said
    assert f"--config {folder} --log {log}\n" in said
    assert f"contactd replay '{touched}' --config {folder}" in said
    assert f"--log '{touched}'" not in said


def test_lengths_in_mm_are_named_before_a_step_breaks(tmp_path: Path, arm: Stranger) -> None:
    log, urdf = write_csv(arm, Style(), tmp_path / "log.csv"), urdf_of(arm, tmp_path)
    text = re.sub(r'(<origin xyz="[\d.]+ [\d.]+ )([\d.]+)', r"\1\g<2>e3", urdf.read_text())
    urdf.write_text(text)
    result = contactd("new", tmp_path / "arm", "--log-only", "--urdf", urdf, log)
    assert result.exit_code == 78, result.output
    assert "lengths in m?" in result.output
    assert not (tmp_path / "arm").exists()
    assert not beside(log).exists()


def test_torques_need_no_constant(tmp_path: Path, arm: Stranger) -> None:
    drafted(tmp_path, arm, Style(torque=True, without=("vel", "motor_pos")))
    c = load_robot(tmp_path / "arm").configuration
    assert {joint.torque_constant for joint in c.joints} == {1.0}
    assert {joint.half_gap for joint in c.joints} == {0.0}
    assert c.estimator.motor_position == "integrated"
    friction = identify("friction", tmp_path).output
    assert "no motor_velocity of base" in friction
    assert "good" in friction


def test_a_large_constant_that_gravity_confirms_passes_the_check(
    tmp_path: Path, arm: Stranger
) -> None:
    """32 Nm/A, as of an industrial arm whose gear is in it."""
    truth = replace(arm.truth, torque_constant=np.full(len(arm.log.joints), 32.0))
    log = replace(arm.log, current=arm.log.current * arm.truth.torque_constant / 32.0)
    drafted(tmp_path, replace(arm, truth=truth, log=log))
    constants = [j.torque_constant for j in load_robot(tmp_path / "arm").configuration.joints]
    assert constants[1:] == pytest.approx([32.0] * (len(constants) - 1), rel=0.05)
    assert contactd("check", tmp_path / "arm").exit_code == 0


def test_a_joint_without_a_torque_moves_in_the_model(tmp_path: Path, arm: Stranger) -> None:
    """Fixed at 0, it would bend the gravity of all others: 0.33 Nm of friction for 0.51."""
    write_csv(arm, Style(torque=True), tmp_path / "log.csv")
    header, *rows = (line.split(",") for line in (tmp_path / "log.csv").read_text().splitlines())
    left = [k for k, name in enumerate(header) if name != "elbow_tau"]
    lines = [",".join(row[k] for k in left) for row in (header, *rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    assert new(tmp_path, arm).exit_code == 0
    assert "torque: {value: 0}" in beside(tmp_path / "log.csv").read_text()
    identify("gap", tmp_path)
    identify("friction", tmp_path)
    assert friction_of(tmp_path, "shoulder")[0] == pytest.approx(arm.friction[1], rel=0.1)
    identified = load_robot(tmp_path / "arm").identified
    elbow = identified.joints.get("elbow") if identified else None
    assert elbow is None or (elbow.friction is None and elbow.gap is None)


def test_noise_of_fast_samples_makes_no_torque_seem_too_small(tmp_path: Path) -> None:
    """Their accelerations are mostly noise: links showed 1 / 1.6 of themselves."""
    of = stranger(5002, 30.0, tmp_path / "truth")
    drafted(tmp_path, of, Style(rate_Hz=200.0, torque=True))
    assert "scale" not in beside(tmp_path / "log.csv").read_text()


def test_masses_that_are_off_scale_no_torque(tmp_path: Path) -> None:
    """They were 1.1, 1.4 and 1.6 times those at the links, and friction with them, as `good`."""
    of = stranger(1000, 30.0, tmp_path / "truth", by_urdf=False)
    drafted(tmp_path, of, Style(torque=True))
    names = beside(tmp_path / "log.csv").read_text()
    assert "CHECK: 1.4" in names
    assert "scale" not in names


def test_ten_samples_a_second_make_a_configuration(tmp_path: Path, arm: Stranger) -> None:
    drafted(tmp_path, arm, Style(rate_Hz=10.0))
    assert "log faster" in identify("friction", tmp_path).output


def test_a_configuration_for_logs_cannot_be_run_or_simulated(tmp_path: Path, arm: Stranger) -> None:
    drafted(tmp_path, arm)
    with pytest.raises(ConfigurationError, match="`make: log` has no drives"):
        build_setups(load_robot(tmp_path / "arm"))
    for words in (["run"], ["simulate", "--write-truth"]):
        assert contactd(*words, tmp_path / "arm").exit_code == 78


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ("", "empty: it has no"),
        ("a,b", "no column has the name of a time"),
        ("time,base_pos,elbow_cur", "no joint of arm.urdf (base, shoulde"),
        ("time,base_pos,base_cur\n", "too short: 0 samples, at least 100"),
        ("time,base_pos,base_cur\n1,2,nan", "log.csv:2: base_cur is nan"),
        ("time,base_pos,base_cur,base_pos", "duplicate columns base_pos"),
        ("time,base_pos,base_cur", "time does not grow at sample 1"),
        ("time;base_pos;base_cur", "log.csv:1: fields are separated by ';', allowed are commas"),
        ("time,base_pos,base_cur\n1,off,3", "log.csv:2: base_pos is 'off': not a number"),
    ],
)
def test_a_log_that_cannot_be_read_is_refused_and_nothing_is_left(
    tmp_path: Path, arm: Stranger, columns: str, says: str
) -> None:
    path = tmp_path / "log.csv"
    row = "\n" + ",".join("12345"[: columns.partition("\n")[0].count(",") + 1])
    path.write_text(columns + row * 130 * (columns[-1:] not in ("", "\n")))
    result = new(tmp_path, arm)
    assert result.exit_code == 65
    assert says in result.output
    assert {one.name for one in tmp_path.iterdir()} == {"log.csv", "arm.urdf"}


def test_joints_that_are_not_in_the_log_are_fixed() -> None:
    urdf = """<robot name="a"><link name="b"/><link name="c"/><link name="d"/>
      <joint name="x" type="continuous"><parent link="b"/><child link="c"/></joint>
      <joint name="y" type="prismatic"><parent link="c"/><child link="d"/>
        <limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""
    text, changes = with_movable_joints(urdf, ["x"])
    assert [change.split(":")[0] for change in changes] == ["x", "y"]
    assert 'type="fixed"' in text
    assert 'type="revolute"' in text
    assert text.count("<limit") == 1
    assert with_movable_joints(text, ["x"]) == (text, [])


def test_contradictory_options_are_refused(tmp_path: Path) -> None:
    for more in (["--log-only"], ["log.csv"], ["--log-only", "--drive", "damiao:DM4340", "a.csv"]):
        result = contactd("new", tmp_path / "arm", "--urdf", "a", *more)
        assert result.exit_code == 2, more


def test_late_columns_do_not_change_the_friction(tmp_path: Path, arm: Stranger) -> None:
    """As right as of one whose columns are not; else a wider gap, or masses, were named."""
    found = []
    for late in ({}, {"motor_velocity": 0.008, "current": -0.006}):
        folder = tmp_path / str(len(found))
        folder.mkdir()
        drafted(folder, arm, Style(late_s=late))
        said = identify("friction", folder).output
        assert ("motor_velocity of elbow +8." in said) == bool(late)
        found.append([friction_of(folder, name)[0] for name in ("shoulder", "elbow", "forearm")])
    assert found[1] == pytest.approx(found[0], rel=0.05)
    assert found[0] == pytest.approx(arm.friction[1:4].tolist(), rel=0.08)


def test_exchanged_columns_are_named_by_every_step(tmp_path: Path, arm: Stranger) -> None:
    """They came out as torque constants that are off."""
    drafted(tmp_path, arm)
    log = tmp_path / "log.csv"
    header, rows = log.read_text().split("\n", 1)
    columns = {"shoulder_cur": "elbow_cur", "elbow_cur": "shoulder_cur"}
    exchanged = ",".join(columns.get(name, name) for name in header.split(","))
    log.write_text(f"{exchanged}\n{rows}")
    results = [identify(step, tmp_path) for step in ("friction", "masses", "thresholds")]
    shutil.rmtree(tmp_path / "arm")
    for result in (*results, new(tmp_path, arm)):
        assert result.exit_code == 65, result.output
        assert re.search(r"shoulder\s+and\s+elbow.*\sexchange\s", result.output, re.DOTALL)


def test_a_constant_off_everywhere_widens_the_error_where_there_is_no_gravity(
    tmp_path: Path, arm: Stranger
) -> None:
    """Effective currents in the place of peaks: the base turns about the vertical."""
    drafted(tmp_path, arm)
    config = tmp_path / "arm" / "config.yaml"
    constants = iter(0.707 * arm.truth.torque_constant)
    new = re.sub(r"torque_constant: .*", lambda _: f"torque_constant: {next(constants):.6g}",
                 config.read_text())  # fmt: skip
    config.write_text(new)
    identify("friction", tmp_path)
    found, errors = friction_of(tmp_path, "base")
    assert found < 0.8 * arm.friction[0]
    assert abs(found - arm.friction[0]) < 2.0 * 1.96 * errors["K_theta_s"]


def test_a_constant_guessed_by_the_urdfs_masses_cannot_confirm_them(tmp_path: Path) -> None:
    of = stranger(1000, 30.0, tmp_path / "truth", by_urdf=False)
    drafted(tmp_path, of)
    config = tmp_path / "arm" / "config.yaml"
    assert guessed_constants(load_robot(config)).tolist() == [np.inf, 0.2, 0.2, 0.2]
    refused = identify("masses", tmp_path)
    assert refused.exit_code == ConfigurationError.exit_code
    assert "joints[0] (base).torque_constant: guessed" in refused.output
    answer = identify("friction", tmp_path).output
    assert "torque constant unknown" in answer
    assert "not written: base" in answer
    friction, errors = friction_of(tmp_path, "forearm")
    assert errors["K_theta_s"] > 0.2 * friction
    config.write_text(re.sub("(torque_constant: [^#]*)# CHECK.*", r"\1", config.read_text()))
    assert not guessed_constants(load_robot(config)).any()
    (torques := tmp_path / "torques").mkdir()
    drafted(torques, of, Style(torque=True))
    assert not guessed_constants(load_robot(torques / "arm")).any()
