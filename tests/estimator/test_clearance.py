"""Gaps between capsules, planes and boxes: distances against coal, gradients by differences."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from tests.estimator.plain import built, plain
from tests.estimator.test_dynamics import ours, random_tree

N = 9


def rotation(rng: np.random.Generator) -> np.ndarray:
    return pin.exp3(rng.normal(size=3))


def scene(seed: int, module=None, model=None):
    """A tree of joints of both kinds, a capsule on each and on the root, all pairs of them, and of
    each with planes and boxes; a few are spheres, or parallel to others."""
    rng = np.random.default_rng(seed)
    made = module or built()["clearance"]
    model = model or random_tree()
    capsules = []
    for body in range(-1, N):
        start, end = 0.3 * rng.normal(size=(2, 3))
        end = start if body % 4 == 0 else start + 0.2 * np.eye(3)[0] if body % 4 == 1 else end
        capsules.append(made.Capsule(f"link {body}", body, start, end, rng.uniform(0.01, 0.1)))
    normals = [axis / np.linalg.norm(axis) for axis in rng.normal(size=(3, 3))]
    planes = [made.Plane("plane", normal, rng.normal()) for normal in normals]
    boxes = [
        made.Box("box", rng.normal(size=3), rotation(rng), rng.uniform(0.05, 0.6, 3))
        for _ in range(4)
    ]
    pairs = [(a, b) for i, a in enumerate(capsules) for b in capsules[:i]]
    pairs += [(a, other) for a in capsules for other in (*planes, *boxes)]
    bodies = _bodies(model)
    return model, made.Clearance(bodies, capsules, pairs), pairs


def _bodies(model: pin.Model) -> list:
    return ours(model, _Recorder).bodies


class _Recorder:
    """In place of the module of the dynamics: keeps the bodies."""

    class Dynamics:
        def __init__(self, bodies, gravity) -> None:
            self.bodies = bodies


def placed(model: pin.Model, q: np.ndarray, capsule) -> tuple[coal.Capsule, coal.Transform3s]:
    """A capsule as coal has it: along its z, about its middle."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    M = data.oMi[capsule.body + 1] if capsule.body >= 0 else pin.SE3.Identity()
    a, b = M.act(capsule.start), M.act(capsule.end)
    length = np.linalg.norm(b - a)
    R = np.eye(3)
    if length > 0.0:
        R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), (b - a) / length).matrix()
    return coal.Capsule(capsule.radius, length), coal.Transform3s(R, 0.5 * (a + b))


def other_placed(model, q, other, made):
    if isinstance(other, made.Capsule):
        return placed(model, q, other)
    if isinstance(other, made.Plane):
        return coal.Halfspace(other.normal, other.offset), coal.Transform3s.Identity()
    return coal.Box(*(2.0 * other.half)), coal.Transform3s(other.axes, other.centre)


@pytest.mark.parametrize("seed", range(4))
def test_the_smallest_gap_of_each_pair_is_that_of_coal(seed: int) -> None:
    made = built()["clearance"]
    model, clearance, pairs = scene(seed)
    q = np.random.default_rng(100 + seed).normal(size=N)
    clearance.at(q)
    gap, pair = np.asarray(clearance.gap), np.asarray(clearance.pair)
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    compared = 0
    for k, (first, second) in enumerate(pairs):
        result = coal.DistanceResult()
        other, there = other_placed(model, q, second, made)
        expected = coal.distance(*placed(model, q, first), other, there, request, result)
        found = gap[pair == k].min()
        if isinstance(second, made.Box) and expected < 0.0:
            # Coal's depth leaves a box by an edge, too; ours by a face, which is further.
            assert found <= max(expected + 1e-3, -first.radius)
        else:
            assert found == pytest.approx(expected, abs=2e-5), (first, second)
            compared += 1
    assert compared > 80


@pytest.mark.parametrize("seed", range(3))
def test_gradients_are_those_of_the_gaps(seed: int) -> None:
    _, clearance, _ = scene(seed)
    q = np.random.default_rng(200 + seed).normal(size=N)
    clearance.at(q)
    gradient, step = np.array(clearance.gradient), 1e-6
    gaps = []
    for side in (step, -step):
        shifted = []
        for j in range(N):
            clearance.at(q + side * np.eye(N)[j])
            shifted.append(np.array(clearance.gap))
        gaps.append(np.array(shifted).T)
    numeric = (gaps[0] - gaps[1]) / (2.0 * step)
    wrong = np.abs(numeric - gradient).max(axis=1) > 1e-4
    # Differences across an edge of a box, or the end of a segment, are of neither side.
    assert wrong.sum() <= 3, np.flatnonzero(wrong)
    assert np.abs(gradient).max() > 0.5


def test_compiled_and_plain_are_the_same_to_the_last_bit() -> None:
    modules = plain()
    q = np.random.default_rng(3).normal(size=N)
    results, model = [], random_tree()
    for module in (built()["clearance"], modules["clearance"]):
        _, clearance, _ = scene(5, module, model)
        clearance.at(q)
        results.append((np.array(clearance.gap), np.array(clearance.gradient)))
    assert np.array_equal(results[0][0], results[1][0])
    assert np.array_equal(results[0][1], results[1][1])


def test_parallel_segments_have_the_gaps_of_both_ends() -> None:
    made = built()["clearance"]
    bodies = _bodies(random_tree())
    x, up = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    low = made.Capsule("low", -1, 0 * x, x, 0.1)
    high = made.Capsule("high", -1, 0.5 * up - x, 0.6 * up + 2 * x, 0.1)
    clearance = made.Clearance(bodies, [low, high], [(low, high)])
    clearance.at(np.zeros(N))
    first = np.hypot(3.0, 0.1)
    assert np.all(np.asarray(clearance.gap) > 0.25)
    ends = sorted(np.asarray(clearance.gap)[1:3])
    assert ends[0] == pytest.approx((1.5 + 0.1) / first - 0.2, abs=1e-9)
    assert ends[1] == pytest.approx((1.5 + 0.2) / first - 0.2, abs=1e-9)


def test_the_gradient_of_a_segment_that_pierces_a_box_is_between_two_faces() -> None:
    made, model, right = built()["clearance"], random_tree(), 0
    x, step = np.eye(3)[0], 1e-6
    link = made.Capsule("link", 8, -x, x, 0.01)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        q = rng.normal(size=N)
        middle = placed(model, q, link)[1].getTranslation() + rng.uniform(-0.05, 0.05, 3)
        box = made.Box("box", middle, rotation(rng), rng.uniform(0.05, 0.3, 3))
        clearance = made.Clearance(_bodies(model), [link], [(link, box)])
        gaps = []
        for j in range(N):
            for side in (step, -step):
                clearance.at(q + side * np.eye(N)[j])
                gaps.append(clearance.gap[0])
        clearance.at(q)
        assert clearance.gap[0] < -link.radius
        numeric = -np.diff(np.reshape(gaps, (N, 2)))[:, 0] / (2.0 * step)
        right += bool(np.abs(numeric - clearance.gradient[0]).max() < 1e-3)
    assert right >= 38
