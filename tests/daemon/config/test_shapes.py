"""Files of shapes and surroundings: read, refused, and the pairs that they guard."""

import re
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bench.rigs.lockstep import DESK_ARM
from common.errors import ConfigurationError
from daemon.assembly import build_walls
from daemon.config.files import Files
from daemon.config.load import load_robot
from daemon.config.shapes import SHAPES, SURROUNDINGS, Walls, clearance_of, obstacles_of
from identification.capsules import PairGaps
from programs.contactd import fitting
from programs.contactd.contactd import main

TABLE = "version: 1\nplanes:\n  table: {point: [0, 0, -0.2], normal: [0, 0, 2]}\n"
BOX = "boxes:\n  press: {centre: [1, 0, 0], size: [0.2, 0.4, 0.6], rpy: [0, 0, 1.57079632679]}\n"


@pytest.fixture(scope="module")
def shaped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shaped") / "arm"
    copytree(DESK_ARM, folder)
    (folder / SHAPES).unlink(missing_ok=True)
    assert fit(folder).exit_code == 0
    return folder


def fit(folder: Path, *more: str) -> Result:
    """Result of `contactd shapes`."""
    return CliRunner().invoke(main, ["shapes", str(folder), *more])


def walls_of(folder: Path) -> Walls:
    walls = load_robot(folder).walls
    assert walls is not None
    return walls


@pytest.fixture
def folder(shaped: Path, tmp_path: Path) -> Path:
    return Path(copytree(shaped, tmp_path / "arm"))


def test_without_shapes_there_are_no_walls() -> None:
    robot = load_robot(DESK_ARM)
    assert robot.walls is None
    assert build_walls(robot) is None


def test_shapes_and_surroundings_make_pairs(folder: Path) -> None:
    (folder / SURROUNDINGS).write_text(TABLE + BOX)
    robot, walls = load_robot(folder), walls_of(folder)
    clearance = clearance_of(walls, robot.model.bodies(), robot.configuration.joint_names)
    names = {(one.name, other.name) for one, other in clearance.pairs}
    assert names == {(one, other) for one in ("column", "swing") for other in ("table", "press")}
    plane, box = obstacles_of(walls)
    assert plane.offset == pytest.approx(-0.2)
    assert np.allclose(box.axes @ [1, 0, 0], [0, 1, 0])
    assert build_walls(robot) is not None


def test_a_second_run_replaces_nothing_without_force(folder: Path) -> None:
    runs = [fit(folder), fit(folder, "--force")]
    assert [run.exit_code for run in runs] == [78, 0]
    assert "no pair is left to guard" in runs[1].output  # two neighbours alone


def edited(folder: Path, name: str, old: str, new: str) -> None:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (SHAPES, "joint: swing", "joint: elbow"), (SHAPES, "name: swing", "name: column"),
        (SHAPES, "corners:\n- name: column", "corners:\n- name: other"),
        (SHAPES, "corners:\n- name: column\n  joint: c", "corners:\n- name: column\n  joint: el"),
        (SHAPES, "name: swing", "name: table"), (SHAPES, "radius: ", "radius: -"),
        (SHAPES, "urdf: ", "urdf: f"), (SURROUNDINGS, "[0, 0, 2]", "[0, 0, 0]"),
        (SURROUNDINGS, "0, 0, 1.57079632679", "0, 0, 90"),
        (SURROUNDINGS, "press", "table"), (SURROUNDINGS, "planes", "walls"),
    ],
)  # fmt: skip
def test_refused_with_file_and_line(folder: Path, name: str, old: str, new: str) -> None:
    (folder / SURROUNDINGS).write_text(TABLE + BOX)
    load_robot(folder)
    edited(folder, name, old, new)
    said = r"boxes.press.rpy\[2\]: must be a number of at most 7 rad, not 90" if "90" in new else ""
    with pytest.raises(ConfigurationError, match=rf"{name}:\d+: {said}"):
        load_robot(folder)


