"""Alarms and the levels that would have been quiet, by tables and against a plain definition."""

import numpy as np
import pytest

from bench.study.scores import count_alarms, quiet_threshold
from estimator.alarms import critical_level
from estimator.thresholds import LEAST_SHARE


@pytest.mark.parametrize(
    ("residual", "count"),
    [
        ([0, 0, 0], 0),
        ([1, 1, 1], 0),  # at the threshold is not beyond
        ([2, 2, 2], 1),
        ([2, 0, -2], 2),
        ([0, 2, -2, 0, 3], 2),  # straight to the other side is one stretch
    ],
)
def test_an_alarm_is_a_stretch_beyond_the_threshold(residual: list[float], count: int) -> None:
    columns = np.array([residual, np.zeros(len(residual))], dtype=float).T
    assert count_alarms(columns, np.ones(2)).tolist() == [count, 0]


def test_the_quiet_threshold_raises_no_alarm_and_no_lower_one_is_quiet() -> None:
    rng = np.random.default_rng(1)
    residual, raised = rng.normal(size=(500, 3)), rng.uniform(0, 0.5, (500, 3))
    quiet = quiet_threshold(residual, raised)
    assert not count_alarms(residual, quiet + raised + 1e-12).any()
    assert (count_alarms(residual, 0.999 * quiet + raised) > 0).all()
    assert quiet_threshold(residual, raised + 10.0).tolist() == [0, 0, 0]


def in_force(level: float, share: float, configured: float, threshold: float) -> float:
    """Threshold that would have been in force, by the definition."""
    needed = share * configured
    sunk = min(max(needed, LEAST_SHARE * level), level) if share < 1.0 else level
    return threshold - needed + sunk


@pytest.mark.parametrize("learned", [False, True])
def test_a_tick_alarms_below_its_critical_level_and_at_no_higher_one(learned: bool) -> None:
    rng = np.random.default_rng(2)
    configured = 0.7
    for _ in range(300):
        share = float(rng.uniform(LEAST_SHARE, 1.0)) if learned else 1.0
        threshold = share * configured + float(rng.uniform(0.0, 0.5))
        r = float(rng.normal(0.0, 0.8))
        rows = np.array([[r]]), np.array([[threshold]]), np.array([configured])
        (critical,) = critical_level(*rows, np.array([[share]]) if learned else None)[0]
        for level in rng.uniform(0.01, 6.0, 40):
            alarm = abs(r) > in_force(float(level), share, configured, threshold)
            assert alarm == (level < critical)
