"""A short run of `bench.surroundings`, and one that finds an arm without walls."""

import numpy as np
import pytest

from bench.rigs.lockstep import OPENARM
from bench.surroundings import KINDS, Scene, lost, motion, scene


@pytest.fixture(scope="module")
def openarm() -> Scene:
    return scene(OPENARM)


@pytest.mark.parametrize("kind", KINDS)
def test_no_motion_gets_into_the_truth(openarm: Scene, kind: str) -> None:
    run = motion(openarm, kind, 3)
    assert run["deepest_m"] == 0.0
    assert run["least"] > 0.0
    assert run["changes"] <= 2


def test_without_walls_it_would(openarm: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    class Open:
        clearance, slows = openarm.walls.clearance, False

        def bound(self, q, moved, wanted, play, out) -> None:
            out[:] = wanted

    unbound = Scene(*(getattr(openarm, name) for name in ("name", "robot")), Open(),
                    openarm.truth, openarm.lower, openarm.upper)  # fmt: skip
    assert max(motion(unbound, "thrown", seed)["deepest_m"] for seed in range(4)) > 0.01


def test_shapes_contain_the_truth(openarm: Scene) -> None:
    rng, clearance = np.random.default_rng(5), openarm.walls.clearance
    pair = np.asarray(clearance.pair)
    for _ in range(50):
        q = rng.uniform(openarm.lower, openarm.upper)
        clearance.at(q)
        gaps: dict[tuple[str, str], float] = {}
        for k, (first, second) in enumerate(clearance.pairs):
            name, gap = (first.name, second.name), float(np.asarray(clearance.gap)[pair == k].min())
            gaps[name] = min(gap, gaps.get(name, gap))
        for first, second in clearance.pairs:
            truth = openarm.truth.gap(q, (first, second))
            assert gaps[first.name, second.name] < truth + 1e-5


def test_some_poses_are_lost(openarm: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.surroundings.POSES", 60)
    clear, forbidden, near = lost(openarm, 1)
    assert 0 <= near <= forbidden < clear <= 60
