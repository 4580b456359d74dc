"""Plausibility of positions: jumps need a second one of a later tick."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.plausibility import RECENT, Plausibility

WAY = 5.0


def admitted(ticks: list[list[float]]) -> list[list[bool]]:
    found = Plausibility([1.0, WAY])
    answers = []
    for positions in ticks:
        found.begin_tick()
        answers.append([found.admits(1, position) for position in positions])
    return answers


@pytest.mark.parametrize(
    ("ticks", "answers"),
    [
        ([[0.0], [0.0]], [[False], [True]]),  # the first needs a second, too
        ([[0.0, 0.0], [3.0]], [[False, False], [True]]),
        ([[0.0], [0.0], [9.9], [15.0]], [[False], [True], [True], [True]]),
        ([[0.0], [0.0], [90.0], [1.0]], [[False], [True], [False], [True]]),
        ([[0.0], [0.0], [90.0], [91.0]], [[False], [True], [False], [True]]),
        ([[0.0], [0.0], [90.0, 90.0], [1.0]], [[False], [True], [False, False], [True]]),
        ([[0.0], [0.0], [90.0], [-90.0], [90.0]], [[False], [True], [False], [False], [False]]),
        # Two motors with one id: the other is never taken.
        ([[0.0], *[[0.0, 90.0]] * 3], [[False], *[[True, False]] * 3]),
        ([[0.0], [0.0], *[[]] * RECENT, [1.0]], [[False], [True], *[[]] * RECENT, [False]]),
        ([[0.0], [0.0], [], [14.0]], [[False], [True], [], [True]]),
    ],
)
def test_what_is_admitted(ticks: list[list[float]], answers: list[list[bool]]) -> None:
    assert admitted(ticks) == answers


@given(st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=30))
def test_a_step_beyond_the_way_has_a_witness(positions: list[float]) -> None:
    admits = [answer for [answer] in admitted([[p] for p in positions])]
    taken = [(i, p) for i, p in enumerate(positions) if admits[i]]
    for (i, before), (k, now) in pairwise(taken):
        near = abs(now - before) <= WAY * (min(k - i, RECENT) + 1)
        witnesses = [p for p in positions[max(k - RECENT, i + 1) : k] if abs(p - now) <= WAY * 4]
        assert near or witnesses


@pytest.mark.parametrize(
    ("positions", "speed", "jumped"),
    [
        ([0.0, 0.0, 3.0], 0.0, False),
        ([0.0, 0.0, 90.0, 90.0], 0.0, True),
        ([0.0, 0.0, 90.0, 0.0], 0.0, False),  # it was refused
        ([0.0, 0.0, 50.0, 100.0], 50.0, False),
        ([0.0, 0.0, 0.0, 90.0, 90.0], -50.0, True),
    ],
)
def test_a_motor_that_cannot_have_come_has_jumped(
    positions: list[float], speed: float, jumped: bool
) -> None:
    found = Plausibility([1.0, WAY])
    for position in positions:
        found.begin_tick()
        found.admits(1, position, speed)
    assert found.jumped == [False, jumped]
    found.forget([1])
    assert found.jumped == [False, False]
    assert not found.admits(1, 0.0)
