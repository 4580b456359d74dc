"""TPDOs that are a period late for ever, and those that come from two drives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.punctuality import (
    DOUBT_TICKS,
    LEFT_OUT_EVERY_S,
    LEFT_OUT_EVERY_WHILE_OLD_S,
    TWICE_TICKS,
    Punctuality,
)
from tests.examples import scaled

PERIOD_S = 0.01
DEADLINE = 0.6  # periods
IN_TIME, LATE, OLD = 0.2, 0.8, 1.2  # periods from SYNC to answer


@dataclass
class OneDrive:
    """One TPDO, its answers on their way, and what a tick does with them."""

    found: Punctuality = field(default_factory=lambda: Punctuality(PERIOD_S))
    ticks: int = 0
    arriving: list[float] = field(default_factory=list)
    left_out: list[int] = field(default_factory=list)
    disturbed: int = 0

    def tick(self, delays: Sequence[float]) -> None:
        """A SYNC, unless it is left out, that gets answers with these delays [periods]."""
        k, now = self.ticks, self.ticks * PERIOD_S
        self._take(k, 0)
        if self.found.leaves_out(now):
            self.left_out.append(k)
        else:
            self.found.asked(now)
            self.arriving += [k + delay for delay in delays]
            self.found.ended(self._take(k + DEADLINE, 1))
        self.ticks += 1

    def _take(self, until: float, missing: int) -> int:
        come = sum(at <= until for at in self.arriving)
        self.arriving = [at for at in self.arriving if at > until]
        for _ in range(come):
            if missing:
                missing = 0
            else:
                self.disturbed += self.found.unawaited(1)
        return missing

    def run(self, ticks: int, *delays: float) -> "OneDrive":
        for _ in range(ticks):
            self.tick(delays)
        return self


@pytest.mark.parametrize("delay", [OLD, 1.55])
@pytest.mark.parametrize("before", [0, 3, 200])
def test_a_drive_that_becomes_a_period_late_is_found_at_once(delay: float, before: int) -> None:
    one = OneDrive().run(before, IN_TIME).run(DOUBT_TICKS + 4, delay)
    assert one.found.old == 1
    assert one.left_out == [before + DOUBT_TICKS + 1]
    assert one.disturbed == 0
    one.run(1000, delay)
    assert one.found.old == 1, "for as long as it is"


def test_it_is_over_when_a_left_out_sync_brings_nothing() -> None:
    one = OneDrive().run(20, OLD)
    one.run(round(LEFT_OUT_EVERY_WHILE_OLD_S / PERIOD_S) + 5, IN_TIME)
    assert one.found.old == 0
    asked = len(one.left_out)
    one.run(2000, IN_TIME)
    assert len(one.left_out) == asked


@pytest.mark.parametrize("delay", [IN_TIME, LATE])
def test_who_answers_before_the_next_sync_is_in_no_doubt(delay: float) -> None:
    one = OneDrive().run(3000, delay)
    assert (one.left_out, one.found.old, one.found.twice, one.disturbed) == ([], 0, 0, 0)


def test_a_lost_answer_costs_one_sync_every_ten_seconds_at_most() -> None:
    one = OneDrive()
    for k in range(3000):
        one.tick([] if k % 20 == 7 else [IN_TIME])
    gaps = [b - a for a, b in zip(one.left_out, one.left_out[1:], strict=False)]
    assert len(one.left_out) == 3
    assert min(gaps) * PERIOD_S >= LEFT_OUT_EVERY_S
    assert one.found.old == 0


def test_what_is_doubted_is_known_until_it_was_looked_at() -> None:
    one = OneDrive().run(10, IN_TIME).run(1).run(1, IN_TIME)
    assert one.found.doubted(one.ticks * PERIOD_S) == 1
    one.run(DOUBT_TICKS + 2, IN_TIME)
    assert one.found.doubted(one.ticks * PERIOD_S) == 0
    one.run(1).run(1, IN_TIME)
    assert one.found.doubted(one.ticks * PERIOD_S) == 0, "not to be looked at for some time"


def test_an_answer_that_comes_twice_after_one_was_missing_was_old() -> None:
    one = OneDrive().run(10, IN_TIME).run(1, OLD).run(2, IN_TIME)
    assert one.disturbed == 1
    assert one.run(30, IN_TIME).left_out == []


@pytest.mark.parametrize("delays", [(IN_TIME, IN_TIME), (IN_TIME, LATE)])
def test_two_drives_are_found_and_three_answers_are_old_frames(delays: Sequence[float]) -> None:
    one = OneDrive().run(20, IN_TIME).run(TWICE_TICKS, *delays)
    assert one.found.twice == 0
    assert one.run(2, *delays).found.twice == 1
    assert one.disturbed == 0
    assert one.run(2, IN_TIME).found.twice == 0
    assert OneDrive().run(50, IN_TIME, IN_TIME, IN_TIME).found.twice == 0


def test_a_new_start_forgets() -> None:
    one = OneDrive().run(30, OLD)
    one.found.start_anew()
    assert (one.found.old, one.found.doubted(math.inf)) == (0, 0)


DELAYS = st.lists(st.sampled_from([(), (IN_TIME,), (IN_TIME,), (LATE,), (OLD,)]), max_size=200)


@settings(max_examples=scaled(50), deadline=None)
@given(DELAYS)
def test_whatever_a_drive_does_it_is_one_and_the_truth_is_known_in_the_end(
    delays: list[Sequence[float]],
) -> None:
    one = OneDrive()
    for each in delays:
        one.tick(each)
        assert one.found.twice == 0
    late = one.run(1030, OLD)
    assert late.found.old == 1
    late.run(1030, IN_TIME)
    assert (late.found.old, late.found.doubted(math.inf)) == (0, 0)
