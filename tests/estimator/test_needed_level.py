"""The share of its configured level that a joint needs, as its motion shows."""

from typing import Any

import numpy as np
import pytest

from tests.estimator.one_learning import DT, FOUND, LEVEL, found, fresh, teach


def shown(
    seconds: float,
    size: float,
    learning: Any = None,
    *,
    level: float = 1.0,
    friction: float = 0.0,
    raised: float = 0.0,
    moving: bool = True,
    flips: bool = False,
) -> Any:
    """Learning after a constant residual, or one whose sign alternates (`flips`). Residual, level
    in force, and its parts for friction and transients are shares of the configured level. Nothing
    is corrected."""
    learning = learning or fresh()
    for tick in range(round(seconds / DT)):
        size = -size if flips and tick else size
        parts = {"friction": friction * LEVEL, "raised": raised * LEVEL}
        teach(learning, size * LEVEL, level * LEVEL, **parts, moving=moving)
    return learning


def needed(seconds: float, size: float) -> float:
    """2.9 root mean squares over 5 minutes, after 10 s in which they were a whole level."""
    faded = np.exp(-seconds / 300.0)
    squares = 10.0 / 2.9**2 * faded + 300.0 * size**2 * (1.0 - faded)
    return float(2.9 * np.sqrt(squares / (10.0 * faded + 300.0 * (1.0 - faded))))


@pytest.mark.parametrize("size", [0.05, 0.15, 0.3, -0.3])
def test_the_level_sinks_as_quiet_motion_goes_on(size: float) -> None:
    learning, before = fresh(), 1.0
    assert learning.needed.level(0) == pytest.approx(1.0)
    for minute in range(1, 12):
        level = shown(60.0, size, learning).needed.level(0)
        assert level == pytest.approx(max(needed(60.0 * minute, size), 0.2), rel=1e-3)
        assert 0.2 <= level <= before
        before = level


def test_the_level_is_between_a_fifth_and_the_whole_configured_one() -> None:
    learning = shown(3600.0, 0.0)
    assert learning.needed.level(0) == 0.2
    shown(1200.0, 0.9, learning, level=2.0, friction=1.0, flips=True)
    assert 2.9 * np.sqrt(learning.needed.squares_s[0] / learning.needed.moved_s[0]) > 1.5
    assert learning.needed.level(0) == 1.0
    assert shown(1.0, 1.9, level=2.0).needed.level(0) == 1.0
    assert shown(0.0, 0.0).needed.level(0) <= 1.0


def test_a_peak_raises_the_level_by_a_tenth_once_it_is_over() -> None:
    learning = shown(1800.0, 0.0)
    shown(DT, 0.6, learning)
    shown(0.29, 0.0, learning)
    assert learning.needed.level(0) == 0.2
    shown(0.05, 0.0, learning)
    assert learning.needed.level(0) == pytest.approx(1.1 * 0.2, rel=1e-3)


def test_repeated_peaks_raise_the_level_to_what_they_need_which_fades_slowly() -> None:
    """By a tenth each, so that a few pushes below the level raise it little."""
    learning, level = shown(1800.0, 0.0), 0.2
    for _ in range(30):
        shown(0.5, 0.0, shown(DT, 0.6, learning))
        assert learning.needed.level(0) <= 1.1 * level + 1e-9
        level = learning.needed.level(0)
    assert level == pytest.approx(1.6 * 0.6, rel=2e-2)
    for minutes in (2.5, 5):
        shown(150.0, 0.0, learning)
        assert learning.needed.level(0) == pytest.approx(level * np.exp(-minutes / 5), rel=2e-3)
    shown(DT, 0.2, learning)  # a smaller one has no effect
    assert learning.needed.level(0) == pytest.approx(level * np.exp(-1.0), rel=2e-3)


def test_a_peak_that_ends_in_a_contact_is_not_counted() -> None:
    learning = shown(1800.0, 0.0)
    before = learning.needed.level(0)
    shown(DT, 0.6, shown(0.2, 0.6, learning, raised=0.3))
    shown(DT, 1.01, learning)
    assert (learning.needed.peak_seen[0], learning.needed.crossing_seen[0]) == (0.0, 0.0)
    squares = learning.needed.squares_s[0]
    shown(0.2, 0.9, learning)  # as it ends
    assert learning.needed.peak_seen[0] == 0.0
    assert learning.needed.squares_s[0] == squares
    shown(1.0, 0.0, learning)
    assert learning.needed.level(0) == before
    assert learning.needed.peak[0] < 1e-3


