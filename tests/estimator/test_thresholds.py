"""Thresholds: the levels, and their raise by what stiction may hold and an unknown side pretend."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from errors import ModelError
from estimator.motor_position import Side
from estimator.thresholds import ThresholdRaise, Thresholds

COULOMB, STICTION = np.array([2.0, 0.5]), np.array([0.4, 0.8])
CONTACT, HALF_GAP = np.array([0.6, 0.3]), np.array([0.01, 0.0])


@pytest.mark.parametrize(
    ("contact", "collision", "message"),
    [
        ([1.0, 2.0], [3.0, 2.0], "joint 2"),
        ([1.0, 0.0], [3.0, 2.0], "joint 2"),
        ([-1.0, 1.0], [3.0, 2.0], "joint 1"),
        ([np.nan, 1.0], [3.0, 2.0], "joint 1"),
        ([1.0, 1.0], [3.0, np.inf], "joint 2"),
        ([1.0, 1.0], [3.0], "contact"),
        ([[1.0]], [[3.0]], "contact"),
    ],
)
def test_thresholds_out_of_order(contact: list[Any], collision: list[Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Thresholds(np.array(contact), np.array(collision))


def test_levels_do_not_grow_with_speed_unless_told_to() -> None:
    levels = Thresholds(CONTACT, 1.5 * CONTACT)
    np.testing.assert_array_equal(levels.per_speed, [0.0, 0.0])


@pytest.mark.parametrize("growth", [-0.1, np.nan, np.inf])
def test_growth_that_is_none(growth: float) -> None:
    with pytest.raises(ModelError, match="per_speed"):
        Thresholds(np.ones(1), np.full(1, 2.0), per_speed=np.array(growth))


def test_levels_are_read_only() -> None:
    given = np.array([1.0, 2.0])
    levels = Thresholds(given, np.array([3.0, 4.0]))
    with pytest.raises(ValueError, match="read-only"):
        levels.contact[0] = 9.0
    given[0] = 9.0
    assert levels.contact[0] == 1.0


def raised() -> ThresholdRaise:
    transmission: Any = SimpleNamespace(
        engaged_coulomb=COULOMB, stiction=STICTION, half_gap=HALF_GAP
    )
    settings: Any = SimpleNamespace(stiction_share=0.25, unknown_side_share=0.5)
    return ThresholdRaise(transmission, settings, CONTACT)


def test_at_rest_with_nothing_known_all_of_it() -> None:
    # 0.25 and 0.4 of 2 Nm, and half of 0.6; 0.25 and 0.8 of 0.5 Nm, and no gap to be unsure of.
    np.testing.assert_allclose(raised().most, [0.5 + 0.8 + 0.3, 0.125 + 0.4])


def test_it_fades_with_motion_with_what_is_known_and_with_the_side() -> None:
    rest, unknown = np.array([0.5, 1.0]), np.array([0.25, 0.5])
    sides = np.array([Side.UNKNOWN, Side.UNKNOWN], dtype=np.int8)
    unsure = np.array([0.5 * 0.6, 0.0])
    stiction = np.array([0.5 * (0.5 + 0.25 * 0.8), 0.125 + 0.5 * 0.4])
    np.testing.assert_allclose(raised().at(rest, unknown, sides), stiction + unsure)
    known = np.array([Side.GAP, Side.LEFT], dtype=np.int8)
    np.testing.assert_allclose(raised().at(rest, unknown, known), stiction)
