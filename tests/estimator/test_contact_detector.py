"""Levels in force and their raise, debounce and events."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from errors import ModelError
from estimator.contact import Contact
from estimator.contact_detector import ContactDetector
from estimator.motor_position import Side
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

LEVELS = Thresholds(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
SIDE = np.array([0, 1])
SPEED = np.array([0.5, -2.0])
NONE = np.zeros(2)
COULOMB, STICTION = np.array([2.0, 0.5]), np.array([0.4, 0.8])
TRANSMISSION = Transmission(
    joints=("a", "b"),
    torque_constant=np.ones(2),
    rotor_inertia=NONE,
    half_gap=np.array([0.01, 0.0]),
    motor_coulomb=COULOMB,
    motor_viscous=NONE,
    link_coulomb=NONE,
    link_viscous=NONE,
    stiction=STICTION,
)
SETTINGS = EstimatorSettings(stiction_share=0.25, unknown_side_share=0.5)


@dataclass
class Detector:
    """The detector of two joints, for whole ticks."""

    debounce: int = 1
    levels: Thresholds = LEVELS
    detector: ContactDetector = field(init=False)

    def __post_init__(self) -> None:
        settings = EstimatorSettings(debounce=self.debounce)
        self.detector = ContactDetector(("a", "b"), TRANSMISSION, self.levels, settings)

    def thresholds(self, hidden: np.ndarray, theta_dot: np.ndarray, dt: float) -> list[float]:
        speed = np.abs(theta_dot)
        return [self.detector.put_in_force(i, hidden[i], speed[i], dt) for i in range(2)]

    def step(
        self, residual: Sequence[float], time_s: float = 0.0, absent: Sequence[bool] = ()
    ) -> tuple[Contact, ...]:
        beside = any(absent)
        begun = sum(
            self.detector.step(i, residual[i], not (beside and absent[i]), beside) for i in range(2)
        )
        contacts = self.detector.begun(np.array(residual), SIDE, time_s)
        assert len(contacts) == begun
        return contacts


def test_the_raise_comes_at_once_and_fades_with_half_the_gain() -> None:
    d = Detector()
    at_rest, fast = np.full(2, 0.4), np.zeros(2)
    np.testing.assert_allclose(d.thresholds(fast, SPEED, 0.01), [1.0, 2.0])
    np.testing.assert_allclose(d.thresholds(at_rest, SPEED, 0.01), [1.4, 2.4])
    for k in range(1, 10):
        expected = 0.4 * np.exp(-12.5 * 0.01 * k)
        np.testing.assert_allclose(d.thresholds(fast, SPEED, 0.01), [1 + expected, 2 + expected])


def test_levels_may_grow_with_speed() -> None:
    levels = Thresholds(np.array([1.0, 2.0]), np.array([3.0, 4.0]), per_speed=np.array([0.2, 0.1]))
    d = Detector(levels=levels)
    np.testing.assert_allclose(d.thresholds(np.full(2, 0.4), SPEED, 0.01), [1.5, 2.6])
    assert d.step([1.49, -2.59], 0.0) == ()
    (contact,) = d.step([1.51, -2.59], 0.1)
    assert (contact.joint, contact.threshold) == ("a", 1.5)
    d.thresholds(np.full(2, 0.4), 0.0 * SPEED, 0.01)
    assert len(d.step([0.0, -2.59], 0.2)) == 1


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
    d = Detector(debounce)
    fired = []
    for k, r in enumerate(residuals):
        for contact in d.step([r, 2.5], 0.1 * k):
            if contact.joint == "b":  # touched all the time: must not matter to a
                assert k == debounce - 1
                continue
            assert contact.torque == r
            assert contact.time_s == 0.1 * k
            fired.append(k)
    assert fired == at


def test_contact_grows_to_collision() -> None:
    d = Detector()
    assert d.step([0.0, 1.9], 0.0) == ()
    (first,) = d.step([0.0, -2.5], 1.0)
    assert (first.joint, first.level, first.threshold, first.side) == ("b", "contact", 2.0, 1)
    (second,) = d.step([0.0, -4.5], 2.0)
    assert (second.level, second.threshold, second.torque) == ("collision", 4.0, -4.5)
    assert d.step([0.0, -4.6], 3.0) == ()
    both = d.step([9.0, -4.6], 4.0)
    assert [c.level for c in both] == ["contact", "collision"]


def test_reset_forgets_the_streak() -> None:
    d = Detector(2)
    d.step([1.5, 0.0], 0.0)
    d.detector.reset(0)
    assert d.step([1.5, 0.0], 0.1) == ()
    assert len(d.step([1.5, 0.0], 0.2)) == 1


def test_what_is_refused() -> None:
    levels = Thresholds(np.array([1.0]), np.array([3.0]))
    with pytest.raises(ModelError, match="thresholds for 1 joints, the arm has 2"):
        Detector(levels=levels)
    with pytest.raises(ModelError, match="debounce is 0"):
        Detector(debounce=0)


def test_a_joint_counts_as_touched_once_debounced_and_as_long_as_it_is() -> None:
    d = Detector(debounce=2)
    d.thresholds(np.zeros(2), SPEED, 0.01)
    told = []
    for r in ([1.5, 0.0], [1.5, 0.0], [1.5, -2.5], [0.5, -2.5], [0.0, 0.0]):
        d.step(r)
        told.append(d.detector.touched().tolist())
    assert told == [[False, False], [True, False], [True, False], [False, True], [False, False]]


def test_a_joint_counts_as_hit_past_its_collision_level_likewise() -> None:
    d = Detector(debounce=2)
    told = []
    for r in ([2.9, -4.5], [3.5, -4.5], [3.5, -3.5], [2.9, 0.0]):
        d.step(r)
        told.append(d.detector.hit().tolist())
    assert told == [[False, False], [False, True], [True, False], [False, False]]


def test_collision_levels_are_raised_like_those_of_contacts() -> None:
    d = Detector()
    d.thresholds(np.array([0.4, 0.0]), SPEED, 0.01)
    np.testing.assert_allclose(d.detector.collision, [3.4, 4.0])


def raised(i: int, *, rest: float, unknown: float, side: Side, periods: float = 1.0) -> float:
    levels = Thresholds(np.array([0.6, 2.0]), np.array([3.0, 4.0]))
    detector = ContactDetector(("a", "b"), TRANSMISSION, levels, SETTINGS)
    return detector.hidden(i, rest, unknown, side == Side.UNKNOWN, periods)


def test_at_rest_with_nothing_known_all_of_it_is_hidden() -> None:
    # 0.25 and 0.4 of 2 Nm, and half of 0.6; 0.25 and 0.8 of 0.5 Nm, and no gap to be unsure of.
    for i, hidden in enumerate((0.5 + 0.8 + 0.3, 0.125 + 0.4)):
        assert raised(i, rest=1.0, unknown=1.0, side=Side.UNKNOWN) == pytest.approx(hidden)


@pytest.mark.parametrize("side", Side)
def test_it_fades_with_motion_with_what_is_known_and_with_the_side(side: Side) -> None:
    unsure = 0.5 * 0.6 * (side == Side.UNKNOWN)
    assert raised(0, rest=0.5, unknown=0.25, side=side) == pytest.approx(
        0.5 * (0.5 + 0.25 * 0.8) + unsure
    )
    assert raised(1, rest=1.0, unknown=0.5, side=side) == pytest.approx(0.125 + 0.5 * 0.4)


@pytest.mark.parametrize(
    ("periods", "levels"), [(0.0, 0.0), (2.0, 0.0), (2.5, 0.2), (3.0, 0.4), (5.0, 1.2), (9.0, 1.2)]
)
def test_samples_that_were_missing_raise_by_shares_of_the_level(
    periods: float, levels: float
) -> None:
    found = raised(1, rest=0.0, unknown=1.0, side=Side.LEFT, periods=periods)
    assert found == pytest.approx(levels * 2.0)


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
    d = Detector()
    found = []
    for k, (r, missing) in enumerate(zip(residual, absent, strict=True)):
        d.thresholds(NONE, NONE, 0.01)
        if d.step([0.2 * r, 0.0], 0.01 * k, (False, bool(missing))):
            found.append(k)
    assert found == begins