def test_a_capsule_that_was_added_counts_beside_a_plane(folder: Path) -> None:
    """Under the name of a link, too, whose corners are all that the plane was kept off."""
    (folder / SURROUNDINGS).write_text(TABLE)

    def gap() -> float:
        walls = build_walls(load_robot(folder))
        assert walls is not None
        walls.clearance.at(np.zeros(2))
        return float(np.min(walls.clearance.gap))

    before = gap()
    tool = "{name: swing, joint: swing, start: [0, 0, 0], end: [0, 0, 0], radius: 0.5}"
    edited(folder, SHAPES, "capsules:\n", f"capsules:\n- {tool}\n")
    assert gap() < before - 0.1


def test_more_pairs_than_a_tick_has_time_for_are_refused(folder: Path) -> None:
    fit(folder, "--single", "--force")
    planes = [f"  p{k}: {{point: [0, 0, -{k + 1}], normal: [0, 0, 1]}}\n" for k in range(75)]
    (folder / SURROUNDINGS).write_text("version: 1\nplanes:\n" + "".join(planes))
    walls_of(folder)
    with (folder / SURROUNDINGS).open("a") as file:
        file.write("  one_more: {point: [0, 0, -9], normal: [0, 0, 1]}\n")
    with pytest.raises(ConfigurationError, match="152 pairs to guard; at most 150"):
        load_robot(folder)


def test_surroundings_alone_are_refused(folder: Path) -> None:
    (folder / SURROUNDINGS).write_text(TABLE)
    (folder / SHAPES).unlink()
    with pytest.raises(ConfigurationError, match=SURROUNDINGS):
        load_robot(folder)


def test_a_fit_replaces_shapes_that_are_refused(folder: Path) -> None:
    (folder / SURROUNDINGS).write_text(TABLE)
    edited(folder, SHAPES, "urdf: ", "urdf: f")
    for force in (["--force"], []):
        assert fit(folder, *force).exit_code == 0
        walls_of(folder)
        (folder / SHAPES).unlink()


@pytest.mark.parametrize("wall", ["point: [0, -9, 0], normal: [0, 1, 0]",
                                  "point: [0, 0, 0], normal: [0, 1, 0]"])  # fmt: skip
def test_a_wall_out_of_reach_or_often_in_the_way_is_guarded(folder: Path, wall: str) -> None:
    (folder / SURROUNDINGS).write_text(f"version: 1\nplanes:\n  table: {{{wall}}}\n")
    assert fit(folder, "--force").exit_code == 0
    assert frozenset(("swing", "table")) not in walls_of(folder).left_out


def test_a_wall_of_a_links_name_is_refused(folder: Path) -> None:
    (folder / SURROUNDINGS).write_text(TABLE.replace("table:", "swing:"))
    run = fit(folder, "--force")
    assert run.exit_code == 78
    assert "planes.swing: the name of a link's capsule" in run.output


