"""Walls: what approaches stops in front of them, slides along, and may leave."""

import re
from dataclasses import replace

import numpy as np
import pytest

from daemon.modes.table import Mode
from daemon.motion.admittance import AdmittanceLaw, Gains
from daemon.motion.limits import Limits
from daemon.motion.motion import Motion
from daemon.motion.path import Follower, PathPoint
from daemon.motion.pose_path import PosePath
from daemon.protocol.state import Meeting
from daemon.tick.refusals import path_collision
from estimator.clearance import Clearance
from estimator.dynamics import Body
from estimator.shapes import Box, Capsule, Plane
from estimator.walls import SINKS_M, Walls
from tests.ideal_arm import MANNER

DT, REACTION_S = 0.01, 0.025
ACCELERATION = np.array([4.0, 3.0, 6.0])
LENGTHS = (0.4, 0.3, 0.2)
STILL = np.zeros((2, 3))


def links_of() -> tuple[list[Body], list[Capsule]]:
    """Three links in a vertical plane, from the height of 0.5 m."""
    bodies = []
    for k in range(3):
        there = np.array([LENGTHS[k - 1], 0, 0]) if k else np.array([0, 0, 0.5])
        bodies.append(
            Body(
                parent=k - 1, row=k, rotation=np.eye(3), translation=there,
                turning=np.array([0, -1.0, 0]), sliding=np.zeros(3), mass=1.0, moment=np.zeros(3),
                inertia=np.eye(3),
            )
        )  # fmt: skip
    links = [
        Capsule(f"link {k}", k, np.zeros(3), np.array([length, 0, 0]), 0.03)
        for k, length in enumerate(LENGTHS)
    ]
    return bodies, links


def arm(*obstacles) -> Clearance:
    """These links against all of `obstacles`, and the last against the first."""
    bodies, links = links_of()
    pairs = [(link, one) for link in links for one in obstacles]
    return Clearance(bodies, links, [*pairs, (links[2], links[0])])


TABLE = Plane("table", np.array([0, 0, 1.0]), 0.0)
BOX = Box("box", np.array([0.6, 0, 0.1]), np.eye(3), np.array([0.1, 0.4, 0.3]))


def walls(*obstacles, margin: float = 0.005) -> Walls:
    return Walls(arm(*obstacles), ACCELERATION, REACTION_S, margin)


