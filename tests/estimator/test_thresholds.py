"""Thresholds: the levels and what is refused of them."""

from typing import Any

import numpy as np
import pytest

from common.errors import ModelError
from estimator.thresholds import Thresholds

CONTACT = np.array([0.6, 0.3])


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


def test_levels_do_not_grow_with_speed_unless_configured_to() -> None:
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
