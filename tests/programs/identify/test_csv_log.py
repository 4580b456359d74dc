"""Logs of anybody's arm: only the columns that a step needs, at times that are not even."""

import gzip
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from mcap.writer import Writer

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from common.errors import ConfigurationError, LogError
from daemon.config.identified import GapEntry
from daemon.config.load import load_robot, refuse_unreadable
from programs.contactd.contactd import main
from programs.identify.csv_log import read_csv

DATA = Path(os.environ.get("CONTACTD_DATA", Path(__file__).parents[4] / "shared" / "data"))
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
    assert "no motor_velocity of joint: derived from the position" in friction.output


def test_degrees_are_no_radians_and_void_no_configuration(tmp_path: Path) -> None:
    """A half-gap that no configuration takes: a daemon would not begin with it."""
    columns = pressed(0.02)
    columns["link_position.joint"] = np.degrees(columns["link_position.joint"])
    path = save(tmp_path / "log.csv", columns)
    folder = shutil.copytree(SINGLE_JOINT.parent, tmp_path / "configs") / "single_joint"
    before = (folder / "identified.yaml").read_bytes()
    given = ["--config", str(folder), "--log", str(path)]
    result = CliRunner().invoke(main, ["identify", "gap", "joint", *given])
    assert result.exit_code != 0, result.output
    assert "alpha 1.15e+03 mrad, at most 500 mrad: positions in another unit" in result.output
    assert (folder / "identified.yaml").read_bytes() == before


def test_one_encoder_behind_both_columns_is_no_error_of_the_program(tmp_path: Path) -> None:
    """Apart by rounding alone: the picture had no room for its bins."""
    columns = pressed(0.02)
    columns["motor_position.joint"] = columns["link_position.joint"]
    path = save(tmp_path / "log.csv", columns)
    path.with_suffix(".yaml").write_text(
        "joints: {joint: {link_position: {column: link_position.joint}, motor_position: {column: "
        "motor_position.joint, offset: 0.0158}, torque: {column: torque.joint}}}\n"
    )
    folder = shutil.copytree(SINGLE_JOINT.parent, tmp_path / "configs") / "single_joint"
    given = ["--config", str(folder), "--log", str(path)]
    result = CliRunner().invoke(main, ["identify", "gap", "joint", *given])
    assert result.exit_code == 1, result.output
    assert "link and motor position are the same signal" in result.output
    assert "gap-joint.png" in result.output


def test_several_logs_are_one_run_of_work(tmp_path: Path) -> None:
    """Neither alone has crossings enough; the second has half the rate."""
    columns, folder = pressed(0.02), tmp_path / "configs" / "single_joint"
    shutil.copytree(SINGLE_JOINT.parent, folder.parent)
    parts = slice(0, 800), slice(800, 1600, 2)
    paths = [save(tmp_path / f"{k}.csv", {name: x[rows] for name, x in columns.items()})
             for k, rows in enumerate(parts)]  # fmt: skip
    given = ["identify", "gap", "joint", "--config", str(folder), "--log", str(paths[0])]
    alone = CliRunner().invoke(main, given)
    assert "too few crossings" in alone.output
    both = CliRunner().invoke(main, [*given, "--log", str(paths[1])])
    assert both.exit_code == 0, both.output
    assert "alpha 20." in both.output
    assert "logs at several rates: all resampled to 20 ms" in both.output


def test_what_would_not_be_read_again_is_not_written() -> None:
    robot = load_robot(SINGLE_JOINT)
    assert robot.identified is not None
    refuse_unreadable(robot, robot.identified)
    entries = robot.identified.joints["joint"]
    wide = GapEntry(date="2026-01-01", log="", half_gap=1.1, confidence=0.0)
    joints = {"joint": msgspec.structs.replace(entries, gap=wide)}
    found = msgspec.structs.replace(robot.identified, joints=joints)
    with pytest.raises(ConfigurationError, match=r"not written.*half_gap: must be .* at most 0.5"):
        refuse_unreadable(robot, found)


@pytest.mark.parametrize("without", ["link_position.joint", "motor_position.joint", "torque.joint"])
def test_what_a_gap_needs_is_asked_for(tmp_path: Path, without: str) -> None:
    columns = pressed(0.02)
    del columns[without]
    path = save(tmp_path / "log.csv", columns)
    name = "current.joint" if without.startswith("torque") else without
    with pytest.raises(LogError, match=f"no column.*{name}"):
        read_csv(path, ["joint"], {"joint": 3.0}, of_gap=True)


