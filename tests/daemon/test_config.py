"""Every broken configuration is refused with file, line, path in the file, and what is allowed."""

import shutil
from pathlib import Path

import pytest

from daemon.config.load import load_robot
from errors import ConfigurationError

ROMEO = Path(__file__).parents[2] / "configs" / "romeo_left_arm"

# What is edited (old, new), a mark in the line that must be named, the path in the file, and what
# the message must say of what is wrong and allowed.
BROKEN: dict[str, tuple[str, str, str, str, tuple[str, ...]]] = {
    "unknown key": (
        "control: {position_gain: 8.0}",
        "control: {position_gian: 8.0}",
        "position_gian",
        "control",
        ("unknown key `position_gian`", "allowed: position_gain"),
    ),
    "unknown key of a joint": (
        "    half_gap: 0.003",
        "    half_gap: 0.003\n    halfgap: 0.003",
        "    halfgap: 0.003",
        "joints[2] (LElbowRoll)",
        ("unknown key `halfgap`", "half_gap", "torque_constant"),
    ),
    "duplicate key": (
        "    rotor_inertia: 0.03",
        "    rotor_inertia: 0.03\n    rotor_inertia: 0.04",
        "    rotor_inertia: 0.04",
        "",
        ("key `rotor_inertia` is given twice", "first in line"),
    ),
    "missing key": (
        "period_ms: 10\n",
        "",
        "version: 1",
        "the file",
        ("missing required field `period_ms`",),
    ),
    "missing key of a joint": (
        "    torque_constant: 3.09\n",
        "",
        "- name: LElbowRoll",
        "joints[2] (LElbowRoll)",
        ("missing required field `torque_constant`",),
    ),
    "wrong type": (
        "torque_constant: 4.77",
        "torque_constant: strong",
        "torque_constant: strong",
        "joints[0] (LShoulderPitch).torque_constant",
        ("expected `float`", "'strong'"),
    ),
    "a truth is no number": (
        "half_gap: 0.018",
        "half_gap: true",
        "half_gap: true",
        "joints[0] (LShoulderPitch).half_gap",
        ("expected `float`", "got `bool`"),
    ),
    "an octal number of YAML 1.1": (
        "node: 7,",
        "node: 010,",
        "node: 010",
        "joints[6] (LWristPitch).wiring.node",
        ("expected `int`", "'010'"),
    ),
    "minutes and seconds of YAML 1.1": (
        "max_duration_s: 120.0",
        "max_duration_s: 2:00",
        "2:00",
        "admittance.max_duration_s",
        ("expected `float`", "'2:00'"),
    ),
    "out of range": (
        "control: {position_gain: 8.0}",
        "control: {position_gain: 40.0}",
        "position_gain",
        "control.position_gain",
        ("<= 15", "not 40.0"),
    ),
    "not one of the words": (
        "admittance_gain: 0.5",
        "admittance_gain: 0.5\n    end: fall",
        "end: fall",
        "joints[2] (LElbowRoll).end",
        ("invalid enum value 'fall'", "(allowed: brake, hold, limp)"),
    ),
    "not one of the reactions": (
        "contact: admittance,",
        "contact: hug,",
        "contact: hug,",
        "reactions.contact",
        ("'hug'", "(allowed: report, admittance, retract, hold, quick_stop)"),
    ),
    "not a number": (
        "acceleration: 5.0",
        "acceleration: .nan",
        ".nan",
        "",
        (".nan is not allowed", "must be finite"),
    ),
    "beyond all numbers": (
        "acceleration: 5.0",
        "acceleration: 1e999",
        "1e999",
        "",
        ("1e999 is not allowed", "must be finite"),
    ),
    "joint that the URDF lacks": (
        "- name: LWristYaw",
        "- name: LThumb",
        "urdf: arm.urdf",
        "urdf (arm.urdf)",
        ("LThumb", "LWristYaw"),
    ),
    "two joints of one name": (
        "- name: LWristYaw",
        "- name: LWristRoll",
        "- name: LWristRoll",
        "joints[4] (LWristRoll).name",
        ("two joints have this name",),
    ),
    "two drives with one node": (
        "node: 5,",
        "node: 4,",
        "node: 4,",
        "joints[3] (LElbowYaw).wiring.node",
        ("node 4 is also that of LWristRoll", "a node id of its own"),
    ),
    "a drive on the master's node": (
        "bitrate: 1000000}",
        "bitrate: 1000000, master_node: 6}",
        "node: 6,",
        "joints[5] (LWristYaw).wiring.node",
        ("node 6 is the master's",),
    ),
    "no such profile": (
        "node: 1, profile: two_encoder_drive",
        "node: 1, profile: one_encoder_drive",
        "one_encoder_drive",
        "joints[0] (LShoulderPitch).wiring.profile",
        ("no drive profile `one_encoder_drive`", "there are: two_encoder_drive"),
    ),
    "a residual that rings": (
        "gain: 25.0",
        "gain: 200.0",
        "gain: 200.0",
        "estimator.gain",
        ("T K must be less than 2", "less than 200 /s"),
    ),
    "contact at the collision level": (
        "contact: 0.8, collision: 6.0",
        "contact: 0.8, collision: 0.8",
        "collision: 0.8",
        "joints[0] (LShoulderPitch).thresholds.contact",
        ("0.8 must be less than collision (0.8)",),
    ),
    "limits upside down": (
        "lower: -1.40, upper: 2.18",
        "lower: 2.18, upper: -1.40",
        "lower: 2.18",
        "joints[0] (LShoulderPitch).limits.lower",
        ("2.18 must be less than upper (-1.4)",),
    ),
    "limits beyond the URDF": (
        "lower: -0.39, upper: 1.10",
        "lower: -0.39, upper: 1.20",
        "upper: 1.20",
        "joints[1] (LShoulderYaw).limits",
        ("[-0.39, 1.2] goes beyond the URDF's [-0.430472, 1.14032] rad",),
    ),
    "a spring without a gap": (
        "    half_gap: 0.0\n",
        "    half_gap: 0.0\n    gap_spring: {stiffness: 5}\n",
        "gap_spring:",
        "joints[4] (LWristRoll).gap_spring",
        ("must be zero where half_gap is 0",),
    ),
    "a bus that is too slow": (
        "bitrate: 1000000",
        "bitrate: 125000",
        "bitrate: 125000",
        "bus.bitrate",
        ("bus load", "125000 bit/s", "at most 80%"),
    ),
    "no EDS": (
        "eds: drive.eds",
        "eds: other.eds",
        "eds: other.eds",
        "drives.two_encoder_drive",
        ("other.eds", "not a readable EDS"),
    ),
    "object that the EDS lacks": (
        "object: 0x60E4, subindex: 1",
        "object: 0x60E5, subindex: 1",
        "eds: drive.eds",
        "drives.two_encoder_drive",
        ("drive.eds", "0x60E5:01"),
    ),
    "a master that is forgotten too soon": (
        "master_timeout_ms: 100",
        "master_timeout_ms: 20",
        "master_timeout_ms: 20",
        "drives.two_encoder_drive.master_timeout_ms",
        ("20 ms must be at least three periods (30 ms)",),
    ),
    "no motor position to measure": (
        '"2": [link_position, motor_position]',
        '"2": [link_position]',
        "node: 1,",
        "joints[0] (LShoulderPitch).wiring.profile",
        ("sends no motor_position", "integrated"),
    ),
    "trajectory of an unknown joint": (
        "    LShoulderPitch: {amplitude",
        "    RShoulderPitch: {amplitude",
        "RShoulderPitch: {",
        "trajectory.sinusoids.RShoulderPitch",
        ("no such joint", "there are: LShoulderPitch"),
    ),
    "trajectory that is too fast": (
        "frequency_Hz: 0.15",
        "frequency_Hz: 0.5",
        "frequency_Hz: 0.5",
        "trajectory.sinusoids.LShoulderPitch",
        ("speed of 1.1 rad/s", "above the limit 1"),
    ),
    "trajectory that does not fit": (
        "    LShoulderPitch: {amplitude: 0.35, frequency_Hz: 0.15}",
        "    LWristYaw: {amplitude: 0.41, frequency_Hz: 0.1}",
        "amplitude: 0.41",
        "trajectory.sinusoids.LWristYaw",
        ("does not fit between the limits -0.4 and 0.4",),
    ),
    "a file and sinusoids": (
        "  ramp_s: 2.0",
        "  ramp_s: 2.0\n  file: move.csv",
        "file: move.csv",
        "trajectory.file",
        ("either a file or sinusoids",),
    ),
    "another version": (
        "version: 1",
        "version: 2",
        "version: 2",
        "version",
        ("invalid enum value 2",),
    ),
    "a key that is a number": (
        '"1": [controlword, target_velocity]',
        "1: [controlword, target_velocity]",
        " 1: [controlword",
        "",
        ("must be text",),
    ),
}


