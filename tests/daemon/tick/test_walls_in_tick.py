"""Walls in the tick: State names the nearest pair, a path into the wall is refused, and one that is
not known beforehand stops in front of it."""

from collections.abc import Iterator
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from msgspec import UNSET

from bench.rigs.lockstep import DESK_ARM, Rig, lockstep_rig
from daemon.assembly import build_walls
from daemon.config.load import load_robot
from daemon.config.shapes import SHAPES, SURROUNDINGS, Surroundings, shapes_text
from daemon.modes.table import Event, Mode
from daemon.motion.pose_path import PosePath
from daemon.protocol.state import Meeting, Near
from estimator.payload import Payload
from programs.contactd.fitting import fitted

AWAY = 0.5  # rad to go, into the wall


def gaps(folder: Path, q: np.ndarray) -> tuple[float, np.ndarray]:
    """Smallest gap at q, and its gradient."""
    walls = build_walls(load_robot(folder))
    walls.clearance.at(q)
    row = int(np.argmin(walls.clearance.gap))
    return walls.clearance.gap[row], np.array(walls.clearance.gradient[row])


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """The desk arm, and a plane 50 mm beside it which it can approach."""
    folder = Path(copytree(DESK_ARM, tmp_path / "arm"))
    shapes, _ = fitted(load_robot(folder), None, Surroundings(version=1), single=True)
    with lockstep_rig(folder) as first:
        q = np.array(enabled(first).state().link_position)
    (folder / SHAPES).write_text(shapes_text(shapes))

    def put(normal: list[int], away: float) -> tuple[float, np.ndarray]:
        point = [-away * part for part in normal]
        wall = f"wall: {{point: {point}, normal: {normal}}}"
        (folder / SURROUNDINGS).write_text(f"version: 1\nplanes:\n  {wall}\n")
        return gaps(folder, q)

    for normal in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]):
        gap, gradient = put(normal, 9.0)
        if np.abs(gradient).max() > 0.1:
            break
    put(normal, 9.05 - gap)
    with lockstep_rig(folder) as second:
        yield enabled(second)


def enabled(rig: Rig) -> Rig:
    for _ in range(10):
        rig.step()
    rig.tick.controller.request(Event.ENABLE, "a test", rig.time_s)
    for _ in range(80):
        rig.step()
    assert rig.state().mode is Mode.HOLDING
    return rig


def into(rig: Rig) -> PosePath:
    """A path on which the nearest gap closes."""
    walls, q = rig.tick.controller.motion.walls, np.array(rig.state().link_position)
    walls.clearance.at(q)
    gradient = np.asarray(walls.clearance.gradient)[int(np.argmin(walls.clearance.gap))]
    way = -AWAY * gradient / np.abs(gradient).max()
    return PosePath("pose", q, q + way, np.full(len(q), 0.4))


def test_arms_without_shapes_have_no_such_field() -> None:
    with lockstep_rig(DESK_ARM) as rig:
        assert enabled(rig).state().near is UNSET


def test_the_nearest_pair_is_named_and_a_path_into_it_refused(rig: Rig) -> None:
    near = rig.state().near
    assert isinstance(near, Near)
    assert near.pair[1] == "wall"
    assert near.distance == pytest.approx(0.05, abs=0.01)
    assert rig.state().meeting is UNSET
    refused = rig.tick.controller.request(Event.START, "a test", rig.time_s, into(rig))
    rig.step()
    met = rig.state().meeting
    assert isinstance(met, Meeting)
    assert met.pair[1] == "wall"
    assert [met.text] == refused
    assert rig.tick.controller.motion.walls.touch(np.array(met.position))
    assert rig.state().mode is Mode.HOLDING
    q = np.array(rig.state().link_position)
    clear = PosePath("back", q, q + 0.2 * (q - np.array(met.position)), np.full(len(q), 0.4))
    assert not rig.tick.controller.refusals(Event.START, clear)
    rig.step()
    assert rig.state().meeting is UNSET


def test_a_path_that_was_refused_is_shown_no_longer_once_the_arm_is_off(rig: Rig) -> None:
    rig.tick.controller.request(Event.START, "a test", rig.time_s, into(rig))
    rig.step()
    assert isinstance(rig.state().meeting, Meeting)
    rig.tick.controller.request(Event.DISABLE, "a test", rig.time_s)
    while rig.state().mode is not Mode.OFF:
        rig.step()
    rig.step()
    assert rig.state().meeting is UNSET


def test_a_payload_without_a_shape_is_reported(rig: Rig) -> None:
    assert rig.tick.carry(Payload(mass=0.1, com=[0.0, 0.0, 0.0]), "a test") == []
    assert "shape" in rig.tick.controller.machine.changes[-1].text
    assert rig.tick.carry(None, "a test") == []
    assert "shape" not in rig.tick.controller.machine.changes[-1].text


def test_a_path_into_a_wall_that_was_not_refused_stops_before_it(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.tick.controller.path_collision", lambda *_: None)
    assert not rig.tick.controller.request(Event.START, "a test", rig.time_s, into(rig))
    nearest, slowed = 1.0, False
    for _ in range(400):
        rig.step()
        near = rig.state().near
        assert isinstance(near, Near)
        nearest, slowed = min(nearest, near.distance), slowed or near.slows
    assert 0.003 < nearest < 0.015
    assert slowed