def test_a_column_that_is_missing_comes_with_what_to_write_instead(tmp_path: Path) -> None:
    columns = pressed(0.02)
    del columns["torque.joint"]
    path = save(tmp_path / "log.csv", columns)
    with pytest.raises(LogError, match=r"torque\.joint \[Nm\] suffices.*log\.yaml"):
        read_csv(path, ["joint"], {"joint": 3.0}, of_gap=True)


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_times_of_day_are_times(tmp_path: Path, zone: str) -> None:
    """Also over midnight."""
    columns = pressed(0.02)
    begun = np.datetime64("2026-05-31T23:59:50.000000")
    stamps = begun + np.round(1e6 * columns["time"]).astype("timedelta64[us]")
    names = list(columns)
    lines = [",".join(names)]
    lines += [
        ",".join([f"{stamp}{zone}", *(f"{columns[name][k]:.9g}" for name in names[1:])])
        for k, stamp in enumerate(stamps)
    ]
    path = tmp_path / "log.csv"
    if zone == "Z":  # the same time by a clock that was put forward
        forward = lines[-1].replace("2026-06-01T00:", "2026-06-01T02:")
        assert forward != lines[-1]
        lines[-1] = forward.replace("Z", "+02:00")
    path.write_text("\n".join(lines) + "\n")
    log, notes = read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
    assert notes == ()
    np.testing.assert_allclose(log.time_s - log.time_s[0], columns["time"], atol=1e-5)


def test_gaps_of_a_log_that_lacks_one_joint_are_not_written(tmp_path: Path) -> None:
    """The first joint has all it needs; its answer alone would be half of what was asked."""
    arm = shutil.copytree(ROMEO, tmp_path / "arm")
    first, second = load_robot(arm).configuration.joint_names[:2]
    before = (arm / "identified.yaml").read_bytes()
    columns = {name.replace("joint", first): rows for name, rows in pressed(0.02).items()}
    path = save(tmp_path / "log.csv", columns)
    words = ["identify", "gap", first, second, "--config", str(arm), "--log", str(path)]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 65, result.output
    assert f"no column current.{second}" in " ".join(result.output.split())
    assert "alpha" not in result.output
    assert (arm / "identified.yaml").read_bytes() == before


def test_other_joints_need_not_be_in_the_log_of_a_gap(tmp_path: Path) -> None:
    path = save(tmp_path / "log.csv", pressed(0.02))
    log, notes = read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
    assert log.joints == ("joint",)
    assert notes == ()
    np.testing.assert_allclose(np.abs(log.current).max(), 0.5)


def test_setpoints_are_read_where_there_are_any(tmp_path: Path) -> None:
    columns = pressed(0.02)
    columns |= {"motor_velocity.joint": np.zeros_like(columns["time"])}
    without, _ = read_csv(save(tmp_path / "log.csv", columns), ["joint"], {"joint": 2.0})
    assert without.setpoint is None
    columns["time"] = columns["time"] + 0.4 * T * np.sin(np.arange(len(columns["time"])))
    columns["asked"] = 60.0 * np.sin(columns["time"])
    path = save(tmp_path / "log.csv", columns)
    names = [f"{name}: {{column: {name}.joint}}" for name in ("link_position", "torque")]
    names += ["motor_velocity: {column: motor_velocity.joint}"]
    names += ["setpoint: {column: asked, unit: deg/s}"]
    text = "\n    ".join(["joints:\n  joint:", *names])
    path.with_suffix(".yaml").write_text(text + "\n")
    log, notes = read_csv(path, ["joint"], {"joint": 2.0})
    assert "resampled" in notes[0]
    assert log.setpoint is not None
    np.testing.assert_allclose(log.setpoint[:, 0], np.pi / 3.0 * np.sin(log.time_s), atol=1e-3)


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


