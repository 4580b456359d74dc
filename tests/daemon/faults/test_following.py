"""Motors that do not do what their setpoints say."""

import numpy as np
import pytest

from daemon.faults.following import (
    HEARD_SHARE,
    PRESSING_SHARE,
    SAG_TICKS,
    TICKS,
    Following,
    FollowingSettings,
)

T, LAG = 0.01, 0.01
WINDOW = 6  # three ticks of latency, three lags
BOTH = np.ones(2, dtype=bool)
DEVIATION, CURRENT = np.array([0.2, 0.3]), np.array([1.0, 4.0])
E = 1e-9


@pytest.fixture
def following() -> Following:
    return Following(FollowingSettings(DEVIATION, CURRENT, LAG), T)


def ticks(
    following: Following, count: int, commanded: float, velocity: float, share: float = 0.0
) -> list[bool]:
    """Whether the second joint does not follow, tick by tick; the first follows."""
    found = []
    for _ in range(count):
        following.record(np.array([commanded, commanded]))
        fails = following.not_following(
            np.array([commanded, velocity]), np.array([0.0, share * CURRENT[1]]), BOTH
        )
        assert 0 not in fails
        found.append(1 in fails)
    return found


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("beyond", "fails"), [(-E, False), (E, True)])
@pytest.mark.parametrize("commanded", [0.0, 0.1])
def test_the_deviation_that_counts(
    following: Following, sign: int, beyond: float, fails: bool, commanded: float
) -> None:
    ticks(following, WINDOW, sign * commanded, sign * commanded)
    velocity = sign * (commanded - DEVIATION[1] - beyond)
    found = ticks(following, TICKS, sign * commanded, velocity)
    assert found == [False] * (TICKS - 1) + [fails]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("beyond", "fails"), [(-E, True), (E, False)])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_drive_that_presses_the_right_way_follows(
    following: Following, sign: int, beyond: float, fails: bool, direction: int
) -> None:
    """Held up, or carried along by a stronger person; pressing the wrong way is no excuse."""
    share = sign * direction * (PRESSING_SHARE + beyond)
    found = ticks(following, TICKS, 0.0, -sign * 0.5, share)
    assert found[-1] is (fails if direction == 1 else True)


@pytest.mark.parametrize("sign", [1, -1])
def test_at_the_bounds_it_follows(following: Following, sign: int) -> None:
    assert not any(ticks(following, 2 * TICKS, 0.0, sign * DEVIATION[1]))
    found = ticks(following, 2 * TICKS, 0.0, -sign * 0.5, sign * PRESSING_SHARE)
    assert not any(found)
    # Nor is it drawn into what another joint does.
    for _ in range(TICKS):
        following.record(np.zeros(2))
        fails = following.not_following(np.array([0.5, sign * DEVIATION[1]]), np.zeros(2), BOTH)
    assert fails == [0]


def test_the_bounds_are_those_of_the_documentation() -> None:
    assert (TICKS, PRESSING_SHARE, SAG_TICKS, HEARD_SHARE) == (20, 0.5, 50, 0.02)


def test_ticks_count_again_from_zero(following: Following) -> None:
    assert not any(ticks(following, TICKS - 1, 0.0, 0.5))
    assert ticks(following, 1, 0.0, 0.0) == [False]
    assert not any(ticks(following, TICKS - 1, 0.0, 0.5))
    assert ticks(following, 2, 0.0, 0.5) == [True, True]
    following.restart()
    assert not any(ticks(following, TICKS - 1, 0.0, 0.5))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("beyond", "excused"), [(-E, False), (E, True)])