def edited(folder: Path, *edits: tuple[str, str]) -> Path:
    """Romeo's configuration in `folder`, with the first of each old text replaced."""
    text = (ROMEO / "config.yaml").read_text()
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    for name in ("arm.urdf", "drive.eds"):
        shutil.copy(ROMEO / name, folder)
    path = folder / "config.yaml"
    path.write_text(text)
    return path


def line_of(path: Path, mark: str) -> int:
    """Number of the first line of `path` that holds `mark`."""
    lines = path.read_text().splitlines()
    return next(number for number, line in enumerate(lines, 1) if mark in line)


def refusal(path: Path) -> str:
    """Why `path` is refused."""
    with pytest.raises(ConfigurationError) as caught:
        load_robot(path)
    return str(caught.value)


def test_the_configuration_that_is_shipped_is_accepted(tmp_path: Path) -> None:
    robot = load_robot(edited(tmp_path))
    assert robot.configuration.period_s == 0.01
    assert robot.configuration.joint_names[2] == "LElbowRoll"
    assert load_robot(tmp_path).path == tmp_path / "config.yaml"


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_configuration_is_refused(name: str, tmp_path: Path) -> None:
    old, new, mark, where, words = BROKEN[name]
    path = edited(tmp_path, (old, new))
    message = refusal(path)
    start = f"{path}:{line_of(path, mark)}: " + (f"{where}: " if where else "")
    first = next((line for line in message.splitlines() if line.startswith(start)), None)
    assert first is not None, f"{start!r} begins no line of\n{message}"
    for word in words:
        assert word in first