def bounded(
    one: Walls, q: np.ndarray, wanted: np.ndarray, play: np.ndarray = STILL,
    moved: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    out = np.empty(3)
    one.bound(q, wanted if moved is None else moved, wanted, play, out)
    return out


def clear_pose(one: Walls, rng: np.random.Generator, least: float = 0.006) -> np.ndarray:
    while True:
        q = rng.uniform(-2.0, 2.0, 3)
        one.clearance.at(q)
        if np.min(one.clearance.gap) > least:
            return q


@pytest.mark.parametrize("seed", range(3))
def test_never_adds_motion(seed: int) -> None:
    rng, one, slowed = np.random.default_rng(seed), walls(TABLE, BOX), 0
    for _ in range(2000):
        q, wanted = rng.uniform(-2.5, 2.5, 3), rng.uniform(-3.0, 3.0, 3)
        out = bounded(one, q, wanted)
        assert np.all(out * wanted >= 0.0)
        assert np.all(np.abs(out) <= np.abs(wanted))
        slowed += one.slows
    assert slowed > 500


@pytest.mark.parametrize("held", [None, 0, 1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_random_setpoints_never_reach_the_wall_with_drives_that_lag(
    seed: int, held: int | None
) -> None:
    """Setpoints jump, joints follow by their acceleration and a lag, one not at all; the margin
    takes up what a joint that opens a gap does while it is reversed."""
    rng, one, least, nearest = np.random.default_rng(seed), walls(TABLE, BOX), 1.0, 1.0
    for _ in range(25):
        q, v, sent = clear_pose(one, rng), np.zeros(3), np.zeros(3)
        for k in range(200):
            if k % 25 == 0:
                wanted = rng.choice([-2.0, 0.0, 2.0], 3)
            ramped = np.clip(wanted, sent - ACCELERATION * DT, sent + ACCELERATION * DT)
            late, sent = sent, bounded(one, q, ramped, moved=v)
            v = v + (late - v) * DT / (DT + 0.01)
            if held is not None:
                v[held] = 0.0
            q = q + v * DT
            one.clearance.at(q)
            least = min(least, float(np.min(one.clearance.gap)))
        nearest = min(nearest, one.distance)
    assert 0.002 < least < 0.02, least


def beside_table(gap: float) -> tuple[Walls, np.ndarray, np.ndarray]:
    """A pose at that smallest gap, and its gradient."""
    one, q = walls(TABLE), np.array([-0.7, 0.5, 0.4])
    for _ in range(5):
        one.clearance.at(q)
        row = int(np.argmin(one.clearance.gap))
        gradient = np.array(one.clearance.gradient[row])
        q[0] -= (one.clearance.gap[row] - gap) / gradient[0]
    return one, q, gradient


def test_slides_along_a_wall_and_does_not_stick() -> None:
    """In front of the table, with one joint that closes the gap and one that opens it as fast, the
    arm goes on; the joint that closes it alone stands."""
    one, q, gradient = beside_table(0.0052)
    along = np.array([-0.3, 0.3 * gradient[0] / gradient[1], 0.0])
    out = bounded(one, q, along)
    assert out[0] < 0.8 * along[0]
    assert out[1] == along[1]
    out = bounded(one, q, np.array([-0.3, 0.0, 0.3 * np.sign(gradient[2])]))
    assert abs(out[2]) == pytest.approx(0.3)
    assert abs(out[0]) < 0.3 * abs(gradient[2] / gradient[0]) + 0.01


def test_a_joint_that_opens_counts_as_far_as_it_moves() -> None:
    one, q, gradient = beside_table(0.0052)
    along = np.array([-0.3, 0.3 * gradient[0] / gradient[1], 0.0])
    alone = bounded(one, q, np.array([-0.3, 0.0, 0.0]))[0]
    free, held, half = (bounded(one, q, along, moved=s * along)[0] for s in (1.0, 0.0, 0.5))
    assert held == pytest.approx(alone)
    assert bounded(one, q, along, moved=-along)[0] == pytest.approx(alone)
    assert free < half < held
    assert bounded(one, q, along, moved=np.full(3, np.nan))[0] == pytest.approx(alone)


def test_a_slide_that_sank_into_the_margin_comes_out_of_it() -> None:
    """Closing joints are slowed until the gap opens; where none opens it, all of them stand."""
    one, q, gradient = beside_table(0.002)
    along = np.array([-0.3, 0.3 * gradient[0] / gradient[1], 0.0])
    out = bounded(one, q, along)
    assert gradient @ out == pytest.approx(0.003 / (4.0 * REACTION_S), rel=1e-3)
    assert -0.3 < out[0] < -0.2
    assert out[1] == along[1]
    assert not bounded(one, q, np.array([-0.3, 0.0, 0.0])).any()


def test_inside_only_the_way_out_is_left() -> None:
    one = walls(TABLE)
    q = np.array([-1.5, 0.2, 0.1])
    assert bounded(one, q, np.array([1.0, 0.0, 0.0]))[0] == 1.0
    began = one.distance
    for _ in range(300):
        q = q + DT * bounded(one, q, np.array([-1.0, 0.0, 0.0]))
    assert one.slows
    assert began < 0.0
    assert began - SINKS_M - 2e-4 < one.distance < began
    for _ in range(900):
        one.forget()  # power that comes and goes is no way further in
        q = q + DT * bounded(one, q, np.array([-1.0, 0.0, 0.0]))
    assert began - SINKS_M - 2e-4 < one.distance < began
    q = np.array([-1.5, 0.0, 0.0])  # 13 mm deeper
    assert not bounded(one, q, np.array([-1.0, 0.0, 0.0])).any()
    one.forget()  # moved without power, it may hang further in
    assert bounded(one, q, np.array([-1.0, 0.0, 0.0])).any()


@pytest.mark.parametrize("cleared", [0.0085, 0.1])
def test_what_came_out_keeps_its_margin_again(cleared: float) -> None:
    one, q = walls(TABLE), np.array([-1.5, 0.2, 0.1])
    while one.distance < cleared or one.distance > 1e9:
        q = q + DT * bounded(one, q, np.array([0.5, 0.0, 0.0]))
    for _ in range(400):
        q = q + DT * bounded(one, q, np.array([-0.5, 0.0, 0.0]))
    assert one.distance == pytest.approx(0.005, abs=4e-4)


def test_play_of_the_gears_counts_as_gap() -> None:
    one = walls(TABLE)
    q, wanted = np.array([-0.3, -0.2, -0.1]), np.array([-0.5, -0.5, -0.5])
    one.clearance.at(q)
    gap = float(np.min(one.clearance.gap))
    free = bounded(one, q, wanted)
    row = int(np.argmin(one.clearance.gap))
    gradient = one.clearance.gradient[row][0]
    play = np.zeros((2, 3))
    play[0 if gradient > 0 else 1, 0] = (gap - 0.005) / abs(gradient)
    assert free.any()
    assert not bounded(one, q, wanted, play)[0]


def test_a_position_that_is_not_known_stops_and_a_wrong_velocity_stays() -> None:
    one, q = walls(TABLE), np.zeros(3)
    assert not bounded(one, np.array([0.0, np.nan, 0.0]), np.ones(3)).any()
    assert np.isnan(bounded(one, q, np.array([0.0, np.nan, 0.1]))).any()


def test_a_path_that_leads_through_is_refused_with_where() -> None:
    one, speed = walls(TABLE, BOX), np.full(3, 0.5)
    here, beyond = np.array([0.9, 0.0, 0.0]), np.array([-0.4, 0.9, 0.0])

    def way(start: np.ndarray, goal: np.ndarray) -> Meeting | None:
        return path_collision(one, start, PathPoint(PosePath("pose", start, goal, speed)))

    met = way(here, beyond)
    assert met is not None
    assert met.pair == ["link 1", "box"]
    assert one.touch(np.array(met.position))
    assert not one.touch(np.array(met.position) - 0.03 * (beyond - here))  # the first such place
    assert not path_collision(None, here, PathPoint(PosePath("pose", here, beyond, speed)))
    assert not way(here, here + 0.3)
    assert not way(here, here)
    inside = np.array([-0.4, 0.0, 0.0])
    assert not way(inside, here)
    deeper = way(inside, inside - 0.2)
    assert deeper is not None
    assert re.search(r"leads .* deeper into \w+, from \d+ to \d+ mm, at ", deeper.text)
    assert "deeper into" not in met.text


def test_what_just_touches_is_refused_without_a_depth() -> None:
    one, here, beyond = walls(TABLE, BOX), np.array([0.9, 0.0, 0.0]), np.array([-0.4, 0.9, 0.0])

    def way(share: float) -> Meeting | None:
        goal = here + share * (beyond - here)
        return path_collision(one, here, PathPoint(PosePath("pose", here, goal, np.full(3, 0.5))))

    free, through = 0.0, 1.0
    while through - free > 1e-6:
        middle = 0.5 * (free + through)
        free, through = (free, middle) if way(middle) else (middle, through)
    met, deep = way(through), way(1.0)
    assert met is not None
    assert deep is not None
    assert "leads link 1 through box at " in met.text
    assert " mm deep, at " in deep.text


def test_what_overlaps_already_hides_no_other_pair() -> None:
    """Link 0 stands deep in the box, and comes out of it; the last one goes through the table."""
    about = Box("box", np.array([0.1, 0, 0.5]), np.eye(3), np.full(3, 0.2))
    one, q = walls(TABLE, about), np.zeros(3)
    path = PosePath("pose", q, np.array([0.0, -1.3, -0.3]), np.full(3, 0.5))
    one.clearance.at(q)
    assert np.min(one.clearance.gap) < -0.1
    met = path_collision(one, q, PathPoint(path))
    assert met is not None
    assert met.pair == ["link 2", "table"]


def test_shapes_without_a_pair_bound_and_refuse_nothing() -> None:
    empty, q = Walls(Clearance(*links_of(), []), ACCELERATION, REACTION_S, 0.005), np.zeros(3)
    assert not path_collision(empty, q, PathPoint(PosePath("pose", q, q + 0.3, q + 0.5)))
    assert np.all(bounded(empty, q, np.ones(3)) == 1.0)
    assert empty.nearest == -1


def test_what_a_wall_held_back_does_not_dash_when_it_opens() -> None:
    """One joint is held at a box, until the others have gone by; its path is far ahead then."""
    box = Box("box", np.array([0.681, 0, 0.667]), np.eye(3), np.full(3, 0.03))
    start, goal = np.array([0.574, -1.226, -0.028]), np.array([1.349, 0.094, -1.076])
    limits = Limits(np.full(3, -3.0), np.full(3, 3.0), np.full(3, 2.0), ACCELERATION, REACTION_S)
    follower = Follower(PathPoint(PosePath("pose", start, goal, np.full(3, 0.3))), 1.0)
    law, gains = AdmittanceLaw(np.zeros(3), np.full(3, 0.5)), Gains(np.ones(3))
    manner = replace(MANNER, release=replace(MANNER.release, ahead=np.full(3, 0.15)))
    motion = Motion(manner, limits, law, gains, follower, walls=walls(box))
    q, fastest, behind = start.copy(), 0.0, 0.0
    motion.follow(q)
    for _ in range(1200):
        motion.step(Mode.HOLDING if follower.finished else Mode.TRACKING, q, None, 0.0 * q, DT)
        q = q + DT * motion.velocity
        fastest = max(fastest, float(np.abs(motion.velocity).max()))
        behind = max(behind, float(np.abs(motion.reference - q).max()))
        assert motion.walls is not None
        assert motion.walls.distance > 0.004
    assert behind > 0.5
    assert fastest < 2.01 * 0.3
    assert np.abs(q - goal).max() < 0.01
