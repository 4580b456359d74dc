"""A simulated Romeo with shapes: a finger between forearm and upper arm is felt, yielded to, and
not squeezed, nor does a hand fold the elbow beyond the margin; else it is as without shapes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from bench.rigs.lockstep import ROMEO, Rig, lockstep_rig
from daemon.config.load import load_robot
from daemon.config.shapes import SHAPES, Surroundings, shapes_text
from daemon.modes.table import Event, Mode
from daemon.motion.pose_path import PosePath
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


def test_a_finger_between_two_links_is_felt_and_not_squeezed(folder: Path) -> None:
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


def test_what_no_wall_slows_is_bit_for_bit_as_without_shapes(folder: Path) -> None:
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
