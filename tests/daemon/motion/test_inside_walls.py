"""Walls of an arm that stands inside a plane or a box: no pair gets deeper than by millimetres, and
what leads out is let through. Random arms of capsules and of bars' edges, in random places."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.modes.table import Mode
from daemon.motion.admittance import AdmittanceLaw, Gains
from daemon.motion.limits import Limits
from daemon.motion.motion import Motion
from daemon.motion.path import Follower, PathPoint
from daemon.motion.pose_path import PosePath
from daemon.tick.refusals import path_collision
from estimator.clearance import Clearance
from estimator.dynamics import Body
from estimator.shapes import Box, Capsule, Plane
from estimator.walls import SINKS_M, Walls
from tests.ideal_arm import MANNER

DT, A = 0.01, 4.0
LAG = DT / (DT + 0.01)


def turned(rng: np.random.Generator) -> np.ndarray:
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return R * np.linalg.det(R)


def scene(seed: int, kind: str) -> tuple[Walls, np.ndarray, np.random.Generator]:
    """Walls of such an arm, and a pose in which one of its links is inside, by 10 mm at least, and
    the others are so or clear of the margin."""
    rng = np.random.default_rng(seed)
    while True:
        bodies, links, length = [], [], 0.0
        for k in range(int(rng.integers(2, 6))):
            bodies.append(
                Body(
                    parent=k - 1, row=k, rotation=np.eye(3) if k else turned(rng),
                    translation=np.array([length, 0, 0]), turning=np.eye(3)[rng.integers(3)],
                    sliding=np.zeros(3), mass=1.0, moment=np.zeros(3), inertia=np.eye(3),
                )
            )  # fmt: skip
            length, radius, bar = rng.uniform(0.15, 0.4), rng.uniform(0.01, 0.06), k % 2
            for y, z in ((-1, -1), (-1, 1), (1, -1), (1, 1)) if bar else ((0, 0),):
                at = np.array([0.0, y * radius, z * radius])
                end = at + np.array([length, 0, 0])
                links.append(Capsule(f"link {k}", k, at, end, 1e-4 if bar else radius))
        normal = rng.normal(size=3)
        plane = Plane("it", normal / np.linalg.norm(normal), rng.uniform(-0.4, 0.1))
        box = Box("it", rng.uniform(-0.6, 0.6, 3), turned(rng), rng.uniform(0.05, 0.3, 3))
        other = plane if kind == "plane" else box
        n, clearance = len(bodies), Clearance(bodies, links, [(link, other) for link in links])
        for _ in range(20):
            q = rng.uniform(-1.5, 1.5, n)
            gaps = gaps_of(clearance, q)
            if gaps.min() < -0.01 and not np.any((gaps > 0.0) & (gaps < 0.006)):
                return Walls(clearance, np.full(n, A), 0.025, 0.005), q, rng


def gaps_of(clearance: Clearance, q: np.ndarray) -> np.ndarray:
    """Least gap of each link at q."""
    clearance.at(q)
    links = [first.name for first, _ in clearance.pairs]
    gap = np.asarray(clearance.gap)
    of_row = np.array(links)[np.asarray(clearance.pair)]
    return np.array([gap[of_row == name].min() for name in sorted(set(links))])


class Depths:
    """Most that a pair got deeper than it was before, along a motion [m]."""

    def __init__(self, clearance: Clearance, q: np.ndarray) -> None:
        self._clearance, self.grown = clearance, 0.0
        self._least = self.now = np.minimum(gaps_of(clearance, q), 0.0)

    def at(self, q: np.ndarray) -> None:
        self.now = np.minimum(gaps_of(self._clearance, q), 0.0)
        self.grown = max(self.grown, float((self._least - self.now).max()))
        self._least = np.maximum(self._least, self.now)


def straight(clearance: Clearance, q: np.ndarray, goal: np.ndarray) -> Depths:
    depths = Depths(clearance, q)
    for share in np.linspace(0.0, 1.0, 160):
        depths.at(q + share * (goal - q))
    return depths


def moved(walls: Walls, q: np.ndarray, path: PosePath) -> Depths:
    """Depths on such a path with drives that lag."""
    n, depths, follower = len(q), Depths(walls.clearance, q), Follower(PathPoint(path), 1.0)
    limits = Limits(np.full(n, -9.0), np.full(n, 9.0), np.full(n, 2.0), np.full(n, A), 0.025)
    manner = replace(MANNER, release=replace(MANNER.release, ahead=np.full(n, 0.15)))
    law, gains = AdmittanceLaw(np.zeros(n), np.full(n, 0.5)), Gains(np.ones(n))
    motion = Motion(manner, limits, law, gains, follower, walls=walls)
    v = late = np.zeros(n)
    walls.forget()
    motion.follow(q)
    for _ in range(500):
        mode = Mode.HOLDING if follower.finished else Mode.TRACKING
        motion.step(mode, q, None, np.zeros(n), DT, moved=v)
        v, late = v + (late - v) * LAG, motion.velocity
        q = q + v * DT
        depths.at(q)
    return depths


@pytest.mark.parametrize(("kind", "beyond_m"), [("plane", 1e-4), ("box", 1e-3)])
def test_a_straight_way_is_accepted_if_and_only_if_no_pair_gets_deeper(kind, beyond_m) -> None:
    outs = arrived = 0
    for seed in range(60):
        walls, q, rng = scene(seed, kind)
        for _ in range(6):
            goal = q + rng.uniform(-1.0, 1.0, len(q)) * rng.integers(0, 2, len(q))
            path = PosePath("a pose", q, goal, np.full(len(q), 0.3))
            true, met = (
                straight(walls.clearance, q, goal),
                path_collision(walls, q, PathPoint(path)),
            )
            if met is not None:
                inside = "deeper into" in met.text
                assert true.grown > (SINKS_M - 1e-3 if inside else 0.0)
                continue
            assert true.grown < SINKS_M + 3e-3  # between two places that are looked at
            if true.now.min() == 0.0 and outs < 20:
                found = moved(walls, q, path)
                outs, arrived = outs + 1, arrived + (found.now.min() == 0.0)
                assert found.grown < SINKS_M + beyond_m
    assert outs > 12
    assert arrived >= 0.95 * outs, (arrived, outs)


@pytest.mark.parametrize(("kind", "beyond_m"), [("plane", 1e-3), ("box", 3e-3)])
def test_setpoints_that_jump_take_no_pair_deeper(kind: str, beyond_m: float) -> None:
    """The deepest place in a box may jump along a link that lies flat in it, by what the drives'
    lag lets through."""
    grown, slowed = [], 0
    for seed in range(30):
        walls, q, rng = scene(seed, kind)
        n, depths = len(q), Depths(walls.clearance, q)
        v, sent, still = np.zeros(n), np.zeros(n), np.zeros((2, n))
        for k in range(300):
            if k % 25 == 0:
                wanted = rng.choice([-2.0, 0.0, 2.0], n)
            late, sent, ramp = sent, np.empty(n), np.clip(wanted, sent - A * DT, sent + A * DT)
            walls.bound(q, v, ramp, still, sent)
            slowed += walls.slows
            v = v + (late - v) * LAG
            q = q + v * DT
            depths.at(q)
        grown.append(depths.grown)
    assert max(grown) < SINKS_M + beyond_m
    assert np.median(grown) < SINKS_M + 1e-4
    assert slowed > 1000
