"""The fixed loop, on a clock that only moves when a test moves it."""

from dataclasses import dataclass, field
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.tick.loop import ANSWER_SHARE, Clock, Loop
from daemon.tick.telemetry import Wakeup

T = 0.01
START = 100.0
AHEAD = 1.8e9  # of the clock on the wall


@dataclass
class FakeClock:
    """Wakes `late` seconds after the deadline it was asked for, once for each entry."""

    now_s: float = START
    late: dict[int, float] = field(default_factory=dict)  # by number of the sleep
    asked: list[float] = field(default_factory=list)

    def now(self) -> float:
        return self.now_s

    def wall(self) -> float:
        return self.now_s + AHEAD

    def sleep_until(self, deadline: float) -> None:
        self.now_s = max(self.now_s, deadline) + self.late.get(len(self.asked), 0.0)
        self.asked.append(deadline)


@dataclass
class FakeTick:
    """Notes when it was called; a tick takes `work` seconds."""

    clock: FakeClock
    work: float = 0.002
    began: list[float] = field(default_factory=list)
    finished: list[tuple[float, Wakeup]] = field(default_factory=list)

    def begin(self, time_s: float) -> None:
        self.began.append(time_s)

    def finish(self, deadline: float, wakeup: Wakeup) -> None:
        self.finished.append((deadline, wakeup))
        self.clock.now_s += self.work


def loop_of(**late: float) -> tuple[Loop, FakeTick, FakeClock]:
    clock = FakeClock(late={int(name.removeprefix("tick")): s for name, s in late.items()})
    tick = FakeTick(clock)
    return Loop(tick, Clock(clock.now, clock.sleep_until, clock.wall), T), tick, clock


def steps(times: list[float]) -> list[float]:
    return [after - before for before, after in pairwise(times)]


def test_deadlines_are_absolute_and_do_not_drift() -> None:
    loop, tick, clock = loop_of(tick1=0.003, tick4=0.0039)
    for _ in range(200):
        loop.step()
    assert clock.asked == pytest.approx([START + T * (k + 1) for k in range(200)], abs=1e-9)
    assert loop.missed == 0
    assert tick.began[1] == pytest.approx(2 * T + 0.003)
    assert loop.lateness_max_s == pytest.approx(0.0039)
    assert loop.work_max_s == pytest.approx(0.002)


def test_a_wakeup_has_the_time_of_both_clocks() -> None:
    loop, tick, _ = loop_of(tick1=0.003)
    for _ in range(3):
        loop.step()
    woken = [START + T, START + 2 * T + 0.003, START + 3 * T]
    assert [w.monotonic_s for _, w in tick.finished] == pytest.approx(woken)
    assert [w.wall_s - AHEAD for _, w in tick.finished] == pytest.approx(woken, abs=1e-6)


@pytest.mark.parametrize(
    ("late", "left_out"), [(0.0039, 0), (0.0041, 1), (0.0139, 1), (0.0141, 2), (0.3505, 35)]
)
def test_a_late_tick_is_counted_and_left_out(late: float, left_out: int) -> None:
    loop, tick, clock = loop_of(tick3=late)
    for _ in range(8):
        loop.step()
    assert loop.missed == left_out
    wakeups = [wakeup for _, wakeup in tick.finished]
    assert [w.left_out for w in wakeups] == [0] * 3 + [left_out] + [0] * 4
    assert wakeups[3].lateness_s == pytest.approx(late)
    assert [w.missed for w in wakeups] == [0] * 3 + [left_out] * 5
    # It goes on at the grid of the old deadlines, and nothing is made up for in a burst.
    assert clock.asked[4] == pytest.approx(START + T * (5 + left_out))
    assert steps(tick.began[5:]) == pytest.approx([T] * 2)


@given(st.lists(st.floats(0.0, 0.05), min_size=1, max_size=20))
def test_the_drives_have_time_to_answer_however_late_a_tick_is(late: list[float]) -> None:
    loop, tick, clock = loop_of(**{f"tick{k}": s for k, s in enumerate(late)})
    for _ in range(len(late) + 2):
        loop.step()
    assert all(step >= ANSWER_SHARE * T - 1e-9 for step in steps(tick.began))
    # Every deadline of the grid was either kept or counted.
    assert clock.asked[-1] == pytest.approx(
        START + T * (len(clock.asked) + missed_before_the_last(tick))
    )


def missed_before_the_last(tick: FakeTick) -> int:
    """Deadlines left out before the last one was asked for."""
    return tick.finished[-2][1].missed


def test_samples_are_awaited_for_a_share_of_the_period_from_the_wakeup() -> None:
    loop, tick, _ = loop_of(tick1=0.004)
    loop.step()
    loop.step()
    assert [deadline for deadline, _ in tick.finished] == pytest.approx(
        [START + T + ANSWER_SHARE * T, START + 2 * T + 0.004 + ANSWER_SHARE * T]
    )


def test_a_tick_knows_how_long_the_one_before_worked() -> None:
    loop, tick, _ = loop_of()
    loop.step()
    tick.work = 0.005
    loop.step()
    loop.step()
    assert [w.work_s for _, w in tick.finished] == pytest.approx([0.0, 0.002, 0.005])


def test_requests_are_served_after_each_tick_until_the_loop_ends() -> None:
    loop, tick, _ = loop_of()
    calls: list[int] = []
    loop.run(lambda: calls.append(len(tick.finished)), lambda: len(calls) < 3)
    assert calls == [1, 2, 3]
    assert loop.time_s == pytest.approx(3 * T + 0.002)


def test_a_tick_longer_than_the_period_is_late_for_the_next() -> None:
    loop, tick, _ = loop_of()
    tick.work = 0.025
    for _ in range(4):
        loop.step()
    assert [w.left_out > 0 for _, w in tick.finished] == [False, True, True, True]
    assert loop.missed >= 3
    assert min(steps(tick.began)) >= 0.025 - 1e-9