def test_after_enabling_weight_may_be_taken_up(
    following: Following, sign: int, beyond: float, excused: bool
) -> None:
    """Until SAG_TICKS are over, by a current that went the right way since the first tick."""
    first = 0.1  # of the limit: that of a link that hangs
    share = first + sign * (HEARD_SHARE + beyond)
    for _ in range(2):  # each time that it is enabled
        following.restart()
        ticks(following, 1, 0.0, 0.0, first)
        found = ticks(following, SAG_TICKS - 1, 0.0, -sign * 0.5, share)
        assert any(found) is not excused
    # Then only one that presses counts, and a wrong way never did.
    assert ticks(following, TICKS, 0.0, -sign * 0.5, share)[-1]
    following.restart()
    ticks(following, 1, 0.0, 0.0, first)
    assert ticks(following, TICKS, 0.0, sign * 0.5, share)[-1]


def test_a_first_current_that_is_no_number_excuses_nothing(following: Following) -> None:
    following.restart()
    ticks(following, 1, 0.0, 0.0, float("nan"))
    assert ticks(following, TICKS, 0.0, 0.5, -0.4)[-1]


def test_a_recent_setpoint_may_still_be_obeyed(following: Following) -> None:
    ticks(following, WINDOW, 0.5, 0.5)
    # Commanded to stand, it goes on: that counts when the last 0.5 has left the window.
    found = ticks(following, WINDOW - 1 + TICKS, 0.0, 0.5)
    assert found == [False] * (WINDOW - 2 + TICKS) + [True]
    following.restart()
    ticks(following, 1, 0.5, 0.0)
    # Commanded to move, it stands: that counts when nothing else was commanded for as long.
    found = ticks(following, WINDOW - 2 + TICKS, 0.5, 0.0)
    assert found == [False] * (WINDOW - 3 + TICKS) + [True]


@pytest.mark.parametrize(
    ("lag_s", "period_s", "window"),
    [(0.0, 0.01, 3), (0.01, 0.01, 6), (0.011, 0.01, 7), (0.03, 0.002, 48)],
)
def test_the_window_follows_from_lag_and_period(lag_s: float, period_s: float, window: int) -> None:
    following = Following(FollowingSettings(DEVIATION, CURRENT, lag_s), period_s)
    ticks(following, 1, 0.5, 0.5)
    found = ticks(following, 100, 0.0, 0.5)
    assert found.index(True) == window - 1 + TICKS - 1


def test_every_joint_by_itself() -> None:
    following = Following(FollowingSettings(DEVIATION, CURRENT, LAG), T)
    for _ in range(TICKS):
        following.record(np.zeros(2))
        fails = following.not_following(np.array([-0.21, 0.31]), np.zeros(2), BOTH)
    assert fails == [0, 1]
    assert following.not_following(np.array([0.0, 0.31]), np.zeros(2), BOTH) == [1]


@pytest.mark.parametrize("sign", [1, -1])
def test_the_figures_are_from_the_nearest_setpoint_that_it_may_still_obey(sign: int) -> None:
    following = Following(FollowingSettings(DEVIATION, CURRENT, LAG), T)
    for commanded in (0.0, 0.05, 0.02):
        following.record(np.full(2, sign * commanded))
    following.not_following(np.array([sign * 0.3, -sign * 0.4]), np.zeros(2), BOTH)
    assert following.figures(0) == "by 0.250 rad/s, at most 0.200"
    assert following.figures(1) == "by 0.400 rad/s, at most 0.300"


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("rise", "obeys"), [(0.0, False), (0.004, False), (0.006, True), (-0.1, False)]
)
def test_a_current_that_went_the_right_way_is_named_beside_the_fault(
    following: Following, sign: int, rise: float, obeys: bool
) -> None:
    ticks(following, SAG_TICKS + WINDOW, 0.0, 0.0, 0.1)
    for k in range(TICKS):
        share = 0.1 + sign * rise * k / (TICKS - 1)
        fails = ticks(following, 1, sign * 0.5, 0.0, share)
        following.record(np.full(2, sign * 0.5))
    while not fails[-1]:
        fails = ticks(following, 1, sign * 0.5, 0.0, share)
    assert ("it obeys" in following.figures(1)) is obeys
