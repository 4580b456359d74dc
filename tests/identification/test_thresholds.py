"""Identified thresholds: the chosen rate of false alarms, and nothing learned from a touch."""

from dataclasses import replace

import numpy as np
import pytest

from common.errors import LogError
from identification.thresholds import (
    LevelSettings,
    LevelVerdict,
    Motion,
    growth,
    gumbel_level,
    identify_levels,
)

T = 0.01
PLAIN = LevelSettings(
    contact_per_hour=1.0,
    collision_per_hour=0.01,
    floor=np.array([0.05, 0.05]),
    ceiling=np.array([2.0, 2.0]),
    half_gap=np.zeros(2),
)


def noise(seconds: float, seed: int = 0) -> np.ndarray:
    """Residuals of two joints as a filter of 25 /s leaves them, 0.1 and 0.2 Nm."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((round(seconds / T), 2))
    r = np.zeros_like(white)
    for k in range(1, len(r)):
        r[k] = 0.78 * r[k - 1] + 0.63 * white[k]
    return r * [0.1, 0.2]


def motion(r: np.ndarray, amplitude: tuple[float, float] = (0.5, 0.5)) -> Motion:
    """Contact-free swings of both joints, with these residuals."""
    t = T * np.arange(len(r))
    swing = np.outer(np.sin(2.0 * t), amplitude)
    return Motion(
        time_s=t,
        position=swing,
        velocity=np.gradient(swing, T, axis=0),
        residual=r,
        raised=np.zeros_like(r),
        touched=np.zeros(r.shape, dtype=bool),
        uncertain=np.zeros(len(r), dtype=bool),
    )


def learn(r: np.ndarray, touched: np.ndarray | None = None, settings: LevelSettings = PLAIN):
    """Levels of two joints, the first of which is `touched` (N,)."""
    moved = motion(r)
    if touched is not None:
        moved.touched[:, 0] = touched
    return identify_levels(("a", "b"), T, moved, settings)


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


@pytest.mark.parametrize(("times", "alone_s"), [(1.0, np.nan), (1.7, np.nan), (2.5, 40.0)])
def test_a_residual_that_stands_alone_is_named(times: float, alone_s: float) -> None:
    """A touch too weak to be left out raised the level by 70 %; it lasts into the next second."""
    r = noise(120.0)
    r[4080:4140, 1] = times * np.abs(r).max()
    found = learn(r, settings=replace(PLAIN, floor=np.full(2, 9.0), ceiling=np.full(2, 20.0)))
    np.testing.assert_equal([one.alone_s for one in found], [np.nan, alone_s])


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
    rests = np.arange(len(r)) % 100 < 45
    r[rests] *= 3.0
    raised = np.where(rests[:, None], 1.0, np.zeros_like(r))
    low = identify_levels(("a", "b"), T, replace(motion(r), raised=raised), PLAIN)
    assert low[1].contact < learn(r)[1].contact - 0.1
    assert low[1].largest < np.abs(r[:, 1]).max() - 0.1


def test_a_raise_that_never_ends_hides_nothing():
    """As where the side of a gap never shows: a lower level is raised by less."""
    r = noise(60.0)
    raised = np.zeros_like(r)
    raised[:, 1] = 5.0
    found = identify_levels(("a", "b"), T, replace(motion(r), raised=raised), PLAIN)
    assert [one.contact for one in found] == [one.contact for one in learn(r)]
    assert found[1].largest == pytest.approx(np.abs(r[:, 1]).max(), rel=0.2)


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


def test_a_joint_that_did_not_move_gets_no_level():
    """However quiet it was; its gap is no motion."""
    r = noise(120.0)
    moved = motion(r, amplitude=(0.0005, 0.5))
    still, good = identify_levels(("a", "b"), T, moved, PLAIN)
    assert (still.verdict, good.verdict) == (LevelVerdict.STILL, LevelVerdict.GOOD)
    assert np.isnan(still.contact)
    assert "1 mrad" in still.reason
    wide = replace(PLAIN, half_gap=np.array([0.05, 0.0]))
    within_its_gap = motion(r, amplitude=(0.05, 0.5))
    assert identify_levels(("a", "b"), T, within_its_gap, wide)[0].verdict is LevelVerdict.STILL


def test_what_was_discarded_is_listed_with_time_and_size():
    r = noise(120.0)
    r[4000:4020, 0] += 3.1
    touched, other = learn(r)
    assert touched.verdict is LevelVerdict.GOOD  # one stretch may have been a hand
    (stretch,) = touched.discarded
    assert stretch.at_s == pytest.approx(40.0, abs=1.0)
    assert stretch.largest == pytest.approx(3.1, abs=0.3)
    assert other.discarded == ()


@pytest.mark.parametrize("noticed", [True, False])
def test_several_spikes_are_good_only_if_a_person_answers_for_them(noticed):
    """Whether the old thresholds noticed them or they stand out."""
    r = noise(120.0)
    touched = np.zeros(len(r), dtype=bool)
    for begin in (3000, 7000):
        r[begin : begin + 30, 0] += 3.1
        touched[begin : begin + 30] = noticed
    doubtful, other = learn(r, touched)
    assert doubtful.verdict is LevelVerdict.UNLESS_YOU
    assert len(doubtful.discarded) == 2
    assert other.verdict is LevelVerdict.GOOD  # it took no part
    assert learn(r, touched, replace(PLAIN, it_was_me=True))[0].verdict is LevelVerdict.GOOD


def test_a_spike_of_one_joint_is_doubtful_beside_one_of_another():
    r = noise(120.0)
    r[3000:3030, 0] += 3.1
    r[7000:7030, 1] += 3.1
    assert [one.verdict for one in learn(r)] == [LevelVerdict.UNLESS_YOU] * 2


def test_residuals_that_are_not_sure_are_no_touches():
    r = noise(120.0)
    moved = motion(r)
    for begin in (3000, 7000):
        moved.uncertain[begin : begin + 30] = True
        r[begin : begin + 30] += 3.1
    assert [one.verdict for one in identify_levels(("a", "b"), T, moved, PLAIN)] == [
        LevelVerdict.GOOD
    ] * 2


def test_what_grows_with_speed_is_found_and_lowers_the_level_at_rest():
    rng = np.random.default_rng(3)
    speed = rng.uniform(0.0, 1.0, (120, 1)) * np.ones(100)
    noise_of_each = 0.02 * rng.standard_normal(speed.shape)
    beyond = 0.1 + 0.4 * speed + noise_of_each
    assert growth(beyond, speed, 1.0) == pytest.approx(0.4, abs=0.06)
    assert growth(0.3 + noise_of_each, speed, 1.0) == 0.0
    assert growth(beyond, np.zeros_like(speed), 1.0) == 0.0


def test_a_level_that_grows_with_speed_still_bears_what_came_at_rest():
    """The largest residual of each block lies where the joint stands, however fast it is later."""
    speed = np.tile(np.linspace(0.0, 1.0, 100), (120, 1))
    beyond = np.where(speed < 0.2, 0.5, 0.1)
    assert growth(beyond, speed, 1.0) == 0.0


def test_a_level_says_what_it_has_seen():
    """Log of joints that swing by 0.5 and 0.2 rad, at 1 and 0.4 rad/s."""
    first, second = identify_levels(("a", "b"), T, motion(noise(60.0), (0.5, 0.2)), PLAIN)
    assert first.seen.speed == pytest.approx(1.0, rel=0.02)
    assert (second.seen.lower, second.seen.upper) == pytest.approx((-0.2, 0.2), rel=0.02)
