"""Friction near rest: what the last motion left, and how much of it is known."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.stiction import Stiction, displacement

PRESLIDING = 0.002


def moved(*displacements: float, stiction: Stiction | None = None) -> Stiction:
    stiction = Stiction(1, PRESLIDING) if stiction is None else stiction
    for turned in displacements:
        stiction.step(0, turned)
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
    assert stiction.z(0) == pytest.approx(z)
    assert stiction.unknown(0) == pytest.approx(unknown)


@given(
    begins=st.floats(-1.0, 1.0),
    displacements=st.lists(st.floats(-0.01, 0.01), max_size=30),
)
def test_truth_lies_between_the_ends(begins: float, displacements: list[float]) -> None:
    true, stiction = begins, Stiction(1, PRESLIDING)
    unknown = 1.0
    for turned in displacements:
        true = min(max(true + turned / PRESLIDING, -1.0), 1.0)
        stiction.step(0, turned)
        assert abs(true - stiction.z(0)) <= stiction.unknown(0) + 1e-9
        assert stiction.unknown(0) <= unknown + 1e-9
        unknown = stiction.unknown(0)


@pytest.mark.parametrize(
    ("theta_dot", "q_dot", "has_gap", "turned"),
    [
        (0.004, 0.0, True, 0.00004),  # the rotor runs through its gap, the link stands
        (0.004, 0.0, False, 0.00001),  # the same without a gap: an error of the velocity
        (-0.3, 0.3, True, -0.003),
        (-0.3, 0.3, False, 0.00001),
        (0.002, 0.009, True, 0.00001),  # both creep
        (0.002, -0.011, True, 0.00002),
    ],
)
def test_what_turns_a_rotor(theta_dot: float, q_dot: float, has_gap: bool, turned: float) -> None:
    moved = 0.00001
    assert displacement(theta_dot, q_dot, moved, has_gap, 0.01) == pytest.approx(turned)


def test_restart_forgets() -> None:
    stiction = moved(0.5, -0.001)
    assert stiction.unknown(0) == 0.0
    stiction.restart(0)
    assert (stiction.z(0), stiction.unknown(0)) == (0.0, 1.0)
