"""Thresholds, dead-band, stiction, debounce and events; and the touched link."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errors import ModelError
from estimator.contact import CLEAR, ContactDetector, dead_band, touched_link
from estimator.thresholds import Thresholds

FINITE = st.floats(-100, 100)
SIDE = np.array([0, 1], dtype=np.int8)
SPEED = np.array([0.5, -2.0])


def detector(debounce: int = 1) -> ContactDetector:
    levels = Thresholds(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    return ContactDetector(("a", "b"), levels, gain=25.0, debounce=debounce)


@given(r=FINITE, threshold=st.floats(0.01, 10))
def test_dead_band_is_the_formula(r: float, threshold: float) -> None:
    expected = np.sign(r) * max(abs(r) - threshold, 0.0)
    result = dead_band(np.array([r]), np.array([threshold]))[0]
    assert result == pytest.approx(expected, abs=1e-12)


def test_the_raise_comes_at_once_and_fades_with_half_the_gain() -> None:
    d = detector()
    at_rest, fast = np.full(2, 0.4), np.zeros(2)
    np.testing.assert_allclose(d.thresholds(fast, SPEED, 0.01), [1.0, 2.0])
    np.testing.assert_allclose(d.thresholds(at_rest, SPEED, 0.01), [1.4, 2.4])
    for k in range(1, 10):
        expected = 0.4 * np.exp(-12.5 * 0.01 * k)
        np.testing.assert_allclose(d.thresholds(fast, SPEED, 0.01), [1 + expected, 2 + expected])


def test_levels_may_grow_with_speed() -> None:
    levels = Thresholds(np.array([1.0, 2.0]), np.array([3.0, 4.0]), per_speed=np.array([0.2, 0.1]))
    d = ContactDetector(("a", "b"), levels, gain=25.0)
    np.testing.assert_allclose(d.thresholds(np.full(2, 0.4), SPEED, 0.01), [1.5, 2.6])
    assert d.step(np.array([1.49, -2.59]), SIDE, 0.0) == ()
    (contact,) = d.step(np.array([1.51, -2.59]), SIDE, 0.1)
    assert (contact.joint, contact.threshold) == ("a", 1.5)
    d.thresholds(np.full(2, 0.4), 0.0 * SPEED, 0.01)
    assert len(d.step(np.array([0.0, -2.59]), SIDE, 0.2)) == 1


@pytest.mark.parametrize(
    ("debounce", "residuals", "at"),
    [
        (1, [0.9, 1.1, 1.2, 0.9, 1.1], [1, 4]),
        (2, [1.1, 0.9, 1.1, 1.1, 1.1], [3]),
        (3, [1.1, 1.1, -1.1, -1.1, -1.1, -1.1], [4]),
        (2, [-1.1, -1.1, 1.1, 1.1], [1, 3]),
        (1, [1.0, -1.0], []),
    ],
)
def test_debounce(debounce: int, residuals: list[float], at: list[int]) -> None:
    d = detector(debounce)
    fired = []
    for k, r in enumerate(residuals):
        for contact in d.step(np.array([r, 2.5]), SIDE, 0.1 * k):
            if contact.joint == "b":  # touched all the time: must not matter to a
                assert k == debounce - 1
                continue
            assert contact.torque == r
            assert contact.time_s == 0.1 * k
            fired.append(k)
    assert fired == at


def test_contact_grows_to_collision() -> None:
    d = detector()
    assert d.step(np.array([0.0, 1.9]), SIDE, 0.0) == ()
    (first,) = d.step(np.array([0.0, -2.5]), SIDE, 1.0)
    assert (first.joint, first.level, first.threshold, first.side) == ("b", "contact", 2.0, 1)
    (second,) = d.step(np.array([0.0, -4.5]), SIDE, 2.0)
    assert (second.level, second.threshold, second.torque) == ("collision", 4.0, -4.5)
    assert d.step(np.array([0.0, -4.6]), SIDE, 3.0) == ()
    both = d.step(np.array([9.0, -4.6]), SIDE, 4.0)
    assert [c.level for c in both] == ["contact", "collision"]


def test_reset_forgets_the_streak() -> None:
    d = detector(2)
    d.step(np.array([1.5, 0.0]), SIDE, 0.0)
    d.reset()
    assert d.step(np.array([1.5, 0.0]), SIDE, 0.1) == ()
    assert len(d.step(np.array([1.5, 0.0]), SIDE, 0.2)) == 1


def test_refusals() -> None:
    levels = Thresholds(np.array([1.0]), np.array([3.0]))
    with pytest.raises(ModelError, match="thresholds for 1 joints, the arm has 2"):
        ContactDetector(("a", "b"), levels, gain=25.0)
    with pytest.raises(ModelError, match="debounce"):
        ContactDetector(("a",), levels, gain=25.0, debounce=0)


def test_a_joint_counts_as_touched_once_debounced_and_as_long_as_it_is() -> None:
    d = detector(debounce=2)
    d.thresholds(np.zeros(2), SPEED, 0.01)
    told = []
    for r in ([1.5, 0.0], [1.5, 0.0], [1.5, -2.5], [0.5, -2.5], [0.0, 0.0]):
        d.step(np.array(r), SIDE, 0.0)
        told.append(d.touched().tolist())
    assert told == [[False, False], [True, False], [True, False], [False, True], [False, False]]


def test_a_joint_counts_as_hit_past_its_collision_level_likewise() -> None:
    d = detector(debounce=2)
    told = []
    for r in ([2.9, -4.5], [3.5, -4.5], [3.5, -3.5], [2.9, 0.0]):
        d.step(np.array(r), SIDE, 0.0)
        told.append(d.hit().tolist())
    assert told == [[False, False], [False, True], [True, False], [False, False]]


def test_collision_levels_are_raised_like_those_of_contacts() -> None:
    d = detector()
    d.thresholds(np.array([0.4, 0.0]), SPEED, 0.01)
    np.testing.assert_allclose(d.collision, [3.4, 4.0])


def test_debounce_and_raise_are_remembered() -> None:
    d = detector(debounce=3)
    d.thresholds(np.full(2, 0.4), SPEED, 0.01)
    for _ in range(2):
        d.step(np.array([1.5, 0.0]), SIDE, 0.0)
    other = detector(debounce=3)
    other.restore(d.memory())
    for each in (d, other):
        np.testing.assert_allclose(
            each.thresholds(np.zeros(2), SPEED, 0.01), [1.0, 2.0] + 0.4 * np.exp(-0.125)
        )
        assert len(each.step(np.array([1.5, 0.0]), SIDE, 0.0)) == 1


# The touched link

LEVEL = np.array([0.8, 0.5, 0.4])


@pytest.mark.parametrize(
    ("strength", "link"),
    [
        ([1.2, 0.0, 0.0], 0),
        ([1.2, -0.9, 0.1], 1),
        ([0.1, 0.0, -1.5], 2),
        ([1.2, CLEAR + 0.01, 0.0], 1),
        ([1.2, CLEAR - 0.01, 0.0], None),  # perhaps the second
        ([1.2, 0.0, 0.2], None),
        ([0.2, 0.1, 0.0], None),
    ],
)
def test_pattern(strength: list[float], link: int | None) -> None:
    assert touched_link(np.array(strength) * LEVEL, LEVEL) == link


def test_a_force_is_never_felt_beyond_its_link(romeo_urdf) -> None:
    # Forces at points of every link, by their Jacobians: the answer is that link or one before.
    model = pin.buildModelFromUrdf(str(romeo_urdf))
    data, rng = model.createData(), np.random.default_rng(3)
    right = 0
    for trial in range(210):
        link = trial % 7
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        jacobian = pin.computeJointJacobian(model, data, q, link + 1)
        point, force = model.inertias[link + 1].lever, rng.normal(size=3)
        torque = jacobian.T @ np.concatenate([force, np.cross(point, force)])
        torque *= 3.0 * 0.2 / np.abs(torque).max()
        answer = touched_link(torque, np.full(7, 0.2))
        assert answer is None or answer <= link
        right += answer == link
    assert right > 80  # many forces have no lever about the link's own joint


@pytest.mark.parametrize(
    ("residual", "absent", "begins"),
    [
        ([9, 9, 9], [0, 0, 0], [0]),
        ([9, 9, 9], [1, 0, 0], [1]),  # the tick that the missing sample comes in
        ([9, 0, 0], [1, 0, 0], []),  # it was not as it was taken to be
        ([9, 9, 9, 9], [1, 1, 1, 1], [2]),  # and no longer than so
        ([9, 0, 9, 9, 9], [1, 0, 1, 1, 1], [4]),  # each contact for itself
        ([9, 9, 9, 9], [0, 1, 1, 1], [0]),  # one that has begun goes on
    ],
)
def test_a_contact_beside_a_missing_sample_waits_for_it(
    residual: list[int], absent: list[int], begins: list[int]
) -> None:
    d, none = detector(), np.zeros(2)
    found = []
    for k, (r, missing) in enumerate(zip(residual, absent, strict=True)):
        d.thresholds(none, none, 0.01)
        other = np.array([False, True]) if missing else None
        if d.step(np.array([0.2 * r, 0.0]), SIDE, 0.01 * k, other):
            found.append(k)
    assert found == begins
