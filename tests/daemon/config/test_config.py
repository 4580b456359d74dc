"""Loading of configurations: every broken one is refused with file, line, path and reason."""

import re
import shutil
from pathlib import Path

import pytest

from common.errors import ConfigurationError
from daemon.config.load import load_robot, parse_configuration
from tests.daemon.config.broken_configurations import BROKEN, BROKEN_URDF

ROMEO = Path(__file__).parents[3] / "configs" / "romeo_left_arm"


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


@pytest.mark.parametrize("name", BROKEN_URDF)
def test_refuses_broken_urdf(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pattern, new, words = BROKEN_URDF[name]
    path, urdf = edited(tmp_path), tmp_path / "arm.urdf"
    text, count = re.subn(pattern, new, urdf.read_text())
    assert count > 0
    urdf.write_text(text)
    (message,) = refusal(path).splitlines()
    assert message.startswith(f"{path}:{line_of(path, 'urdf: arm.urdf')}: urdf (arm.urdf): ")
    for word in words:
        assert word in message
    assert capfd.readouterr().err == ""  # where the parser would have its say


def test_only_the_beginning_of_a_foreign_file_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text("<robot> " + "many words " * 1000)
    message = refusal(path)
    assert "must be a group of fields, not '<robot> many words" in message
    assert len(message) < 200 + len(str(path))


def test_swapped_limits_are_the_only_error_reported(tmp_path: Path) -> None:
    """Neither counts, nor the swing of a sinusoid, nor a pose between them."""
    path = edited(
        tmp_path,
        ("lower: -1.40, upper: 2.18", "lower: 2.18, upper: -1.40"),
        ("control: {position_gain: 8.0}",
         "poses:\n  home:\n    LShoulderPitch: 0.1\ncontrol: {position_gain: 8.0}"),
    )  # fmt: skip
    (line,) = refusal(path).splitlines()
    assert line.endswith("limits.lower: 2.18 must be less than upper (-1.4)")


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
        "joints[0] (LShoulderPitch).thresholds.least",
    ]


@pytest.mark.parametrize(
    ("written", "value"),
    [("1e-3", 1e-3), ("2E+1", 20.0), ("1.5e1", 15.0), (".5", 0.5), ("12", 12.0), ("5.", 5.0)],
)
def test_numbers_are_read_as_people_write_them(written: str, value: float, tmp_path: Path) -> None:
    text = edited(tmp_path, ("gain: 25.0", f"gain: {written}")).read_text()
    assert parse_configuration(text, "config.yaml").estimator.gain == value


def test_the_gain_just_below_ringing_is_allowed(tmp_path: Path) -> None:
    path = edited(tmp_path, ("gain: 25.0", "gain: 199.9"))
    assert load_robot(path).configuration.estimator.gain == 199.9


@pytest.mark.parametrize("name", ["arm.urdf", "drive.eds", "config.yaml"])
def test_a_missing_file_is_named(name: str, tmp_path: Path) -> None:
    path = edited(tmp_path)
    (tmp_path / name).unlink()
    said = refusal(path)
    assert str(tmp_path / name) in said
    assert said.endswith("cannot be read: No such file or directory")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ": is empty"),
        ("just words", ": must be a group of fields"),
        ("version: [1\nname: x\n", ":1: a bracket is not closed by `]` before the next name"),
        ("bus: {port: 1]\nname: x\n", ":1: a bracket is not closed by `}` before the next name"),
        ("version: 1\n\tname: x\n", ":2: a tab: indent with spaces"),
        ("name: a: b\n", ":1: `: ` where no name is expected: put text that holds it in quotes"),
        ("name: @x\n", ":1: text that begins with `@` must be in quotes"),
        ("name: !!x y\n", ":1: text that begins with `!` must be in quotes"),
        ("name: *x\n", ":1: `*x` without `&x` before it; text that begins with `*`"),
        ("name: * x\n", ":1: text that begins with `*` or `&` must be in quotes"),
        ("name: - x\n", ":1: `- ` begins an entry of a list, on a line of its own"),
        ('name: "x\nversion: 1\n', ":1: a quote is not closed"),
        ('name: "x\\y"\n', ":1: `\\y` is no escape: use single quotes"),
        ('name: "x\nurdf: "a"\n', ":2: not in line with its group: check the indentation, and"),
        ("name: x\nversion\nbus: 1\n", ":2: `NAME: VALUE` is expected"),
        ("name: x\n---\nname: y\n", ":2: `---` begins a second document, only one is allowed"),
        ("name: x\x01\n", ":1: the character U+0001 is not allowed"),
    ],
)
def test_text_that_is_no_configuration_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = edited(tmp_path)
    path.write_text(text)
    assert words in refusal(path).removeprefix(str(path))


def test_a_path_that_cannot_be_read_is_named() -> None:
    path = Path("x" * 300)
    assert refusal(path) == f"{path}: cannot be read: File name too long"


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
def test_a_trajectory_file_is_checked(tmp_path: Path, text: str | None, words: str) -> None:
    folder = tmp_path / "robot"
    shutil.copytree(ROMEO, folder)
    config = folder / "config.yaml"
    before, _, after = config.read_text().partition("  sinusoids:\n")
    config.write_text(before + "  file: move.csv\n" + after.partition("\n\n")[2])
    if text is not None:
        (folder / "move.csv").write_text(text)
    if not words:
        trajectory = load_robot(folder).trajectory
        assert trajectory is not None
        assert trajectory.name == "move.csv"
        return
    with pytest.raises(ConfigurationError) as caught:
        load_robot(folder)
    assert words in str(caught.value)
    line = 1 + config.read_text().splitlines().index("  file: move.csv")
    assert str(caught.value).startswith(f"{config}:{line}: trajectory.file: ")
