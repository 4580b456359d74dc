"""Quiet timer: when it runs out, and what makes it begin anew."""

import pytest

from daemon.modes.quiet_timer import QuietTimer


@pytest.mark.parametrize("period_s", [0.001, 0.01, 0.1])
def test_it_expires_the_limit_after_the_last_touch(period_s: float) -> None:
    timer, expired = QuietTimer(2.0), []
    for tick in range(round(3.0 / period_s)):
        timer.sense(touched=tick <= 50, time_s=tick * period_s)
        if timer.expired:
            expired.append(tick)
    first = 50 + round(2.0 / period_s)
    assert expired[:1] == ([first] if first < round(3.0 / period_s) else [])


def test_one_touch_restarts_the_time() -> None:
    timer = QuietTimer(2.0)
    timer.sense(touched=False, time_s=1.99)
    assert not timer.expired
    timer.sense(touched=True, time_s=2.0)
    assert timer.quiet_s == 0.0
    timer.sense(touched=False, time_s=3.99)
    assert not timer.expired
    timer.sense(touched=False, time_s=4.0)
    assert timer.expired


def test_a_restart_forgets_the_quiet_before() -> None:
    timer = QuietTimer(2.0)
    timer.sense(touched=False, time_s=5.0)
    assert timer.expired
    timer.restart(5.0)
    assert not timer.expired
    timer.sense(touched=False, time_s=6.5)
    assert timer.quiet_s == 1.5


# Ticks: touched (t), quiet (.), touched or not and not sure of it (T, x); and the ticks of quiet.
@pytest.mark.parametrize(
    ("ticks", "quiet"),
    [
        ("t....", 4),
        ("t..xx", 2),
        ("t..xx..", 4),
        ("txxxxx", 0),
        ("t.x.x.x.x", 4),
        ("t...T", 0),  # what is felt is felt, however sure
        ("t...Tx.", 1),
        ("xxx..", 2),
    ],
)
def test_the_time_stops_while_a_touch_might_not_be_detected(ticks: str, quiet: int) -> None:
    timer = QuietTimer(2.0)
    for k, tick in enumerate(ticks, start=1):
        timer.sense(tick in "tT", 0.01 * k, sure=tick in "t.")
        assert timer.quiet_s >= 0.0
    assert timer.quiet_s == pytest.approx(0.01 * quiet)
