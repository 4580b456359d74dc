"""CSV files, good and bad: the first fault is named with its line and column."""

import csv
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import TrajectoryError
from daemon.motion.trajectory_file import read_trajectory, refuse_shapes
from tests.examples import scaled

JOINTS = ["LElbowRoll", "LElbowYaw"]
GOOD = "time_s,LElbowYaw,LElbowRoll\n0,-0.5,0.1\n0.5,-0.4,0.2\n1.0,-0.3,0.1\n"


def write(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "move.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        "# from the bench\n\n" + GOOD.replace(",", " , ") + "\n,,\n",
        GOOD.replace("-0.5", "-5e-1"),
        'time_s,"LElbowYaw",LElbowRoll\n0,-0.5,"0.1"\n0.5,-0.4,0.2\n1.0,-0.3,0.1',
    ],
)
def test_good_files(tmp_path: Path, text: str) -> None:
    found = read_trajectory(write(tmp_path, text), JOINTS)
    assert found.joints == ("LElbowYaw", "LElbowRoll")
    assert found.times == [0.0, 0.5, 1.0]
    assert found.positions == [[-0.5, 0.1], [-0.4, 0.2], [-0.3, 0.1]]
    # The velocities beside them are those of the samples.
    rows = found.rows()
    assert rows[1] == pytest.approx([0.5, -0.4, 0.2, 0.2, 0.0])
    lines = text.splitlines()
    for line, (time_s, *_) in zip(found.lines, rows, strict=True):
        assert float(lines[line - 1].lstrip().split(",")[0]) == time_s


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "move.csv: is empty; its first line names the columns: time_s, joints"),
        ("# only words\n\n", "move.csv: is empty"),
        ("time_s,LElbowYaw\n", "move.csv: 0 samples; a trajectory needs two or more"),
        ("time_s,LElbowYaw\n0,0\n", "move.csv: 1 samples"),
        ("time_s\n0\n1\n", "move.csv:1: no joint is named"),
        ("t,LElbowYaw\n0,0\n1,0\n", "move.csv:1: no column `time_s` among: t, LElbowYaw"),
        ("time_s;LElbowYaw\n0;0\n", r"no column `time_s` among: time_s;LElbowYaw \(separated by"),
        ("0,0\n1,0\n", "move.csv:1: no column `time_s`"),
        ("#\ntime_s,RElbow\n0,0\n", "move.csv:2: no joint `RElbow`; there are: LElbowRoll, LElb"),
        ("time_s,LElbowYaw,\n0,0,0\n", "move.csv:1: no joint ``"),
        ("time_s,LElbowYaw,LElbowYaw\n0,0,0\n", "move.csv:1: two columns `LElbowYaw`"),
        ("time_s,LElbowYaw,time_s\n0,0,0\n", "move.csv:1: two columns `time_s`"),
        ("time_s,L\x1b[2J\n0,0\n", r"move.csv:1: no joint `L\?\[2J`; there are"),
        ("time,L\x1b[2J\n0,0\n", r"no column `time_s` among: time, L\?\[2J \("),
        ("time_s,LElbowYaw\n0,\x1b[2J\n", r"move.csv:2: LElbowYaw: `\?\[2J` is not a number"),
        ("time_s,LElbowYaw\n0,0\n1,zero\n", "move.csv:3: LElbowYaw: `zero` is not a number"),
        ("time_s,LElbowYaw\n0,0\n1,\n", "move.csv:3: LElbowYaw: `` is not a number"),
        ("time_s,LElbowYaw\n0,0\n1,nan\n", "move.csv:3: LElbowYaw: nan is not a number of at most"),
        ("time_s,LElbowYaw\n0,0\n1,-inf\n", "move.csv:3: LElbowYaw: -inf is not a number of"),
        ("time_s,LElbowYaw\n0,0\nnan,0\n", "move.csv:3: time_s: nan is not a number"),
        ("time_s,LElbowYaw\n0,0\n1,0\n0.9,0\n", "move.csv:4: time_s: 0.9 does not come after 1"),
        ("time_s,LElbowYaw\n0,0\n1,0\n1,0\n", "move.csv:4: time_s: 1 does not come after 1"),
        ("time_s,LElbowYaw\n0,0\n1\n", "move.csv:3: 1 cells, but 2 columns"),
        ("time_s,LElbowYaw\n0,0\n1,0,0\n", "move.csv:3: 3 cells, but 2 columns"),
        ('time_s,LElbowYaw\n0,0\n1,"0', "move.csv:3: is not CSV: unexpected end of data"),
        (b"time_s,LElbowYaw\n0,\xff\n", "move.csv: is not UTF-8 text"),
        ("time_s,LElbowYaw\n" + "\n".join(f"{i},0" for i in range(60_002)), "60002: more than"),
    ],
)
def test_bad_files(tmp_path: Path, text: str | bytes, words: str) -> None:
    with pytest.raises(TrajectoryError, match=words) as caught:
        read_trajectory(write(tmp_path, text), JOINTS)
    assert caught.value.exit_code == 65


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match=r"nothing\.csv: cannot be read: No such file"):
        read_trajectory(tmp_path / "nothing.csv", JOINTS)
    with pytest.raises(TrajectoryError, match="cannot be read: Is a directory"):
        read_trajectory(tmp_path, JOINTS)


