"""Gathering: friction, gap and remainder from rows, stretch by stretch, day by day."""

import numpy as np
import pytest

from daemon.protocol.trend_row import HEAD, PER_JOINT, row_length
from programs.trends.day import Day
from programs.trends.gather import Gatherer

T = 0.01
MIDNIGHT = 1.8e9 // 86400 * 86400


def rows(seconds: float, tick: int = 0, wall_s: float = MIDNIGHT, half_gap: float = 0.012):
    """One joint to and fro, its rotor at one border or the other, and another that stands."""
    n = round(seconds / T)
    t = T * np.arange(n)
    made = np.zeros((n, row_length(2)))
    made[:, 0], made[:, 1], made[:, 2] = tick + np.arange(n), wall_s + t, 1.0
    theta, speed = 0.4 * np.sin(1.5 * t), 0.6 * np.cos(1.5 * t)
    # The link is pushed by the rotor: phi at the border behind, and crosses in some tenths.
    side = -np.tanh(4.0 * np.cos(1.5 * t))
    one = made[:, HEAD : HEAD + PER_JOINT]
    one[:, 0], one[:, 1], one[:, 2] = theta + np.clip(1.3 * side, -1, 1) * half_gap, theta, speed
    one[:, 3] = 0.05 + 0.1 * np.sign(speed)
    one[:, 4], one[:, 5] = 1.25, 0.1
    other = made[:, HEAD + PER_JOINT :]
    other[:, 4:] = 1.0, 1.0
    return made


def gathered(*parts: np.ndarray) -> dict[str, Day]:
    gatherer, days = Gatherer("arm", ["elbow", "wrist"], T, {"elbow": "2026-06-03"}), {}
    for part in parts:
        gatherer.take(part, days)
    gatherer.end(days)
    return days


def test_a_day_has_friction_gap_remainder_and_skew() -> None:
    (day,) = gathered(rows(150.0)).values()
    elbow, wrist = day.joints["elbow"], day.joints["wrist"]
    assert elbow.moved_s == pytest.approx(141.0, abs=3.0)
    assert elbow.friction.mean == pytest.approx(1.25)
    assert elbow.remainder == pytest.approx(0.05)
    assert elbow.half_gap.mean == pytest.approx(0.012, rel=0.03)
    assert abs(elbow.skew_ms.mean) < 0.2
    assert (wrist.moved_s, wrist.friction.weight, wrist.half_gap.weight) == (0.0, 0.0, 0.0)
    assert day.identified == {"elbow": "2026-06-03"}


def test_rows_in_small_pieces_are_the_same() -> None:
    whole = rows(130.0)
    (one,), (other,) = gathered(whole).values(), gathered(*np.array_split(whole, 97)).values()
    gaps = [day.joints["elbow"].half_gap.mean for day in (one, other)]
    assert gaps[0] == pytest.approx(gaps[1], rel=1e-4)
    assert one.joints["elbow"].friction.mean == pytest.approx(other.joints["elbow"].friction.mean)


def test_a_gap_in_the_ticks_begins_another_stretch() -> None:
    (day,) = gathered(rows(30.0), rows(30.0, tick=9000)).values()
    assert day.joints["elbow"].half_gap.weight == 0.0  # neither is long enough
    assert day.joints["elbow"].friction.weight > 50.0


def test_touched_samples_do_not_count() -> None:
    touched = rows(60.0)
    touched[:, 2] = 0.0
    (day,) = gathered(touched).values()
    assert day.joints["elbow"].friction.weight == 0.0
    assert day.joints["elbow"].forth.weight == 0.0


def test_uncertain_samples_do_not_count() -> None:
    unknown = rows(60.0)
    unknown[:, HEAD + 5] = 0.9
    (day,) = gathered(unknown).values()
    assert day.joints["elbow"].friction.weight == 0.0


@pytest.mark.parametrize("friction", [2.2, 0.3])
def test_time_at_a_bound_is_counted(friction: float) -> None:
    at = rows(60.0)
    at[1000:, HEAD + 4] = friction
    (day,) = gathered(at).values()
    elbow = day.joints["elbow"]  # it turns now and then, and counts while it moves
    assert elbow.bound_s == pytest.approx(50.0 / 60.0 * elbow.moved_s, rel=0.01)
    assert elbow.bound_s < 50.0
    assert day.joints["wrist"].bound_s == 0.0


def test_midnight_begins_another_day() -> None:
    evening = rows(60.0, wall_s=MIDNIGHT - 60.005)
    days = gathered(evening, rows(60.0, tick=6000, wall_s=MIDNIGHT + 0.005))
    assert len(days) == 2


def test_a_rotor_that_is_not_measured_shows_its_gap_but_no_skew() -> None:
    integrated = rows(150.0)
    integrated[:, HEAD + 1] = np.nan
    (day,) = gathered(integrated).values()
    assert day.joints["elbow"].half_gap.mean == pytest.approx(0.012, rel=0.1)
    assert day.joints["elbow"].skew_ms.weight == 0.0
