"""Debounce and events of what is past the levels in force."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from common.errors import ModelError
from estimator.contact import Contact
from estimator.contact_detector import ContactDetector
from estimator.levels import Levels
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

LEVELS = Thresholds(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
SIDE = np.array([0, 1])
SPEED = np.array([0.5, -2.0])
NONE = np.zeros(2)
TRANSMISSION = Transmission(
    joints=("a", "b"),
    torque_constant=np.ones(2),
    rotor_inertia=NONE,
    half_gap=np.array([0.01, 0.0]),
    motor_coulomb=np.array([2.0, 0.5]),
    motor_viscous=NONE,
    link_coulomb=NONE,
    link_viscous=NONE,
)


@dataclass
class Detector:
    """The detector of two joints, for whole ticks."""

    debounce: int = 1
    thresholds: Thresholds = LEVELS
    detector: ContactDetector = field(init=False)

    def __post_init__(self) -> None:
        levels = Levels(TRANSMISSION, self.thresholds, EstimatorSettings())
        self.detector = ContactDetector(("a", "b"), levels, self.debounce)
        self.put(NONE, NONE)

    def put(self, uncertainty: np.ndarray, theta_dot: np.ndarray) -> list[float]:
        levels, speed = self.detector.levels, np.abs(theta_dot)
        return [levels.put_in_force(i, 0.0, uncertainty[i], speed[i], 0.01) for i in range(2)]

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


def test_levels_in_force_decide_and_are_reported() -> None:
    levels = Thresholds(np.array([1.0, 2.0]), np.array([3.0, 4.0]), per_speed=np.array([0.2, 0.1]))
    d = Detector(thresholds=levels)
    np.testing.assert_allclose(d.put(np.full(2, 0.4), SPEED), [1.5, 2.6])
    assert d.step([1.49, -2.59], 0.0) == ()
    (contact,) = d.step([1.51, -2.59], 0.1)
    assert (contact.joint, contact.threshold) == ("a", 1.5)
    (collision,) = d.step([3.51, -2.59], 0.1)
    assert (collision.level, collision.threshold) == ("collision", 3.5)
    d.put(np.full(2, 0.4), 0.0 * SPEED)
    assert len(d.step([0.0, -2.59], 0.2)) == 1


def test_a_level_that_sinks_lets_a_contact_begin() -> None:
    """By what was learned; that of collisions stays."""
    d = Detector()
    assert d.step([0.5, 0.0], 0.0) == ()
    np.asarray(d.detector.levels.share)[:] = 0.4
    np.testing.assert_allclose(d.put(NONE, NONE), [0.4, 0.8])
    (contact,) = d.step([0.5, 0.0], 0.1)
    assert (contact.level, contact.threshold) == ("contact", 0.4)
    assert d.step([2.9, 0.0], 0.2) == ()


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
    with pytest.raises(ModelError, match="debounce is 0"):
        Detector(debounce=0)


def test_a_joint_counts_as_touched_once_debounced_and_as_long_as_it_is() -> None:
    d = Detector(debounce=2)
    d.put(NONE, SPEED)
    reported = []
    for r in ([1.5, 0.0], [1.5, 0.0], [1.5, -2.5], [0.5, -2.5], [0.0, 0.0]):
        d.step(r)
        reported.append(d.detector.touched().tolist())
    assert reported == [[False, False], [True, False], [True, False], [False, True], [False, False]]


def test_a_joint_counts_as_hit_past_its_collision_level_likewise() -> None:
    d = Detector(debounce=2)
    reported = []
    for r in ([2.9, -4.5], [3.5, -4.5], [3.5, -3.5], [2.9, 0.0]):
        d.step(r)
        reported.append(d.detector.hit().tolist())
    assert reported == [[False, False], [False, True], [True, False], [False, False]]


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
        d.put(NONE, NONE)
        if d.step([0.2 * r, 0.0], 0.01 * k, (False, bool(missing))):
            found.append(k)
    assert found == begins
