"""Promptness of answers, by their delays alone."""

import numpy as np
import pytest

from drivers.awaited import Awaited
from drivers.promptness import Promptness

T = 0.01
USUAL_S = 0.0007
RNG = np.random.default_rng


def verdicts(delays_s: np.ndarray) -> np.ndarray:
    promptness = Promptness(T)
    return np.array([promptness.step(delay_s) for delay_s in delays_s.tolist()])


def delays(seed: int, ticks: int = 2000) -> np.ndarray:
    """Answers of a machine at ease."""
    return USUAL_S + RNG(seed).exponential(0.0001, ticks)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.4])
def test_what_a_busy_machine_holds_up_is_found_and_nothing_else(share: float) -> None:
    late = RNG(1).random(2000) < share
    held_up = np.where(late, RNG(2).uniform(0.003, 0.006, 2000), 0.0)
    np.testing.assert_array_equal(verdicts(delays(3) + held_up), ~late)


@pytest.mark.parametrize(
    ("usual", "least"),
    [
        (lambda ticks: RNG(4).uniform(0.0, 0.004, ticks), 0.99),  # an adapter that polls
        (lambda ticks: np.where(np.arange(ticks) < 1000, 0.001, 0.005), 0.95),  # another one
        (lambda ticks: np.where(np.arange(ticks) < 1, 0.005, 0.001), 1.0),
    ],
)
def test_what_is_usual_becomes_so(usual, least: float) -> None:
    assert verdicts(usual(2000)).mean() >= least


def test_without_a_clock_and_without_an_answer_nothing_is_late() -> None:
    awaited = Awaited([1, 2], T)
    for asked_s, clock_s in ((None, 5.0), (0.0, 0.0), (0.0, 0.0)):
        awaited.expect_all(0.0, asked_s)
        assert awaited.left_s(6.0, clock_s) == 6.0 - clock_s
        assert awaited.take(1)
        assert awaited.take(2)
        assert awaited.left_s(6.0, clock_s) is None
        assert awaited.finish().fresh.all()
    awaited.expect_all(0.0, 0.0)
    assert awaited.left_s(0.006, 0.006) == 0.0
    assert not awaited.finish().fresh.any()
    np.testing.assert_array_equal(awaited.freshness.age_s, T)


def test_one_late_answer_makes_none_fresh_and_none_old() -> None:
    awaited = Awaited([1, 2], T)
    for clock_s, fresh in ((0.0, True), (0.005, False), (0.0, True)):
        awaited.expect_all(0.0, 0.0)
        awaited.take(1)
        assert awaited.left_s(0.006, clock_s) is not None
        awaited.take(2)
        assert awaited.left_s(0.006, 0.006) is None
        found = awaited.finish()
        assert found.fresh.all() == found.fresh.any() == fresh
        np.testing.assert_array_equal(found.age_s, 0.0)