def test_rows_logged_twice_are_left_out_and_move_no_others(tmp_path: Path) -> None:
    """Spread evenly, the times beside a hole would move by as much as it is long."""
    columns = pressed(0.02)
    there = np.arange(2400)
    there = np.sort(np.concatenate([there[(there % 800 < 700)], [50, 51, 1000]]))
    columns = {name: values[there] for name, values in columns.items()}
    log, notes = read_csv(save(tmp_path / "a.csv", columns), ["joint"], {"joint": 1.0}, of_gap=True)
    assert notes == ("3 rows repeat the time of the row before: left out",)
    np.testing.assert_allclose(log.time_s, np.unique(columns["time"]))


def moving() -> dict[str, np.ndarray]:
    """A joint that moves, then stands for 3 s, and moves on."""
    t = T * np.arange(1200)
    q = np.sin(2.0 * np.pi * np.where(t < 5.0, t, np.maximum(t - 3.0, 5.0)))
    names = ("link_position", "motor_position", "motor_velocity", "current")
    return {"time": t} | {f"{name}.joint": q for name in names}


@pytest.mark.parametrize(
    ("rows", "period", "note"),
    [(np.repeat(np.arange(1200), 2), 0.0, "1200 rows repeat the time of the row before"),
     (np.repeat(np.arange(1200), 2), 0.005, "1200 rows repeat the values of the row before"),
     (np.repeat(np.arange(1200), 5), 0.002, "4800 rows repeat the values of the row before")],
)  # fmt: skip
def test_rows_that_only_repeat_another_are_left_out(
    tmp_path: Path, rows: np.ndarray, period: float, note: str
) -> None:
    """Written twice, or at 200 or 500 Hz what is measured at 100."""
    columns = {name: values[rows] for name, values in moving().items()}
    if period:
        columns["time"] = period * np.arange(len(rows))
    log, notes = read_csv(save(tmp_path / "a.csv", columns), ["joint"], {"joint": 1.0})
    assert notes == (f"{note}: left out",)
    np.testing.assert_allclose(log.time_s, moving()["time"])
    np.testing.assert_allclose(log.link_position[:, 0], moving()["link_position.joint"], atol=1e-8)


def test_a_joint_that_stands_at_times_holds_no_rows(tmp_path: Path) -> None:
    log, notes = read_csv(save(tmp_path / "a.csv", moving()), ["joint"], {"joint": 1.0})
    assert notes == ()
    assert len(log.time_s) == 1200


def test_a_current_in_milliamperes_is_no_wide_interval(tmp_path: Path) -> None:
    columns = pressed(0.02)
    columns["torque.joint"] = 1000.0 * columns["torque.joint"]
    path = save(tmp_path / "log.csv", columns)
    given = ["--config", str(SINGLE_JOINT), "--log", str(path), "--dry-run"]
    result = CliRunner().invoke(main, ["identify", "gap", "joint", *given])
    assert result.exit_code != 0, result.output
    assert "no clear dead zone" in result.output
    assert "another unit" in " ".join(result.output.split())


def renamed(folder: Path, names: str) -> Path:
    """The log of a hand under another program's names and units, and a file of names beside it."""
    ours = pressed(0.02)
    theirs = {
        "T [ms]": 1e3 * ours["time"],
        "out": np.degrees(ours["link_position.joint"]) + 10.0,
        "tau": 1e3 * ours["torque.joint"],
        "nr": np.where(np.arange(len(ours["time"])) < 100, 7.0, 101.0),
    }
    (folder / "theirs.yaml").write_text(names)
    return save(folder / "theirs.csv", theirs)


NAMES = """
time: {column: "T [ms]", unit: ms}
rows: {column: nr, least: 100}
joints:
  joint:
    link_position: {column: out, unit: deg, offset: -0.17453292519943295}
    motor_position: {value: 0}
    torque: {column: tau, unit: mNm}
"""


def test_names_and_units_of_others_are_stated_beside_the_log(tmp_path: Path) -> None:
    path = renamed(tmp_path, NAMES)
    ours = pressed(0.02)
    log, _ = read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
    np.testing.assert_allclose(log.time_s, ours["time"][100:], atol=1e-9)
    np.testing.assert_allclose(
        log.link_position[:, 0], ours["link_position.joint"][100:], atol=1e-8
    )
    np.testing.assert_allclose(log.current[:, 0], ours["torque.joint"][100:] / 2.0, atol=1e-9)
    assert log.motor_position is not None
    assert not log.motor_position.any()
    given = ["--config", str(SINGLE_JOINT), "--log", str(path), "--dry-run"]
    result = CliRunner().invoke(main, ["identify", "gap", "joint", *given])
    assert result.exit_code == 0, result.output
    assert "alpha 20.0" in result.output


