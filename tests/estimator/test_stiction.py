"""Friction near rest: what the last motion left, and how much of it is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errors import ModelError
from estimator.stiction import Stiction

PRESLIDING = 0.002


def moved(*displacements: float, stiction: Stiction | None = None) -> Stiction:
    stiction = Stiction(1, PRESLIDING) if stiction is None else stiction
    for displacement in displacements:
        stiction.step(np.array([displacement]))
    return stiction


@pytest.mark.parametrize(
    ("displacements", "z", "unknown"),
    [
        ((), 0.0, 1.0),
        ((0.001,), 0.25, 0.75),
        ((0.004,), 1.0, 0.0),
        ((-0.5,), -1.0, 0.0),
        ((0.5, -0.001), 0.5, 0.0),  # turned round within its pre-sliding
        ((0.5, -0.002), 0.0, 0.0),
        ((0.5, -0.3), -1.0, 0.0),
        ((0.5, -0.001, 0.001), 1.0, 0.0),  # and what it does there it can take back
        ((0.001, -0.001), -0.25, 0.75),
    ],
)
def test_the_last_motion_is_kept(
    displacements: tuple[float, ...], z: float, unknown: float
) -> None:
    stiction = moved(*displacements)
    assert stiction.z[0] == pytest.approx(z)
    assert stiction.unknown[0] == pytest.approx(unknown)


@given(
    begins=st.floats(-1.0, 1.0),
    displacements=st.lists(st.floats(-0.01, 0.01), max_size=30),
)
def test_truth_lies_between_the_ends(begins: float, displacements: list[float]) -> None:
    true, stiction = begins, Stiction(1, PRESLIDING)
    unknown = 1.0
    for displacement in displacements:
        true = min(max(true + displacement / PRESLIDING, -1.0), 1.0)
        stiction.step(np.array([displacement]))
        assert abs(true - stiction.z[0]) <= stiction.unknown[0] + 1e-9
        assert stiction.unknown[0] <= unknown + 1e-9
        unknown = float(stiction.unknown[0])


def test_restart_forgets_and_memory_remembers() -> None:
    stiction = moved(0.5, -0.001)
    other = Stiction(1, PRESLIDING)
    other.restore(stiction.memory())
    assert (other.z[0], other.unknown[0]) == (stiction.z[0], 0.0)
    stiction.restart()
    assert (stiction.z[0], stiction.unknown[0]) == (0.0, 1.0)
    assert other.unknown[0] == 0.0
    with pytest.raises(ModelError, match="Stiction"):
        other.restore({"ends": [[0.0, 0.0]]})
