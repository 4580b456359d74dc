"""Verdict on a friction that explains too little: what helps, wherever gravity fits."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from identification.friction_verdict import Verdict, verdict_on
from identification.regression import Solution

MOVING = 0.5 * np.sin(np.linspace(0.0, 60.0, 2000))


@pytest.mark.parametrize("gravity", [0.96, 1.0, 1.049, 1.06, 1.2, 1.4, float("nan")])
def test_a_poor_fit_asks_for_masses_whatever_gravity_says(gravity: float) -> None:
    """With torque constants 3 % off, gravity fits within 5 %, and friction at R2 0.88."""
    solved = cast(Solution, SimpleNamespace(condition=5.0, r2=0.88))
    verdict, reason = verdict_on(MOVING, 0.0, gravity, solved)
    assert verdict in (Verdict.BAD_FIT, Verdict.WRONG_GRAVITY)
    assert "`contactd identify masses`" in reason


def test_a_fit_that_nothing_is_left_to_test_asks_for_more_motion() -> None:
    solved = cast(Solution, SimpleNamespace(condition=5.0, r2=-np.inf))
    verdict, reason = verdict_on(MOVING, 0.0, 1.0, solved)
    assert verdict is Verdict.BAD_FIT
    assert "inf" not in reason
    assert "longer" in reason
