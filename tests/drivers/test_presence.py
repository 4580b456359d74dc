"""When a heartbeat is due, and when the drives may have missed us."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.presence import Presence

MASTER_TIMEOUT_S, T = 0.1, 0.01


@pytest.fixture
def presence() -> Presence:
    presence = Presence(MASTER_TIMEOUT_S, T)
    presence.begin(10.0)
    return presence


def test_no_one_has_heard_us_before_we_began() -> None:
    fresh = Presence(MASTER_TIMEOUT_S, T)
    assert fresh.beats(0.0)
    assert fresh.gap_s(0.0) == float("inf")


def test_a_heartbeat_is_due_a_tick_before_a_third_of_the_patience(presence: Presence) -> None:
    assert [presence.beats(10.0 + t) for t in (0.01, 0.02, 0.0234, 0.03)] == [
        False,
        False,
        True,
        True,
    ]
    presence.beaten(10.03)
    assert not presence.beats(10.04)


@pytest.mark.parametrize(
    ("unheard_s", "gap"), [(0.03, None), (0.0949, None), (0.0951, 0.0951), (3.0, 3.0)]
)
def test_a_gap_is_nearly_the_patience_and_is_reported_once(
    presence: Presence, unheard_s: float, gap: float | None
) -> None:
    found = presence.gap_s(10.0 + unheard_s)
    assert found == (gap if gap is None else pytest.approx(gap))
    presence.absent = True
    assert presence.gap_s(10.0 + unheard_s) is None
    presence.begin(20.0)
    assert (presence.absent, presence.gap_s(20.01)) == (False, None)


@given(st.floats(0.003, 10.0), st.floats(0.001, 0.1))
def test_who_beats_when_it_is_due_is_never_absent(master_timeout_s: float, share: float) -> None:
    period_s = master_timeout_s * min(share, 1 / 3)
    presence, now = Presence(master_timeout_s, period_s), 0.0
    presence.begin(now)
    for _ in range(100):
        now += period_s
        assert presence.gap_s(now) is None
        if presence.beats(now):
            presence.beaten(now)
