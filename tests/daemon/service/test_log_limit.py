"""Limit of the log: no client can fill it, and it still names each command and its sender."""

import re

from daemon.service.journal import BURST, MOST_NAMED, PER_S, LogLimit


def test_a_person_is_reported_line_by_line() -> None:
    limit = LogLimit()
    for second in range(3600):
        assert limit.admit("armed", float(second))
        assert limit.summary(second + 0.5) == ""


def test_a_flood_is_counted_and_nothing_of_it_is_hidden() -> None:
    limit, written, summaries = LogLimit(), 0, []
    for tick in range(6000):
        line = ("armed: by uid 1 (pid 7)", "disarmed: by uid 2 (pid 8)")[tick % 2]
        written += limit.admit(line, tick / 100)
        if text := limit.summary(tick / 100):
            summaries.append(text)
    assert BURST <= written <= BURST + 60 * PER_S
    assert 50 <= len(summaries) <= 60  # one a second
    for text in summaries:
        assert "x armed: by uid 1 (pid 7)" in text
        assert "x disarmed: by uid 2 (pid 8)" in text
    counts = [int(re.findall(r", (\d+) in", text)[0]) for text in summaries]
    reported = [sum(int(n) for n in re.findall(r"(\d+) x ", text)) for text in summaries]
    assert counts == reported
    assert 6000 - 101 <= written + sum(counts) <= 6000  # the last second is still to be reported


def test_left_out_lines_are_reported_when_the_flood_ends() -> None:
    limit = LogLimit()
    while limit.admit("armed", 0.0):
        pass
    assert limit.summary(0.9) == ""
    assert "1 x armed" in limit.summary(1.0)
    assert limit.summary(5.0) == ""
    assert limit.admit("armed", 60.0)


def test_many_different_lines_are_bounded() -> None:
    limit = LogLimit()
    for i in range(1000):
        limit.admit(f"armed by pid {i}", 0.0)
    text = limit.summary(1.0)
    assert text.count(" x armed by pid") == MOST_NAMED
    assert f"{1000 - BURST - MOST_NAMED} x others" in text