def test_a_peak_counts_less_the_friction_near_rest() -> None:
    learning = shown(DT, 0.7, level=2.0, friction=0.4)
    assert learning.needed.peak_seen[0] == pytest.approx(0.3)
    learning = fresh()
    learning.unknown[0] = 0.5 * LEVEL  # which raises by as much, times the share that is needed
    shown(DT, 0.6, learning)
    assert learning.needed.peak_seen[0] == pytest.approx(0.4)


def test_a_residual_that_stays_large_is_not_counted() -> None:
    """A push just below the level; motion counts again once the residual was small."""
    brief, first, lasting = (
        shown(seconds, 0.9, shown(1800.0, 0.1, flips=True)) for seconds in (0.5, 1.0, 60.0)
    )
    assert found(lasting) == found(first)
    assert brief.needed.peak_seen[0] == pytest.approx(0.9, rel=1e-2)
    assert lasting.needed.peak_seen[0] == 0.0
    shown(0.35, 0.1, brief)
    shown(0.35, 0.1, lasting)
    assert brief.needed.peak[0] > 0.19
    assert lasting.needed.peak[0] < 0.11
    moved_s = float(lasting.needed.moved_s[0])
    shown(DT, 0.4, lasting)
    assert lasting.needed.moved_s[0] == moved_s, "as long as it may lean"
    shown(15.0, 0.1, lasting, flips=True)
    assert lasting.needed.moved_s[0] > moved_s
    shown(DT, 0.95, lasting)
    assert 0.7 < lasting.needed.peak_seen[0] <= 0.95  # less what leaned


@pytest.mark.parametrize(
    ("size", "how"),
    [
        (0.4, {"moving": False}),
        (1.01, {}),  # a contact
        (0.5, {"level": 0.4}),
        (0.4, {"moving": False, "raised": 0.3}),
        (1.01, {"raised": 0.3}),
        (np.nan, {"raised": 0.3}),
        (np.nan, {}),
        (np.inf, {}),
    ],
)
def test_contacts_rest_and_invalid_residuals_are_not_counted(
    size: float, how: dict[str, Any]
) -> None:
    learning = shown(600.0, 0.1)
    before = found(learning)
    assert found(shown(0.9, size, learning, **how)) == before


# --- while a gap is crossed ----------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.05, 0.3, 0.5])
def test_the_level_while_a_gap_is_crossed_is_found_apart(size: float) -> None:
    """1.8 peaks, from one of a whole level on, which fades in 20 s of crossing; 0.7 at least."""
    learning = shown(600.0, 0.1)
    before = found(learning, FOUND[:3])
    assert learning.needed.crossing_level(0) == 1.0
    for seconds in range(4, 80, 4):
        shown(4.0, size, learning, raised=0.06)
        peak = max(np.exp(-seconds / 20.0), size)
        level = min(max(1.8 * peak, 0.7), 1.0)
        assert learning.needed.crossing_level(0) == pytest.approx(level, rel=0.01)
    assert found(learning, FOUND[:3]) == before


def test_a_crossing_is_over_when_little_is_left_of_its_raise() -> None:
    learning = shown(60.0, 0.1, raised=0.3)
    crossing, moved_s = learning.needed.crossing_level(0), learning.needed.moved_s[0]
    shown(60.0, 0.4, learning, raised=0.04)
    assert learning.needed.crossing_level(0) == crossing
    assert learning.needed.moved_s[0] > moved_s


def test_a_peak_of_a_crossing_counts_less_the_friction_near_rest() -> None:
    learning = shown(600.0, 0.0, raised=0.3)
    shown(DT, 0.7, learning, level=2.0, friction=0.4, raised=0.3)
    assert learning.needed.crossing_peak[0] == pytest.approx(0.3)
    learning.unknown[0] = 0.5 * LEVEL
    shown(DT, 0.9, learning, raised=0.3)
    assert learning.needed.crossing_seen[0] == pytest.approx(0.6)
    shown(0.35, 0.0, learning, raised=0.3)
    assert learning.needed.crossing_peak[0] == pytest.approx(0.6, rel=0.02)
    assert learning.needed.crossing_level(0) == 1.0


def test_reset_keeps_the_level_that_was_found() -> None:
    learning = shown(0.5, 0.9, shown(20.0, 0.1, shown(600.0, 0.1), raised=0.3))
    before = found(learning)
    assert learning.needed.loud_s[0] == pytest.approx(0.5)
    learning.reset(0)
    assert (learning.needed.loud_s[0], learning.needed.quiet_s[0]) == (0.0, 0.0)
    assert (learning.needed.peak_seen[0], learning.needed.crossing_seen[0]) == (0.0, 0.0)
    assert found(learning) == before


