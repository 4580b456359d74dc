"""Shape of a payload: what covers its box, and what it is kept from."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from msgspec import structs

from bench.rigs.lockstep import ROMEO
from common.errors import ModelError
from daemon.config import shapes
from daemon.config.load import Robot, load_robot
from daemon.config.payload_shape import capsules_of_box, with_payload
from daemon.service.payloads import Payloads
from estimator.payload import Payload
from programs.contactd.fitting import fitted

PLANE = shapes.PlaneEntry(point=(0.0, 0.0, -0.7), normal=(0.0, 0.0, 1.0))
HANGING = np.array([1.5, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def romeo() -> Robot:
    robot, around = load_robot(ROMEO), shapes.Surroundings(version=1, planes={"table": PLANE})
    found, _ = fitted(robot, None, around)
    return replace(robot, walls=shapes.Walls(shapes=found, surroundings=around))


@pytest.mark.parametrize("seed", range(20))
def test_capsules_contain_the_box_and_hardly_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = 10.0 ** rng.uniform(-2.0, 0.0, 3)
    inside = edges * rng.uniform(-0.5, 0.5, (4000, 3))
    inside[:2000] = np.sign(inside[:2000]) * 0.5 * edges * (rng.random((2000, 3)) > 0.3)
    nearest = np.full(len(inside), np.inf)
    for start, end, radius in capsules_of_box(edges):
        way = end - start
        share = np.clip((inside - start) @ way / max(way @ way, 1e-12), 0.0, 1.0)
        away = np.linalg.norm(inside - start - share[:, np.newaxis] * way, axis=1) - radius
        nearest = np.minimum(nearest, away)
        assert np.abs(np.array([start, end])).max(axis=0).max() + radius < 1.2 * edges.max()
    assert nearest.max() < 1e-9


def gap(robot: Robot, payload: Payload, other: str) -> float:
    """Smallest gap between payload and another shape, the arm hanging."""
    walls = Payloads(robot).walls(payload, HANGING)
    assert walls is not None
    walls.clearance.at(HANGING)
    c = walls.clearance
    names = [{one.name, second.name} for one, second in c.pairs]
    return min(c.gap[row] for row in range(len(c.gap)) if names[c.pair[row]] == {"payload", other})


def test_beside_a_plane_it_is_as_long_as_its_box(romeo: Robot) -> None:
    """A flat box about the tool: its lowest corner, by pinocchio's place of the hand."""
    for box in ([0.3, 0.02, 0.1], [0.05, 0.25, 0.05]):
        payload = Payload.of(0.2, romeo.model.tool_place.tolist(), box=box)
        corners = [
            romeo.model.place().point + romeo.model.place().axes @ (0.5 * np.array(box) * sign)
            for sign in np.array(np.meshgrid(*([-1, 1],) * 3)).reshape(3, 8).T
        ]
        placed = pose_of(romeo, HANGING)
        lowest = min((placed[0] @ corner + placed[1])[2] for corner in corners)
        assert gap(romeo, payload, "table") == pytest.approx(lowest + 0.7, abs=2e-4)


def pose_of(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and place of the last joint."""
    model = pin.buildModelFromXML(robot.urdf)
    data = model.createData()
    names = list(model.names)[1:]
    pin.forwardKinematics(model, data, q[[robot.configuration.joint_names.index(n) for n in names]])
    return data.oMi[model.njoints - 1].rotation, data.oMi[model.njoints - 1].translation


def test_a_payload_is_guarded_from_the_shapes_that_the_hand_may_reach(romeo: Robot) -> None:
    assert romeo.walls is not None
    payload = Payload.of(0.2, [0.1, 0.0, 0.0], box=[0.1, 0.1, 0.1])
    both = with_payload(romeo.walls, payload, romeo.model)
    whys = {frozenset(one.pair): one.why for one in romeo.walls.shapes.left_out}
    hand = romeo.model.names[romeo.model.hand_joint]
    for other in {one.name for one in romeo.walls.shapes.capsules} - {hand}:
        why = whys.get(frozenset((hand, other)))
        guarded = frozenset(("payload", other)) not in both.left_out
        assert guarded is (why is None or why == "never"), (other, why)
    assert frozenset(("payload", "table")) not in both.left_out


def test_a_hand_without_shapes_leaves_nothing_out(romeo: Robot) -> None:
    walls, hand = romeo.walls, romeo.model.names[romeo.model.hand_joint]
    assert walls is not None
    bare = [one for one in walls.shapes.capsules if one.joint != hand]
    shaped = shapes.Walls(shapes=structs.replace(walls.shapes, capsules=bare))
    both = with_payload(shaped, Payload.of(0.2, [0.1, 0, 0], box=[0.1] * 3), romeo.model)
    assert not [pair for pair in both.left_out if "payload" in pair]


def test_a_box_that_reaches_into_a_link_is_refused_at_this_pose(romeo: Robot) -> None:
    payloads, place = Payloads(romeo), [0.0, 0.0, 0.0]
    assert payloads.walls(Payload.of(0.2, place, box=[1.5, 1.5, 1.5]), None) is not None
    with pytest.raises(ModelError, match=r"mm into the shape of LShoulder"):
        payloads.walls(Payload.of(0.2, place, box=[1.5, 1.5, 1.5]), HANGING)
    table = Payload.of(0.2, romeo.model.tool_place.tolist(), box=[0.1, 0.05, 0.05])
    stands = replace(romeo, walls=lower(romeo, gap(romeo, table, "table") + 0.01))
    assert Payloads(stands).walls(table, HANGING) is not None


def lower(robot: Robot, by: float) -> shapes.Walls:
    """Walls whose table is nearer by so much [m]."""
    assert robot.walls is not None
    plane = shapes.PlaneEntry(point=(0.0, 0.0, -0.7 + by), normal=(0.0, 0.0, 1.0))
    around = shapes.Surroundings(version=1, planes={"table": plane})
    return shapes.Walls(shapes=robot.walls.shapes, surroundings=around)
