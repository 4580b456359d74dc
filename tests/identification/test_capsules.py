"""Capsules that are fitted contain their points and are little larger; pairs by sampled poses."""

import numpy as np
import pytest

from identification.capsules import (
    THINNER,
    THINNEST,
    PairGaps,
    corners_of,
    fit_capsule,
    gaps_over_poses,
    split,
)
from tests.daemon.motion.test_walls import TABLE, arm


def outside(fit, points: np.ndarray) -> float:
    way = fit.end - fit.start
    t = np.clip((points - fit.start) @ way / max(way @ way, 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(points - fit.start - np.outer(t, way), axis=1).max() - fit.radius)


@pytest.mark.parametrize("seed", range(5))
def test_contains_all_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * rng.uniform(0.01, 0.3, 3) + rng.normal(size=3)
    assert outside(fit_capsule(points), points) < 1e-9


def test_a_capsule_is_found_again() -> None:
    rng = np.random.default_rng(2)
    ways = rng.normal(size=(3000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, np.newaxis]
    start, end = np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.1, 0.7])
    points = start + np.outer(rng.uniform(size=3000).round(), end - start) + 0.05 * ways
    fit = fit_capsule(points)
    assert fit.radius == pytest.approx(0.05, abs=0.002)
    assert np.linalg.norm(fit.end - fit.start) == pytest.approx(
        np.linalg.norm(end - start), rel=0.03
    )


@pytest.mark.parametrize("seed", range(3))
def test_two_halves_cover_a_box_with_thinner_capsules(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = np.array(np.meshgrid(*([-1.0, 1.0],) * 3)).reshape(3, 8).T * [0.06, 0.2, 0.25]
    halves = split(corners)
    fits = [fit_capsule(half) for half in halves]
    assert len(fits) == 2
    assert max(fit.radius for fit in fits) < THINNER * fit_capsule(corners).radius
    for point in rng.dirichlet(np.full(8, 0.2), 500) @ corners:
        assert min(outside(fit, point[np.newaxis]) for fit in fits) < 1e-9


@pytest.mark.parametrize("edges", [[0.1, 0.1, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, 0.0]])
def test_what_is_flat_stays_in_one_piece(edges: list[float]) -> None:
    corners = np.array(np.meshgrid(*([-1.0, 1.0],) * 3)).reshape(3, 8).T * edges
    assert len(split(corners)) == 1


def test_corners_of_a_box_and_of_what_is_flat() -> None:
    rng = np.random.default_rng(3)
    box = np.array(np.meshgrid(*([-0.1, 0.2],) * 3)).reshape(3, 8).T
    found = corners_of(np.vstack((rng.uniform(-0.1, 0.2, (100, 3)), box)))
    assert sorted(map(tuple, found)) == sorted(map(tuple, box))
    flat = rng.uniform(-1.0, 1.0, (5, 3)) * [1.0, 1.0, 0.0]
    assert np.array_equal(corners_of(flat), flat)


def test_a_point_has_the_least_radius() -> None:
    fit = fit_capsule(np.array([[0.1, 0.2, 0.3]]))
    assert fit.radius == THINNEST
    assert np.allclose(fit.start, [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("least", "touching", "neighbours", "why"),
    [
        (-0.1, 0.99, False, "always"), (-0.1, 0.3, False, "often"), (0.03, 0.0, False, "never"),
        (-0.1, 0.1, True, "neighbours"), (-0.1, 0.1, False, None), (0.01, 0.0, True, None),
    ],
)  # fmt: skip
def test_which_pairs_are_left_out(least: float, touching: float, neighbours: bool, why) -> None:
    assert PairGaps(least, touching).why(neighbours=neighbours) == why


def test_the_smallest_gap_is_sought_beyond_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last link gets below the table only where all joints hang: between few samples."""
    monkeypatch.setattr("identification.capsules.SAMPLES", 60)
    gaps = gaps_over_poses(arm(TABLE), np.full(3, -0.3), np.full(3, 0.3), 0.005)
    exact = 0.5 - 0.4 * np.sin(0.3) - 0.3 * np.sin(0.6) - 0.2 * np.sin(0.9) - 0.03
    assert gaps["link 2", "table"].least == pytest.approx(exact, abs=0.002)