@pytest.mark.parametrize("size", [1e3, 1e160, 1e300])
def test_a_false_sample_of_any_size_has_no_lasting_effect(size: float) -> None:
    """A finite one raises the level in force, too, and stays within it; its square may overflow."""
    learning = shown(1800.0, 0.1)
    before = learning.needed.level(0)
    shown(DT, size, learning, level=2.0 * size)
    assert np.isfinite(learning.needed.squares_s[0])
    learning.reset(0)
    shown(1800.0, 0.1, learning)
    assert learning.needed.level(0) == pytest.approx(before, rel=0.05)


@pytest.mark.parametrize("minutes", [5.0, 15.0])
def test_a_hand_that_leans_raises_no_level(minutes: float) -> None:
    """At 0.8 of the level in force; with noise, the residual is large and small by turns."""
    learning, rng = shown(1800.0, 0.12, flips=True), np.random.default_rng(3)
    before = learning.needed.level(0)
    for _ in range(round(60.0 * minutes / 0.2)):
        shown(0.2, before * (0.8 + 0.25 * rng.normal()), learning, level=before)
    assert learning.needed.level(0) <= 1.25 * before
    leaned = found(learning, FOUND[:2])
    shown(600.0, 0.8 * before, learning, level=before)
    assert found(learning, FOUND[:2]) == leaned, "nor does a leaning hand lower it"
    shown(120.0, 0.12, learning, level=before, flips=True)
    assert learning.needed.level(0) <= 1.2 * before


def test_a_constant_residual_from_the_beginning_keeps_its_level() -> None:
    """Masses that are off: the level sinks no further than they need."""
    learning = shown(1800.0, 0.2)
    assert learning.needed.level(0) == pytest.approx(2.9 * 0.2, rel=0.02)


def test_more_is_needed_where_a_joint_carries_more_than_motion_has_shown() -> None:
    """Beyond 1.7 root mean squares and half a configured level, by as much; never beyond it all."""
    needed = shown(0.0, 0.0).needed
    needed.carry(0, 0.1, LEVEL)
    assert needed.reach[0] == 1.0
    learning = shown(0.0, 0.0)
    for beta in (3.0, -4.0) * 300:
        learning.needed.carry(0, beta, LEVEL)
        shown(2.0, 0.1, learning)
    level, most = 2.9 * 0.1, 1.7 * np.sqrt(12.5) + 0.5 * LEVEL
    for beta, reach in ((0.0, 1.0), (0.9 * most, 1.0), (-1.5 * most, 1.5), (9.0 * most, 9.0)):
        learning.needed.carry(0, beta, LEVEL)
        assert learning.needed.reach[0] == pytest.approx(reach, rel=0.02)
        assert learning.needed.level(0) == pytest.approx(min(reach * level, 1.0), rel=0.03)
    shown(600.0, 0.1, learning, moving=False)
    assert learning.needed.reach[0] == pytest.approx(9.0, rel=0.02), "rest shows nothing"
    shown(3600.0, 0.1, learning)
    learning.needed.carry(0, 9.0 * most, LEVEL)
    assert learning.needed.reach[0] == 1.0


@pytest.mark.parametrize("beta", [0.0, -9.0, 1e300, np.inf, np.nan])
@pytest.mark.parametrize("configured", [LEVEL, 0.0])
def test_no_carried_torque_lowers_a_level_or_raises_it_beyond_the_configured(
    beta: float, configured: float
) -> None:
    learning = shown(600.0, 0.1)
    before = learning.needed.level(0)
    learning.needed.carry(0, beta, configured)
    assert before <= learning.needed.level(0) <= 1.0
    shown(10.0, 0.1, learning)
    learning.needed.carry(0, 0.0, LEVEL)
    assert 0.9 * before < learning.needed.level(0) <= 1.0


def test_in_doubt_nothing_is_measured() -> None:
    learning = shown(600.0, 0.1, flips=True)
    before = found(learning, FOUND[:3])
    for _ in range(1000):
        teach(learning, 0.6 * LEVEL, doubt=1.0)
    assert found(learning, FOUND[:3]) == before
    assert learning.needed.peak_seen[0] == 0.0


def test_a_stated_least_share_is_a_floor() -> None:
    learning = shown(3600.0, 0.0, fresh(least_share=np.array([0.6])))
    assert learning.needed.level(0) == 0.6
    assert learning.needed.crossing_level(0) >= 0.6
