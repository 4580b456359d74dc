"""Trends: what grows, and what only varies."""

import numpy as np
import pytest

from bench.soak.trend import Bound, trend

TIMES = [float(t) for t in range(120)]


def noise(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 20.0, len(TIMES))


@pytest.mark.parametrize(
    ("values", "grows"),
    [
        (1000.0 + noise(), False),
        (1000.0 + noise() + 2.0 * np.array(TIMES), True),  # by 118 in the second half
        (1000.0 - 2.0 * np.array(TIMES), False),
        # A start that takes memory, once.
        (1000.0 + 500.0 * (np.array(TIMES) > 30.0), False),
        # A few bad moments of a busy machine.
        (1000.0 + 1e5 * (np.arange(120) % 10 == 9), False),
        (1000.0 + np.maximum(0.0, np.array(TIMES) - 60.0) * 3.0, True),
    ],
)
def test_a_trend_is_a_growth_that_lasts(values: np.ndarray, grows: bool) -> None:
    found = trend("x", Bound("kB", share=0.05, least=10.0), TIMES, list(values))
    assert found.grows is grows, found


def test_too_few_samples_are_no_trend() -> None:
    with pytest.raises(ValueError, match="too few"):
        trend("x", Bound("", 0.0, 1.0), [1.0, 2.0, 3.0], [1.0, 1.0, 1.0])