def test_a_link_that_is_free_of_a_wall_in_few_poses_is_guarded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm may stand in one of these, and move from there into the wall."""
    pairs = [("column", "table"), ("swing", "table"), ("swing", "column")]
    nearly = dict.fromkeys(pairs, PairGaps(-0.1, 0.96))
    monkeypatch.setattr(fitting, "gaps_over_poses", lambda *_: nearly)
    (folder / SURROUNDINGS).write_text(TABLE)
    run = fit(folder, "--force")
    assert run.exit_code == 0, run.output
    assert not [one for one in walls_of(folder).shapes.left_out if "table" in one.pair]


def test_both_files_count_as_changed(folder: Path) -> None:
    files = Files.of(load_robot(folder))
    assert files.changed() == []
    (folder / SURROUNDINGS).write_text(TABLE)
    edited(folder, SHAPES, "margin: 0.005", "margin: 0.01")
    assert sorted(files.changed()) == [SHAPES, SURROUNDINGS]


def test_collision_geometry_comes_before_inertia(folder: Path) -> None:
    (folder / SHAPES).unlink()
    urdf = folder / "arm.urdf"
    shape = '<collision><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>'
    first = urdf.read_text().index("<inertial>")
    urdf.write_text(urdf.read_text()[:first] + shape + urdf.read_text()[first:])
    (folder / "identified.yaml").unlink(missing_ok=True)
    run = fit(folder)
    assert run.exit_code == 0, run.output
    shapes = walls_of(folder).shapes
    (capsule,) = shapes.capsules
    assert shapes.source == "collision"
    assert 0.05 < capsule.radius < 0.06
    assert np.linalg.norm(np.subtract(capsule.end, capsule.start)) > 0.3


def test_edited_surroundings_ask_for_pairs_that_are_left_out(folder: Path) -> None:
    """A table through the foot, which always touches it, is moved away in its file."""
    inside = "version: 1\nboxes:\n  table: {centre: [0, 0, 0], size: [0.1, 0.1, 0.1]}\n"
    (folder / SURROUNDINGS).write_text(inside)
    assert fit(folder, "--force").exit_code == 0
    assert ("column", "table") in {one.pair for one in walls_of(folder).shapes.left_out}
    (folder / SURROUNDINGS).write_text(f"# a remark\n{inside}")
    load_robot(folder)
    (folder / SURROUNDINGS).write_text(TABLE)
    with pytest.raises(ConfigurationError, match=r"shapes.yaml:\d+: left_out\[\d\]"):
        load_robot(folder)


def test_parts_of_a_link_share_a_name_and_a_joint(folder: Path) -> None:
    text = (folder / SHAPES).read_text()
    first = text.index("- end") if "- end" in text else text.index("- ", text.index("capsules:"))
    part = text[first : text.index("\n- ", first) + 1]
    (folder / SHAPES).write_text(text[:first] + part + text[first:])
    first_part, second_part, *others = walls_of(folder).shapes.capsules
    assert first_part.name == second_part.name
    joint = next(one.joint for one in others if one.name != first_part.name)
    moved = part.replace(f"joint: {first_part.joint}", f"joint: {joint}")
    (folder / SHAPES).write_text(text[:first] + moved + text[first:])
    with pytest.raises(ConfigurationError, match="is given twice"):
        load_robot(folder)


@pytest.mark.parametrize(("wall", "hint"), [
    ("planes:\n  table: {point: [0, 0, -1], normal: [0, 0, -1]}\n", "must point to the free side"),
    ("boxes:\n  table: {centre: [0, 0, 0], size: [2, 2, 2]}\n", "nothing would be kept away"),
])  # fmt: skip
def test_a_wall_around_the_whole_arm_is_refused(folder: Path, wall: str, hint: str) -> None:
    """All its pairs would be left out: a table whose normal points down was guarded by nothing."""
    before = (folder / SHAPES).read_text()
    (folder / SURROUNDINGS).write_text(f"version: 1\n{wall}")
    run = fit(folder, "--force")
    assert run.exit_code == 78
    assert re.search(r"surroundings.yaml:3: \w+\.table: the whole arm is inside", run.output)
    assert hint in run.output
    assert (folder / SHAPES).read_text() == before


def test_a_new_fit_keeps_the_margin_and_added_capsules(folder: Path) -> None:
    tool = "{name: tool, joint: swing, start: [0, 0, 0], end: [0, 0, 0.5], radius: 0.02}"
    edited(folder, SHAPES, "capsules:\n", f"capsules:\n- {tool}\n")
    edited(folder, SHAPES, "margin: 0.005", "margin: 0.02")
    (folder / SURROUNDINGS).write_text(TABLE)
    run = fit(folder, "--force")
    assert run.exit_code == 0
    assert "kept      tool, a capsule of swing" in run.output
    shapes = walls_of(folder).shapes
    assert [one.name for one in shapes.capsules].count("tool") == 1
    assert shapes.margin == 0.02
    edited(folder, SHAPES, "urdf: ", "urdf: f")  # fitted to another: it may be a link of that
    run = fit(folder, "--force")
    assert "gone      tool, a capsule of swing" in run.output