def test_everything_that_does_not_fit_is_listed_at_once(tmp_path: Path) -> None:
    path = edited(
        tmp_path,
        ("node: 5,", "node: 4,"),
        ("gain: 25.0", "gain: 250.0"),
        ("contact: 0.8, collision: 6.0", "contact: 7.0, collision: 6.0"),
        ("LShoulderPitch: {amplitude", "RShoulderPitch: {amplitude"),
        ("lower: -0.39, upper: 1.10", "lower: -0.39, upper: 1.20"),
    )
    found = [line.split(": ")[1] for line in refusal(path).splitlines()]
    assert found == [
        "joints[3] (LElbowYaw).wiring.node",
        "joints[4] (LWristRoll).wiring.node",
        "joints[0] (LShoulderPitch).thresholds.contact",
        "estimator.gain",
        "trajectory.sinusoids.RShoulderPitch",
        "joints[1] (LShoulderYaw).limits",
    ]


@pytest.mark.parametrize(
    ("written", "value"),
    [("1e-3", 1e-3), ("2E+1", 20.0), ("1.5e1", 15.0), (".5", 0.5), ("12", 12.0), ("5.", 5.0)],
)
def test_numbers_are_read_as_people_write_them(written: str, value: float, tmp_path: Path) -> None:
    path = edited(tmp_path, ("gain: 25.0", f"gain: {written}"))
    assert load_robot(path).configuration.estimator.gain == value


def test_the_gain_just_below_ringing_is_allowed(tmp_path: Path) -> None:
    path = edited(tmp_path, ("gain: 25.0", "gain: 199.9"))
    assert load_robot(path).configuration.estimator.gain == 199.9


@pytest.mark.parametrize("name", ["arm.urdf", "drive.eds", "config.yaml"])
def test_a_missing_file_is_named(name: str, tmp_path: Path) -> None:
    path = edited(tmp_path)
    (tmp_path / name).unlink()
    assert str(tmp_path / name) in refusal(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("version: [1", "config.yaml:1"),
        ("just words", "expected `object`"),
        ("version: 1\n\tname: x\n", "config.yaml:2"),
    ],
)
def test_what_is_no_configuration_at_all(text: str, words: str, tmp_path: Path) -> None:
    path = edited(tmp_path)
    path.write_text(text)
    message = refusal(path)
    assert str(path) in message
    assert words in message


def test_text_that_is_not_utf_8(tmp_path: Path) -> None:
    path = edited(tmp_path)
    path.write_bytes(b"name: Rom\xe9o\n")
    assert f"{path}: is not UTF-8 text" in refusal(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,LElbowYaw\n0,-0.5\n1,-0.4\n", ""),
        ("time_s,LElbowYaw\n0,-0.5\n1,-0.4\n2,0.3\n", "move.csv:4: LElbowYaw: reaches 0.3"),
        ("time_s,RElbowYaw\n0,-0.5\n1,-0.4\n", "move.csv:1: no joint `RElbowYaw`"),
        (None, "move.csv: cannot be read: No such file"),
    ],
)
def test_a_trajectory_file_is_judged_with_the_configuration(
    tmp_path: Path, text: str | None, words: str
) -> None:
    folder = tmp_path / "robot"
    shutil.copytree(ROMEO, folder)
    config = folder / "config.yaml"
    before, _, after = config.read_text().partition("  sinusoids:\n")
    config.write_text(before + "  file: move.csv\n" + after.partition("\n\n")[2])
    if text is not None:
        (folder / "move.csv").write_text(text)
    if not words:
        recorded = load_robot(folder).recorded
        assert recorded is not None
        assert recorded.name == "move.csv"
        return
    with pytest.raises(ConfigurationError) as caught:
        load_robot(folder)
    assert words in str(caught.value)
    line = 1 + config.read_text().splitlines().index("  file: move.csv")
    assert str(caught.value).startswith(f"{config}:{line}: trajectory.file: ")