def test_a_motor_position_that_is_assumed_is_named_as_such(tmp_path: Path) -> None:
    names = """joints:
  joint:
    link_position: {column: link_position.joint}
    motor_position: {value: 2, unit: deg}
    torque: {column: torque.joint}
"""
    path = save(tmp_path / "log.csv", pressed(0.02))
    path.with_suffix(".yaml").write_text(names)
    _, (note,) = read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
    assert "assumed in log.yaml" in note
    assert "motor_position.joint 0.0349066 rad" in note


def test_a_real_log_of_others_by_its_names(tmp_path: Path) -> None:
    """An output that is clamped: its position is one value."""
    real = DATA / "cycloid" / "base_runin1.csv.gz"
    if not real.exists():
        pytest.skip(f"no real measurements at {DATA} (set CONTACTD_DATA)")
    path = tmp_path / "ramps.csv"
    path.write_bytes(gzip.decompress(real.read_bytes()))
    (tmp_path / "ramps.yaml").write_text(
        "time: {column: TIME}\nrows: {column: test_nr, least: 100}\njoints: {joint: {"
        "link_position: {value: 0}, motor_position: {column: POSITION, unit: turn}, "
        "torque: {column: TORQUE}}}\n"
    )
    given = ["--config", str(SINGLE_JOINT), "--log", str(path), "--dry-run"]
    result = CliRunner().invoke(main, ["identify", "gap", "joint", *given])
    assert result.exit_code == 0, result.output
    (alpha,) = re.findall(r"alpha ([\d.]+) mrad", result.output)
    assert float(alpha) == pytest.approx(32.5, abs=1.5)
    assert "times are rounded to" in result.output


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("column: out", "column: inn", "link_position.joint: no column inn in .*there are T"),
        ("column: nr", "column: no", "rows: no column no in"),
        ("unit: deg", "unit: rpm", "joints.joint.link_position: unit 'rpm', allowed are rad, mrad"),
        ("unit: mNm", "unit: mNm, scale: 0", "torque: scale 0.0.* not 0"),
        (
            "{value: 0}",
            "{value: 0, column: out}",
            "motor_position: give either a column or a value",
        ),
        ("{value: 0}", "{}", "give either a column or a value"),
        ("torque:", "tork:", "theirs.yaml:8: joints.joint: unknown key `tork`"),
        ("unit: ms", "unit: ms, units: s", "unknown key `units`"),
        ("joints:", "joint:", "theirs.yaml"),
        ("rows: {", "rows: [", "theirs.yaml:3"),
        ("least: 100", "least: 1000", "it contains no samples"),
    ],
)
def test_a_file_of_names_that_is_wrong_is_reported_where(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    path = renamed(tmp_path, NAMES.replace(old, new))
    with pytest.raises(LogError, match=says):
        read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)


OF_A_TOPIC = """
topic: /arm
time: {column: stamp, unit: ms}
joints:
  joint:
    link_position: {column: "position[0]"}
    motor_position: {column: motor.angle, unit: mrad}
    torque: {column: "effort[0]"}
"""


