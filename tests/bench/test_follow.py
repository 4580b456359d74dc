"""Bench of streams, small: its targets are computed."""

import itertools
import math

import numpy as np
import pytest

from bench import follow
from bench.rigs.lockstep import DESK_ARM
from bench.study.stream_contacts import work
from bench.study.stream_deaths import DEATHS, death, dying
from bench.study.stream_quality import beyond_limits, false_stops, quality
from bench.study.streamed import MOTIONS, arrivals, track
from daemon.config.load import load_robot
from daemon.config.vectors import limits_of
from tests.bench.reports import reported


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_stream_is_followed_closely_and_smoothly(motion: str) -> None:
    job = follow.Job("quality", DESK_ARM, 5, 10.0, 100.0, motion)
    _, found = follow.run(job)
    assert found.quality.error_mrad < 1.5
    assert found.quality.beyond[1] < 3.0
    assert found.quality.jerk < 100.0


def test_a_delay_that_is_not_reported_is_seen() -> None:
    robot = load_robot(DESK_ARM)
    motion = MOTIONS["sines"](limits_of(robot.configuration), 8.0, 1)
    found = track(robot, arrivals(motion, 100.0, 8.0, 1), 7.0)
    period_s = robot.configuration.period_s
    right = quality(found, motion, period_s)
    wrong = quality(follow_later(found), motion, period_s)
    assert wrong.beyond[0] > right.beyond[0] + 2.0


def follow_later(found):  # type: ignore[no-untyped-def]
    return type(found)(found.time_s, found.q, found.velocity, found.delay_s + 0.03)


@pytest.mark.parametrize("way", DEATHS)
def test_each_death_is_one(way: str) -> None:
    robot = load_robot(follow.ROMEO)
    assert 0.0 < death(robot, way, 50.0, 3).stands_s <= 0.15
    limits = limits_of(robot.configuration)
    coming = arrivals(MOTIONS["hand"](limits, 8.0, 3), 50.0, 8.0, 3)
    spoiled = dying(way, coming, 4.0)
    assert any(a is not b for a, b in itertools.zip_longest(spoiled, coming))


def test_living_streams_do_not_stop_and_wild_ones_break_no_limit() -> None:
    robot = load_robot(DESK_ARM)
    assert false_stops(robot, 20.0, 0.01, 1)[0] == 0
    assert sum(beyond_limits(robot, seed, 1.0) for seed in range(5)) == 0


def test_touches_are_felt_on_a_stream() -> None:
    found = work(follow.load_robot(follow.ROMEO), 50.0, 1, 20.0, streamed=True, touched=True)
    assert len(found.felt_s) >= 2
    assert np.median(found.felt_s) < 0.2


def test_it_prints_its_targets() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(follow, "jobs", lambda *_: some())
        report = reported(follow, "--minutes 0.1 --arms 1 --hours 0.01 --jobs 1")
    assert {row["name"] for row in report["targets"]} >= {"false contacts", "delay at 100 Hz"}


def some() -> list[follow.Job]:
    return [
        follow.Job("quality", DESK_ARM, 1, 8.0, 100.0, "sines"),
        follow.Job("stops", DESK_ARM, 1, 20.0, 50.0),
        follow.Job("death", follow.ROMEO, 1, 0.0, 50.0, "silence"),
        follow.Job("wild", DESK_ARM, 1, 0.0),
        follow.Job("touches", follow.ROMEO, 1, 12.0, 50.0, "trajectory"),
        follow.Job("touches", follow.ROMEO, 1, 12.0, 50.0, "stream"),
        follow.Job("false", follow.ROMEO, 1, 5.0, 50.0, "stream"),
    ]


def test_percentiles_of_whole_ticks_are_those_of_what_lies_between_them() -> None:
    delays = np.random.default_rng(0).gamma(3.0, 0.015, 100_000)
    ticks = np.ceil(delays / follow.TICK_S) * follow.TICK_S
    for share in (50, 95):
        assert follow.percentile(ticks, share) == pytest.approx(
            np.percentile(delays, share), rel=0.02
        )
    assert math.isinf(follow.percentile(np.array([0.04, 0.04, 0.05, math.inf]), 95))
    assert math.isnan(follow.percentile(np.array([]), 50))
