"""Identified thresholds: the chosen rate of false alarms, and nothing learned from a touch."""

from dataclasses import replace

import numpy as np
import pytest

from errors import LogError
from estimator.identification.thresholds import (
    LevelSettings,
    LevelVerdict,
    gumbel_level,
    identify_levels,
)

T = 0.01
PLAIN = LevelSettings(
    contact_per_hour=1.0,
    collision_per_hour=0.01,
    floor=np.array([0.05, 0.05]),
    ceiling=np.array([2.0, 2.0]),
)


def noise(seconds: float, seed: int = 0) -> np.ndarray:
    """Residuals of two joints as a filter of 25 /s leaves them, 0.1 and 0.2 Nm."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((round(seconds / T), 2))
    r = np.zeros_like(white)
    for k in range(1, len(r)):
        r[k] = 0.78 * r[k - 1] + 0.63 * white[k]
    return r * [0.1, 0.2]


def learn(r: np.ndarray, touched: np.ndarray | None = None, settings: LevelSettings = PLAIN):
    nobody = np.zeros(len(r), dtype=bool)
    return identify_levels(
        ("a", "b"), T, r, np.zeros_like(r), nobody if touched is None else touched, settings
    )


def test_false_alarms_come_at_the_chosen_rate():
    short, long = noise(120.0, seed=2), np.abs(noise(1200.0, seed=1))
    maxima = np.abs(short).reshape(-1, 100, 2).max(axis=1)
    for i, found in enumerate(learn(short)):
        r = long[:, i]
        # The level alone, at a rate that can be counted: 40 in 20 minutes, give or take.
        level = gumbel_level(maxima[:, i], 120.0)
        alarms = (r.reshape(-1, 100).max(axis=1) > level).sum()
        assert 10 <= alarms <= 100
        assert (r.reshape(-1, 100).max(axis=1) > found.contact).sum() <= 3
        assert found.contact < 1.6 * r.max()
        assert found.collision >= 3.0 * found.contact


def test_a_touch_teaches_nothing():
    r = noise(120.0)
    calm = learn(r)
    touched = np.zeros(len(r), dtype=bool)
    r = r.copy()
    r[4000:4200, 0] += 5.0
    touched[4010:4190] = True  # the detector needs its time, and its debounce
    for before, after in zip(calm, learn(r, touched), strict=True):
        assert after.verdict is LevelVerdict.GOOD
        assert after.contact == pytest.approx(before.contact, rel=0.05)


def test_a_touch_that_no_threshold_noticed_stands_out():
    r = noise(120.0)
    calm = learn(r)
    r = r.copy()
    r[4000:4050, 0] += 5.0
    assert learn(r)[0].contact == pytest.approx(calm[0].contact, rel=0.05)


def test_a_quiet_joint_may_twitch_below_its_floor():
    """A touch is not only many times what is usual, but also more than the floor."""
    r = noise(120.0)
    r[:, 0] *= 1e-3
    r[::300, 0] = 0.04
    assert [level.verdict for level in learn(r)] == [LevelVerdict.GOOD] * 2
    r[::300, 0] = 0.06
    assert {level.verdict for level in learn(r)} == {LevelVerdict.TOUCHED}


def test_what_is_touched_all_the_time_is_refused():
    r = noise(120.0)
    touched = np.zeros(len(r), dtype=bool)
    touched[::300] = True
    assert {level.verdict for level in learn(r, touched)} == {LevelVerdict.TOUCHED}


def test_floor_ceiling_and_too_little_motion():
    high = replace(PLAIN, floor=np.array([1.5, 0.05]), ceiling=np.array([2.0, 0.3]))
    first, second = learn(noise(60.0), settings=high)
    assert (first.verdict, first.contact) == (LevelVerdict.GOOD, 1.5)
    assert second.verdict is LevelVerdict.CEILING
    assert learn(noise(20.0))[0].verdict is LevelVerdict.SHORT


def test_the_raise_near_rest_is_not_learned_twice():
    r = noise(60.0)
    raised = np.full_like(r, 0.2)
    nobody = np.zeros(len(r), dtype=bool)
    low = identify_levels(("a", "b"), T, r, raised, nobody, PLAIN)
    assert low[1].contact < learn(r)[1].contact - 0.1


def test_a_residual_that_is_no_number_is_refused():
    r = noise(60.0)
    r[7, 1] = np.nan
    with pytest.raises(LogError, match="not a number"):
        learn(r)


def test_no_level_below_what_was_seen():
    """However many false alarms are bearable: what happened in a minute happens again."""
    found = learn(noise(120.0), settings=replace(PLAIN, contact_per_hour=600.0))[0]
    assert found.verdict is LevelVerdict.GOOD
    assert found.contact == pytest.approx(1.1 * found.largest)
