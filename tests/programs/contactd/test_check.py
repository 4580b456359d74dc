"""`contactd check`: quantities, PDOs and the load of the bus that follow from a configuration."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench.rigs.lockstep import DESK_ARM, OPENARM, ROMEO, SINGLE_JOINT
from programs.contactd import check as check_module
from programs.contactd.check import print_check
from tests.golden_words import same_words
from tests.programs.contactd.drafting import GOLDEN, contactd


def check(folder: Path):
    return contactd("check", folder, catch_exceptions=False)


def copied(arm: Path, tmp_path: Path, old: str = "", new: str = "") -> Path:
    """config.yaml of a copy of an arm, with another text; Romeo, to which it may refer, beside."""
    for folder in {arm, ROMEO}:
        shutil.copytree(folder, tmp_path / folder.name)
    config = tmp_path / arm.name / "config.yaml"
    text = config.read_text()
    assert old in text
    config.write_text(text.replace(old, new))
    return config


def unidentified(config: Path) -> None:
    config.write_text(re.sub(r"known: .*", "known: {gap: none}", config.read_text()))
    (config.parent / "identified.yaml").unlink(missing_ok=True)


@pytest.mark.parametrize("arm", [DESK_ARM, OPENARM, ROMEO], ids=lambda arm: arm.name)
def test_words_of_the_check(arm, monkeypatch):
    """Drives with one encoder, with two, and motors. By hand, of the desk arm: SYNC has 55
    bits, TPDOs of a drive 95 and 115, RPDOs 75 and 95, heartbeats 65, 25 a second from each of
    three; gravity of the swing is that of 0.8 kg at 0.15 m, 1.3 rad off the vertical."""
    monkeypatch.chdir(arm.parent)
    printed = check(Path(arm.name)).output
    same_words(GOLDEN / f"check_{arm.name}.txt", printed)
    tables = printed[printed.index("\nwiring\n") : printed.index("\nuntil found: ")]
    assert max(len(line.rstrip()) for line in tables.splitlines()) <= 80


def test_a_field_is_explained():
    result = contactd("check", "--explain", "joints[1] (swing).wiring.gear")
    assert result.exit_code == 0
    first, find, typical = result.output.splitlines()
    assert first == (
        "joints.wiring.gear: turns of the motor per turn of the joint, all stages together"
    )
    assert find.startswith("  how to find it: data sheets")
    assert typical.startswith("  typical: 30 to 200")
    assert contactd("check", "--explain", "nose").exit_code == 78
    assert contactd("check").exit_code == 2


@pytest.mark.parametrize(
    ("field", "allowed"),
    [
        ("known", "friction, gap, masses, thresholds, wiring"),
        ("end", "brake, hold, limp"),
        ("drives.tpdo", "1, 2, 3, 4"),
        ("version", "1"),
    ],
)
def test_the_allowed_values_of_a_field_are_listed(field: str, allowed: str) -> None:
    result = contactd("check", "--explain", field)
    assert f"\n  allowed: {allowed}\n" in result.output


def test_ctrl_c_is_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(check_module, "print_check", interrupted)
    result = contactd("check", DESK_ARM)
    assert (result.exit_code, result.output) == (130, "")


def test_ctrl_c_is_quiet_while_modules_are_imported() -> None:
    code = "import programs; raise KeyboardInterrupt"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (ended.returncode, ended.stderr) == (-signal.SIGINT, b"")


@pytest.mark.parametrize(
    ("arm", "old", "new", "reported"),
    [
        (
            DESK_ARM,
            "rotor_inertia: 0.03",
            "rotor_inertia: 3e-6",
            "joints[0] (column).rotor_inertia: 3e-06 kg m2 is less than a motor of 0.045 Nm has, "
            "seen from the link (0.0003416 at least): is it that at the shaft? times gear^2 it is "
            "0.03",
        ),
        (
            SINGLE_JOINT,
            "contact: 0.5, collision: 4.0, least: 0.1",
            "contact: 4.3, collision: 6.0, least: 0.86",
            "joints[0] (joint).thresholds.contact: 4.3 Nm is near the end of the possible range: "
            "0.012 to 6 Nm, 0.001 to 0.5 of the motor's 12 Nm (torque_constant times "
            "max_current_A): above, it pushes with nearly its full torque before a contact is "
            "detected; below, noise of its current is detected as a contact",
        ),
    ],
    ids=["inertia at the shaft", "level near its bound"],
)
def test_a_likely_mistake_is_reported_with_its_line_and_the_configuration_is_good(
    tmp_path, arm, old, new, reported
):
    config = copied(arm, tmp_path, old, new)
    result = check(config.parent)
    assert result.exit_code == 0
    line = 1 + next(i for i, x in enumerate(config.read_text().splitlines()) if new in x)
    found = [x for x in result.output.splitlines() if re.match(f"{config}:[0-9]", x)]
    assert found == [f"{config}:{line}: {reported}"]
    assert result.output.endswith("config.yaml: good\n")
    assert reported not in check(arm).output


def test_a_refusal_ends_with_its_most_likely_cause(tmp_path):
    config = copied(DESK_ARM, tmp_path, "torque_constant: 3.0", "torque_constant: 0.03")
    result = check(config.parent)
    assert result.exit_code == 78
    *refused, likely = result.output.splitlines()
    assert all("is outside the possible range" in line for line in refused)
    assert likely.endswith("by that it is 3 Nm/A at the link")


@pytest.mark.parametrize("bitrate", [100_000, 10_000])
def test_a_bus_load_above_the_bitrate_is_refused(tmp_path, bitrate):
    config = copied(DESK_ARM, tmp_path, "bitrate: 500000", f"bitrate: {bitrate}")
    result = check(config.parent)
    assert result.exit_code == 78
    assert f"bus.bitrate: bus load {1.7275 * 50_000 / bitrate:.0%} at {bitrate} bit/s" in (
        result.output
    )


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_no_figure_is_cut_on_a_narrow_terminal(columns, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    print_check(ROMEO)
    printed = capsys.readouterr().out
    assert "…" not in printed
    for row in (
        "quick_stop_deceleration 0x6085:00 UNSIGNED32 0.010472    +1   0      rad/s2",
        "LElbowRoll     1.2   12      0.336 0.108  0.120  0.060 0.624  0.984 0.180",
    ):
        assert row in printed


def scaled_urdf(folder: Path, tmp_path: Path, attribute: str, factor: float) -> Path:
    """A copy of an arm, all figures of one attribute of its URDF larger by a factor."""
    urdf = copied(folder, tmp_path).with_name("arm.urdf")
    urdf.write_text(
        re.sub(
            rf'({attribute}=")([^"]*)',
            lambda found: found[1] + " ".join(f"{factor * float(x):g}" for x in found[2].split()),
            urdf.read_text(),
        )
    )
    return urdf.parent


@pytest.mark.parametrize("scaled", ["mass value", "xyz"])
def test_an_arm_in_grams_or_millimetres_is_refused(tmp_path, scaled):
    folder = scaled_urdf(DESK_ARM, tmp_path, scaled, 1000.0)
    result = check(folder)
    assert result.exit_code == 78
    assert (
        "urdf (arm.urdf), joint swing: gravity at worst: 1134 Nm is outside the possible range: up "
        "to 9.6 Nm, 2 times the motor's 4.8 Nm (torque_constant times max_current_A): are masses "
        "in kg and lengths in m?"
    ) in result.output
    assert "joint column: gravity" not in result.output  # it is upright


def test_motors_too_weak_for_gravity_in_some_poses_are_reported(tmp_path):
    result = check(scaled_urdf(DESK_ARM, tmp_path, "mass value", 5.0))
    assert result.exit_code == 0
    *_, exchange, warning, refused, good = result.output.splitlines()
    assert "belongs to another configuration" in refused  # which the URDF is part of
    assert exchange.startswith("bus load")
    assert warning == (
        "swing: gravity exceeds what the motor can hold (5.672 Nm of 4.8 Nm): "
        "are masses in kg and lengths in m?"
    )
    assert good.endswith("config.yaml: good")


def test_missing_identification_that_arming_refuses_is_reported(tmp_path):
    config = copied(SINGLE_JOINT, tmp_path)
    assert "will be refused" not in check(SINGLE_JOINT).output
    unidentified(config)
    result = check(config.parent)
    assert result.exit_code == 0
    *_, wiring, friction, thresholds, good = result.output.splitlines()
    for line, what in ((wiring, "wiring"), (friction, "friction"), (thresholds, "thresholds")):
        assert line.startswith(f"`contactctl arm` will be refused: the {what} of joint ")
        assert f"`contactd identify {what}`" in line
    assert good.endswith("config.yaml: good")


def test_doubt_about_the_place_of_shapes_is_reported(tmp_path):
    config = copied(DESK_ARM, tmp_path)
    folder = config.parent
    assert "zeros of" not in check(folder).output
    contactd("shapes", folder, catch_exceptions=False)
    lines = [line for line in check(folder).output.splitlines() if line.startswith("shapes: ")]
    assert len(lines) == 2
    assert "zeros of column, swing" in lines[1]
    assert "`contactd identify zero`" in lines[1]
    unidentified(config)
    assert "none is guarded until" in check(folder).output


def test_the_source_of_each_level_is_shown(tmp_path):
    """A stated level, a floor beside an identified one, and a draft's."""
    config = copied(ROMEO, tmp_path, "    known: *simulated\n")
    folder, text = config.parent, config.read_text().replace("st: 0.1}", "st: 0.2}")
    config.write_text(re.sub(r"known: &simulated .*", "known: {thresholds: mine}", text))
    levels = "{contact: 0.9, collision: 5.0}"
    entry = f"{{date: 2026-01, log: '', per_hour: 1, largest: 1, thresholds: {levels}}}"
    found = folder / "identified.yaml"
    found.write_text(found.read_text().replace("thresholds: null", f"thresholds: {entry}", 2))
    lines = check(folder).output.splitlines()
    at = lines.index("contact levels")
    assert [" ".join(line.split()) for line in lines[at + 2 : at + 5]] == [
        "LShoulderPitch 0.8 0.16 stated in config.yaml",
        "LShoulderYaw 0.9 0.2 identified on 2026-01",
        "LElbowRoll 0.4 0.08 config.yaml, not identified",
    ]
    (unused,) = [line for line in lines if "is not used" in line]
    assert unused.startswith(
        f"{config}:37: joints[0] (LShoulderPitch).thresholds.contact: 0.8 Nm is stated in "
        "config.yaml and in force; 0.9 Nm, identified on 2026-01 (identified.yaml), is not used"
    )
    shown = contactd("identify", "--config", folder, env={"COLUMNS": "200"})
    assert "known: mine (0.9 Nm is not used)" in shown.output


def test_a_link_inside_a_box_in_all_poses_is_reported(tmp_path):
    folder = copied(ROMEO, tmp_path).parent
    around = "boxes: {post: {centre: [0, 0, 0], size: [0.4, 1, 1.2]}}"
    (folder / "surroundings.yaml").write_text(f"version: 1\n{around}\n")
    contactd("shapes", folder, "--single", catch_exceptions=False)
    lines = check(folder).output.splitlines()
    (line,) = [line for line in lines if line.startswith("surroundings: post ")]
    assert "LShoulderPitch, LShoulderYaw" in line
    assert "LWristPitch" not in line


def test_a_plane_turned_after_the_fit_is_reported(tmp_path):
    folder = copied(ROMEO, tmp_path).parent
    for normal, held in ((1, False), (-1, True)):
        plane = f"planes: {{table: {{point: [0, 0, -0.6], normal: [0, 0, {normal}]}}}}"
        (folder / "surroundings.yaml").write_text(f"version: 1\n{plane}\n")
        if not held:
            contactd("shapes", folder, "--single", catch_exceptions=False)
        assert ("surroundings: table holds LElbowRoll" in check(folder).output) is held