def test_the_error_of_a_row_is_put_on_its_line(tmp_path: Path) -> None:
    found = read_trajectory(write(tmp_path, "# one\n" + GOOD), JOINTS)
    assert str(found.placed(TrajectoryError("a: too fast", row=1))).endswith(
        "move.csv:4: a: too fast"
    )
    assert str(found.placed(TrajectoryError("too short"))).endswith("move.csv: too short")


@pytest.mark.parametrize(
    ("times", "positions", "velocities", "row", "words"),
    [
        ([0, 1], [[0, 0]], None, None, "2 times, but 1 rows of positions"),
        ([0, 1], [[0, 0], [0]], None, 1, "1 positions for 2 joints"),
        ([0, 1], [[0, 0], [0, 0]], [[0, 0]], None, "2 times, but 1 rows of velocities"),
        ([0, 1], [[0, 0], [0, 0]], [[0, 0], [0, 0, 0]], 1, "3 velocities for 2 joints"),
        ([0, 0], [[0, 0], [0, 0]], None, 1, "time_s: 0 does not come after 0"),
        ([0, 10**400], [[0, 0], [0, 0]], None, 1, r"a number of more than 1e\+09"),
        ([0, 1], [[-(10**400), 0], [0, 0]], None, 0, r"a number of more than 1e\+09"),
        ([0, 1], [[0, 0], [0, 0]], [[0, 0], [0, 2e9]], 1, r"a number of more than 1e\+09"),
        ([0, float("nan")], [[0, 0], [0, 0]], None, 1, "time_s: nan does not come after 0"),
    ],
)
def test_shapes_that_do_not_fit(
    times: list[float],
    positions: list[list[float]],
    velocities: list[list[float]] | None,
    row: int | None,
    words: str,
) -> None:
    with pytest.raises(TrajectoryError, match=words) as caught:
        refuse_shapes(2, times, positions, velocities)
    assert caught.value.row == row


@settings(max_examples=scaled(100), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cells=st.lists(st.lists(st.text(max_size=6), max_size=4), max_size=6), header=st.booleans())
def test_whatever_it_says_it_is_read_or_refused(
    tmp_path: Path, cells: list[list[str]], header: bool
) -> None:
    path = tmp_path / "move.csv"
    with path.open("w", newline="", encoding="utf-8", errors="replace") as stream:
        writer = csv.writer(stream)
        if header:
            writer.writerow(["time_s", *JOINTS])
        writer.writerows(cells)
    refused = ""
    found = None
    try:
        found = read_trajectory(path, JOINTS)
    except TrajectoryError as error:
        refused = str(error)
    assert str(path) in refused or (found and len(found.times) == len(found.lines) >= 2)
