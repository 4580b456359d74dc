"""A simulated Romeo with shapes: a finger between forearm and upper arm is felt, yielded to, and
not squeezed, nor does a hand fold the elbow beyond the margin, or lead it into a wall, with or
without a guide; hanging in a table it gets out; else it is as without shapes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from bench.rigs.lockstep import ROMEO, Rig, lockstep_rig
from daemon.config.load import load_robot
from daemon.config.shapes import SHAPES, SURROUNDINGS, Surroundings, shapes_text
from daemon.modes.table import Event, Mode
from daemon.motion.pose_path import PosePath
from daemon.protocol.guide import GuideAxes
from daemon.protocol.state import Near
from programs.contactd.fitting import fitted

ELBOW = 3
OPEN, FOLDED = -1.0, -0.1  # rad
FINGER_M, STIFFNESS = 0.03, 5000.0  # [N/m]
BETWEEN = {"LWristYaw", "LShoulderYaw"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = Path(copytree(ROMEO, tmp_path_factory.mktemp("shaped") / "arm"))
    shapes, _ = fitted(load_robot(folder), None, Surroundings(version=1))
    (folder / SHAPES).write_text(shapes_text(shapes))
    return folder


@contextmanager
def opened(folder: Path) -> Iterator[Rig]:
    """Armed, its elbow open."""
    with lockstep_rig(folder) as one:
        one.enable()
        one.run(0.5)
        folds(one, OPEN)
        while one.mode is Mode.TRACKING:
            one.step()
        assert one.permit() == []
        yield one


def folds(rig: Rig, elbow: float) -> None:
    q = np.array(rig.state().link_position)
    goal = q.copy()
    goal[ELBOW] = elbow
    path = PosePath("pose", q, goal, np.full(len(q), 0.3))
    assert rig.tick.controller.request(Event.START, "a test", rig.time_s, path) == []


def between(rig: Rig) -> tuple[float, np.ndarray]:
    """Gap between the two, and its gradient."""
    walls = rig.tick.controller.motion.walls
    assert walls is not None
    walls.clearance.at(np.array(rig.state().link_position))
    pairs = [{one.name for one in pair} for pair in walls.clearance.pairs]
    rows = [r for r, pair in enumerate(walls.clearance.pair) if pairs[pair] == BETWEEN]
    nearest = min(rows, key=lambda row: walls.clearance.gap[row])
    return walls.clearance.gap[nearest], np.array(walls.clearance.gradient[nearest])


def squeezed(rig: Rig, seconds: float, finger: float, hand: float = 0.0) -> list[float]:
    """Gaps while a finger of this width is between, and a hand folds the elbow [Nm]."""
    gaps = []
    for _ in range(round(100 * seconds)):
        gap, gradient = between(rig)
        rig.arm.external_torque[:] = STIFFNESS * max(finger - gap, 0.0) * gradient
        rig.arm.external_torque[ELBOW] += hand
        rig.step()
        gaps.append(gap)
    return gaps


def test_a_finger_between_two_links_is_detected_and_not_squeezed(folder: Path) -> None:
    with opened(folder) as rig:
        folds(rig, FOLDED)
        gaps = squeezed(rig, 4.0, FINGER_M)
        assert rig.mode is Mode.ADMITTANCE
        assert "LElbowYaw" in rig.state().cause
    assert min(gaps) > FINGER_M - 0.004


def test_a_hand_folds_the_elbow_no_further_than_the_margin(folder: Path, tmp_path: Path) -> None:
    """One that is further from the limit of the joint than the gap there."""
    wide = Path(copytree(folder, tmp_path / "arm"))
    text = (wide / SHAPES).read_text()
    (wide / SHAPES).write_text(text.replace("margin: 0.005", "margin: 0.02"))
    with opened(wide) as rig:
        gaps = squeezed(rig, 4.0, 0.0, hand=2.5)
        assert rig.mode is Mode.ADMITTANCE
    assert min(gaps) > 0.019
    assert gaps[-1] < 0.023


def test_motion_that_no_wall_slows_is_identical_to_motion_without_shapes(folder: Path) -> None:
    """Contact detection, too: of a push on its trajectory. It goes on some ticks later, as its way
    is looked at."""
    runs = []
    for arm in (ROMEO, folder):
        with lockstep_rig(arm) as one:
            one.enable()
            one.run(0.5)
            assert one.permit() == []
            one.request(Event.START)
            states = one.states(1.0)
            one.arm.external_torque[0] = 4.0
            states += one.states(0.5)
            one.arm.external_torque[0] = 0.0
            runs.append([*states, *one.states(1.5)])
    modes = {state.mode for state in runs[0]}
    assert {Mode.TRACKING, Mode.ADMITTANCE} <= modes
    for without, shaped in zip(*runs, strict=True):
        assert isinstance(shaped.near, Near)
        assert not shaped.near.slows
        assert replace(shaped, near=UNSET, timing=without.timing) == without


TABLE = "{point: [0, 0, -0.3], normal: [0, 0, 1]}"  # 0.29 m above the lowest place
FRONT = "{point: [0.225, 0, 0], normal: [-1, 0, 0]}"  # 0.1 m before the foremost


@pytest.fixture(scope="module")
def hanging(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of the arm with such a plane."""

    def beside(plane: str) -> Path:
        arm = Path(copytree(folder, tmp_path_factory.mktemp("hanging") / "arm"))
        (arm / SURROUNDINGS).write_text(f"version: 1\nplanes:\n  plane: {plane}\n")
        return arm

    return beside


