"""Targets of `bench.loop`, from turns and a rival's wake-ups."""

from dataclasses import replace

import numpy as np
import pytest

from bench.loop import targets_of
from bench.study.loop_run import FIGURES, Run, Turn, run_of
from bench.study.wakeups import Distribution, histogram
from daemon.modes.table import Mode

TICKS = 100


def turn(cpu_us: float, *, missed: int = 0, rival_us: tuple[float, ...] = (50.0,)) -> Turn:
    figures = {name: np.full(TICKS, cpu_us) for name in FIGURES}
    figures["lateness_us"] = np.full(TICKS, 60.0)
    figures["setpoint_us"] = np.full(TICKS, 0.5 * cpu_us)
    return Turn(figures, missed, missed, Distribution.of(rival_us), Mode.TRACKING, 7, ["granted"])


def run(hz: int, turns: list[Turn]) -> Run:
    return run_of(hz, turns, rival="cyclictest", waited=True)


def met(of: Run, *, load: bool = False) -> dict[str, bool]:
    return {target.name.split(": ")[1]: target.met for target in targets_of(of, load=load)}


def test_turns_become_one_run() -> None:
    turns = [turn(100.0, missed=1), turn(300.0, missed=2, rival_us=(50.0, 70.0))]
    found = run(100, turns)
    assert found.missed == 3
    assert found.cpu_us.counts.tolist() == [TICKS, TICKS]
    assert found.rival_us is not None
    assert dict(zip(found.rival_us.values, found.rival_us.counts, strict=True)) == {50: 2, 70: 1}


def test_ticks_without_a_setpoint_are_left_out() -> None:
    one = turn(100.0)
    one.figures["setpoint_us"][:50] = np.nan
    found = run(100, [one])
    assert found.setpoint_us.counts.sum() == TICKS - 50


@pytest.mark.parametrize(
    ("missed", "rival_us", "good"),
    # A wake-up 40 % of 4 ms late costs a deadline.
    [(0, (50.0,), True), (1, (1599.0,), False), (1, (1601.0,), True), (3, (9000.0,), False)],
)
def test_loaded_at_250_hz_no_more_deadlines_are_missed_than_the_rival_would(
    missed: int, rival_us: tuple[float, ...], good: bool
) -> None:
    found = run(250, [turn(100.0, missed=missed, rival_us=rival_us)])
    assert met(found, load=True)["deadlines missed, at most the cyclictest's"] is good
    assert not [name for name in met(found) if "missed" in name]


@pytest.mark.parametrize(("work_us", "good"), [(1999.0, True), (2001.0, False)])
def test_loaded_at_250_hz_a_tick_takes_half_a_period_at_most(work_us: float, good: bool) -> None:
    one = turn(100.0)
    one.figures["work_us"][:2] = work_us
    assert met(run(250, [one]), load=True)["tick, p99"] is good


def test_an_arm_that_stopped_is_reported_even_if_it_tracks_later() -> None:
    stopped = replace(turn(100.0), mode="holding")
    assert met(run(100, [stopped, turn(100.0)]))["tracking all the time"] is False
    assert met(run(100, [turn(100.0)]))["tracking all the time"] is True


def test_a_turn_is_repeated_only_where_the_machine_stalled() -> None:
    stopped = replace(turn(100.0), mode="holding")
    assert not stopped.stopped_by_machine(100)
    stalled = replace(stopped, rival_us=Distribution.of([10_001.0]))
    assert stalled.stopped_by_machine(100)
    assert not replace(stalled, mode=Mode.TRACKING).stopped_by_machine(100)


def test_what_a_repeated_turn_missed_counts_and_its_cost_does_not() -> None:
    stalled = replace(
        turn(700.0, missed=9), mode="holding", rival_us=Distribution.of([10_001.0]), repeated=1
    )
    made = turn(100.0, missed=1).after(stalled)
    found = run(100, [made])
    assert (found.missed, found.repeated, found.rivals_missed) == (10, 2, 1)
    assert found.cpu_us.at(50) == turn(100.0).figures["cpu_us"][0]


def test_a_rival_that_sleeps_through_periods_misses_each_of_their_deadlines() -> None:
    late = replace(turn(100.0), rival_us=Distribution.of([4_000.0, 9_500.0, 20_100.0, 20_100.0]))
    found = run(100, [late])
    assert (found.rivals_missed, found.rivals_late) == (0 + 1 + 2 * 2, 2)
    on_two_cpus = replace(found, rival_threads=2)
    assert (on_two_cpus.rivals_missed, on_two_cpus.rivals_late) == (2.5, 1.0)


def test_cyclictests_histogram_with_what_lies_beyond_it() -> None:
    thread = {"histogram": {"3": 5, "10": 2}, "cycles": 9, "max": 120_000}
    other = {"histogram": {"3": 4}, "cycles": 4, "max": 3}
    found = histogram({"thread": {"0": thread, "1": other}})
    assert found.values.tolist() == [3, 10, 120_000]
    assert found.counts.tolist() == [9, 2, 2]
