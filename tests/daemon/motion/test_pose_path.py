"""Way to a pose: together, within limits, to the goal from wherever."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.arrays import Vector
from daemon.motion.limits import Limits
from daemon.motion.path import Follower, PathPoint
from daemon.motion.pose_path import PosePath, run_time_s

DT, RAMP = 0.01, 1.0
LOWER, UPPER = np.array([-1.0, -2.0, 0.0]), np.array([1.0, 0.5, 1.5])
LIMITS = Limits(LOWER, UPPER, np.array([1.0, 0.5, 2.0]), np.array([4.0, 0.4, 2.0]), 0.015)
poses = st.tuples(*(st.floats(a, b) for a, b in zip(LOWER, UPPER, strict=True))).map(np.array)


def path(start: Vector, goal: Vector, speed: float = 0.2, ramp_s: float = RAMP) -> PosePath:
    return PosePath.planned("the way to x", np.array(start), np.array(goal), speed, LIMITS, ramp_s)


def run(follower: Follower, q: Vector) -> tuple[Vector, Vector]:
    """References (m, n) and their velocities from q to the end."""
    follower.anchor(np.array(q))
    references = []
    while not follower.finished:
        references.append(follower.step(DT))
        assert len(references) < 20_000
    return (
        np.array([np.array(q), *(r.q for r in references)]),
        np.array([np.zeros(3), *(r.velocity for r in references)]),
    )


@pytest.mark.parametrize(
    ("goal", "speed", "duration"),
    [
        ((0.4, 0.0, 1.0), 0.2, 2.0),  # the first has furthest to go
        ((0.4, 0.3, 1.0), 0.4, 1.5),  # the second may set out with 0.2 rad/s2 only
        ((0.0, 0.0, 0.0), 2.0, 1.0),  # nor the third with more than 1
        ((0.0, 0.0, 1.0), 0.2, 0.0),
    ],
)
def test_the_slowest_joint_sets_the_pace(
    goal: tuple[float, ...], speed: float, duration: float
) -> None:
    assert path([0.0, 0.0, 1.0], goal, speed).duration == pytest.approx(duration)


@given(poses, poses, st.floats(0.01, 2.0))
def test_it_keeps_every_limit_and_ends_at_the_goal(start: Vector, goal: Vector, s: float) -> None:
    way = path(start, goal, s)
    if way.duration > 60.0:
        return
    q, velocity = run(Follower(PathPoint(way), RAMP), start)
    np.testing.assert_allclose(q[-1], goal, atol=1e-9)
    assert (q >= np.minimum(start, goal) - 1e-9).all()
    assert (q <= np.maximum(start, goal) + 1e-9).all()
    assert (np.abs(velocity) <= np.minimum(s, LIMITS.velocity) + 1e-9).all()
    assert (np.abs(np.diff(velocity, axis=0)) <= 0.5 * LIMITS.acceleration * DT + 1e-9).all()
    # All arrive together: at each moment all have gone the same share.
    share = (q - start)[:, goal != start] / (goal - start)[goal != start]
    if share.size and np.abs(goal - start)[goal != start].min() > 1e-3:
        np.testing.assert_allclose(share, share[:, :1] * np.ones(share.shape[1]), atol=1e-6)


@pytest.mark.parametrize("distance", [1e-4, 0.01, 0.1, 0.3, 0.9])
def test_it_takes_the_time_that_is_stated(distance: float) -> None:
    way = path([0.0, 0.0, 0.5], (distance, 0.0, 0.5))
    q, _ = run(Follower(PathPoint(way), RAMP), way.start)
    assert (len(q) - 1) * DT == pytest.approx(run_time_s(way.duration, RAMP), abs=0.1)


def test_led_away_it_goes_to_the_same_goal() -> None:
    way, goal = path([0.0, 0.0, 1.0], (0.4, -0.2, 1.0)), np.array([0.4, -0.2, 1.0])
    follower = Follower(PathPoint(way), RAMP)
    follower.anchor(way.start)
    for _ in range(150):
        follower.step(DT)
    elsewhere = np.array([-0.3, 0.1, 0.2])
    q, velocity = run(follower, elsewhere)
    assert follower.place.path.name == way.name
    np.testing.assert_allclose(q[1], elsewhere, atol=1e-3)
    np.testing.assert_allclose(q[-1], goal, atol=1e-9)
    assert np.abs(velocity).max() <= 0.2 + 1e-9


def test_from_a_little_outside_it_leads_inwards() -> None:
    outside = np.array([-1.01, 0.52, 1.0])
    way = path(outside, (-0.9, 0.5, 1.0))
    assert not PathPoint(way).leaves_limits(outside, LOWER, UPPER).any()
    beyond = PosePath("x", outside, np.array([-1.001, 0.5, 1.0]), np.full(3, 0.2))
    assert PathPoint(beyond).leaves_limits(outside, LOWER, UPPER).tolist() == [True, False, False]