def depths(rig: Rig, rows: list[list[int]]) -> np.ndarray:
    """Depth of each link in the plane, of its rows [m]."""
    walls = rig.tick.controller.motion.walls
    walls.clearance.at(np.array(rig.state().link_position))
    gap = np.asarray(walls.clearance.gap)
    return np.array([-min(0.0, gap[of].min()) for of in rows])


def rows_beside_plane(rig: Rig) -> list[list[int]]:
    clearance = rig.tick.controller.motion.walls.clearance
    rows: dict[str, list[int]] = {}
    for r, k in enumerate(clearance.pair):
        first, second = clearance.pairs[k]
        if second.name == "plane":
            rows.setdefault(first.name, []).append(r)
    return list(rows.values())


@pytest.mark.parametrize("by", ["go", "hand"])
def test_an_arm_inside_a_table_may_leave_it(by: str, hanging) -> None:
    with lockstep_rig(hanging(TABLE)) as rig:
        rig.enable()
        rig.run(0.5)
        rows = rows_beside_plane(rig)
        q, least = np.array(rig.state().link_position), depths(rig, rows)
        assert least.max() > 0.28
        request, speed = rig.tick.controller.request, np.full(len(q), 0.3)
        turned = PosePath("a pose", q, q + np.eye(len(q))[2], speed)  # lowers a corner of the hand
        assert "deeper into" in request(Event.START, "a test", rig.time_s, turned)[0]
        if by == "go":
            up = PosePath("a pose", q, q - 1.4 * np.eye(len(q))[0], speed)
            assert request(Event.START, "a test", rig.time_s, up) == []
        else:
            assert rig.permit() == []
            rig.arm.external_torque[0] = -4.0
        for _ in range(600):
            rig.step()
            now = depths(rig, rows)
            assert np.all(now < least + 1e-3)  # links fall in their gaps when a hand comes
            least = np.minimum(least, now)
        assert least.max() == 0.0


GUIDES = [
    GuideAxes(),
    GuideAxes(frame="base", stiff=("x", "y")),
    GuideAxes(frame="base", held=("rx", "ry", "rz"), damped=("x",), redundant="held"),
]


@pytest.mark.parametrize("guide", GUIDES, ids=str)
def test_a_hand_on_a_guide_leads_no_link_into_a_wall(guide, hanging) -> None:
    """It rests there after that, below every level, and the arm swings to find it."""
    rng, least, slowed, swung, away = np.random.default_rng(3), 1.0, 0, 0, []
    with lockstep_rig(hanging(FRONT)) as rig:
        rig.enable()
        rig.run(0.5)
        joints = rig.robot.configuration.joints
        level = np.array([joint.thresholds.collision for joint in joints])
        controller, q = rig.tick.controller, np.array(rig.state().link_position)
        path = PosePath("a pose", q, q + 0.3 * np.eye(len(q))[4], np.full(len(q), 0.01))
        assert controller.request(Event.START, "a test", rig.time_s, path) == []
        assert rig.permit() == []
        assert controller.leading.set_guide(guide, "a test") == []
        clearance, rows = controller.motion.walls.clearance, rows_beside_plane(rig)
        wall = [row for of in rows for row in of]
        for k in range(900):
            clearance.at(np.array(rig.state().link_position))
            gap = np.asarray(clearance.gap)
            least = min(least, float(gap.min()))
            if k % 40 == 0:
                way = clearance.gradient[wall[int(np.argmin(gap[wall]))]]
                way = -60.0 * np.array(way) + 0.2 * level * rng.uniform(-1.0, 1.0, len(level))
                push = np.clip(way, -0.6 * level, 0.6 * level)
            rig.arm.external_torque[:] = push if k < 600 else 0.05 * push
            rig.step()
            slowed += rig.state().near.slows
            swung += controller.motion.probing.any()
            away.append(gap[wall].min())
    assert least > 0.003
    assert min(away) < 0.009
    assert slowed > 20
    assert swung > 20
