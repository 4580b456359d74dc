"""Raise of thresholds: what stiction may hold near rest, and what an unknown side may pretend."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from estimator.motor_position import Side
from estimator.thresholds import ThresholdRaise

COULOMB, STICTION = np.array([2.0, 0.5]), np.array([0.4, 0.8])
CONTACT, HALF_GAP = np.array([0.6, 0.3]), np.array([0.01, 0.0])


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