def mcap(path: Path, messages: list[dict[str, object]], encoding: str = "json") -> Path:
    """An MCAP of another program: a topic /arm, and another of which nothing is needed."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "another")
        arm = writer.register_channel("/arm", encoding, 0)
        other = writer.register_channel("/weather", "cdr", 0)
        for k, message in enumerate(messages):
            writer.add_message(other, k, b"\x00\x01", k)
            writer.add_message(arm, k, json.dumps(message).encode(), k)
        writer.finish()
    return path


def messages_of(columns: dict[str, np.ndarray]) -> list[dict[str, object]]:
    rows = zip(*(columns[name].tolist() for name in list(columns)[:4]), strict=True)
    return [
        {"stamp": 1e3 * t, "position": [q, 7.0], "motor": {"angle": 1e3 * theta}, "effort": [tau]}
        for t, q, theta, tau in rows
    ]


def test_an_mcap_of_another_program_with_names_beside_it(tmp_path: Path) -> None:
    path = mcap(tmp_path / "log.mcap", messages_of(pressed(0.02)))
    given = ["identify", "gap", "joint", "--config", str(SINGLE_JOINT), "--log", str(path)]
    unnamed = CliRunner().invoke(main, [*given, "--dry-run"])
    assert "not a recording of contactd" in unnamed.output
    (tmp_path / "log.yaml").write_text(OF_A_TOPIC)
    result = CliRunner().invoke(main, [*given, "--dry-run"])
    assert result.exit_code == 0, result.output
    assert "alpha 20.00 mrad" in result.output


def without_effort(messages: list[dict[str, object]]) -> None:
    del messages[9]["effort"]


@pytest.mark.parametrize(
    ("names", "change", "encoding", "says"),
    [(OF_A_TOPIC.replace("/arm", "/leg"), None, "json", "no topic /leg; there are /arm"),
     (OF_A_TOPIC.replace("topic: /arm", ""), None, "json", "topic: '', required for an MCAP"),
     (OF_A_TOPIC, None, "cdr", "/arm is encoded as cdr by no schema"),
     (OF_A_TOPIC, without_effort, "json", r"message 10 has no number effort\[0\]"),
     (OF_A_TOPIC.replace("motor.angle", "motor"), None, "json", "no column motor in")],
)  # fmt: skip
def test_what_is_wrong_with_an_mcap_is_named(
    tmp_path: Path,
    names: str,
    change: Callable[[list[dict[str, object]]], None] | None,
    encoding: str,
    says: str,
) -> None:
    messages = messages_of(pressed(0.02))
    if change:
        change(messages)
    path = mcap(tmp_path / "log.mcap", messages, encoding)
    (tmp_path / "log.yaml").write_text(names)
    with pytest.raises(LogError, match=says):
        read_csv(path, ["joint"], {"joint": 3.0}, of_gap=True)


def test_an_mcap_that_ends_in_the_middle_is_refused(tmp_path: Path) -> None:
    path = mcap(tmp_path / "log.mcap", messages_of(pressed(0.02)))
    path.write_bytes(path.read_bytes()[:5000])
    (tmp_path / "log.yaml").write_text(OF_A_TOPIC)
    with pytest.raises(LogError, match=r"log\.mcap ends in the middle"):
        read_csv(path, ["joint"], {"joint": 3.0}, of_gap=True)


def test_a_csv_has_no_topic(tmp_path: Path) -> None:
    path = save(tmp_path / "log.csv", pressed(0.02))
    (tmp_path / "log.yaml").write_text(OF_A_TOPIC)
    with pytest.raises(LogError, match="topic: '/arm', allowed only for an MCAP"):
        read_csv(path, ["joint"], {"joint": 3.0}, of_gap=True)


def test_a_byte_order_mark_is_no_part_of_a_name(tmp_path: Path) -> None:
    path = save(tmp_path / "log.csv", pressed(0.02))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    log, _ = read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
    assert log.time_s[0] == 0.0


@pytest.mark.parametrize(("other", "shown"), [(";", "';'"), ("\t", r"'\\t'")])
def test_fields_that_no_comma_parts_are_refused(tmp_path: Path, other: str, shown: str) -> None:
    path = save(tmp_path / "log.csv", pressed(0.02))
    path.write_text(path.read_text().replace(",", other))
    with pytest.raises(LogError, match=f"log.csv:1: fields are separated by {shown}, allowed"):
        read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)


@pytest.mark.parametrize(
    ("change", "reported"),
    [(lambda c: c["time"].__setitem__(500, 2.0), ":502: time is before that of the row above"),
     (lambda c: c["link_position.joint"].__setitem__(7, np.nan), ":9: link_position.joint is nan"),
     (lambda c: c.update({k: v[:50] for k, v in c.items()}), ": .*too short: 50 samples"),
     (lambda c: c.update({k: 500.0 * v for k, v in c.items() if k[0] == "l"}), ": .*in degrees")],
)  # fmt: skip
def test_what_a_log_has_wrong_is_said_with_its_name(
    tmp_path: Path, change: Callable[[dict[str, np.ndarray]], None], reported: str
) -> None:
    columns = pressed(0.02)
    change(columns)
    path = save(tmp_path / "log.csv", columns)
    with pytest.raises(LogError, match=f"log.csv{reported}"):
        read_csv(path, ["joint"], {"joint": 2.0}, of_gap=True)
