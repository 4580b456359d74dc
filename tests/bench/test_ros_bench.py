"""Bench of the door to ROS 2: what counts as lost, and as late."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from bench.ros import Rounds, targets_of
from bench.study.beside import median_ratio
from daemon.ros.messages import stamp


def figures(both: float) -> dict[str, float]:
    return {"both": both, "tick": both, "doors": both}


@pytest.fixture
def states() -> list[Any]:
    return [SimpleNamespace(timing=SimpleNamespace(wall_s=1.8e9 + 0.01 * i)) for i in range(100)]


def test_what_never_came_is_lost_and_the_rest_has_an_age(states: list[Any]) -> None:
    rounds = Rounds(cpu=[0.03], without=[figures(100.0)], beside=[figures(105.0)])
    arrivals = [(*stamp(state.timing.wall_s), state.timing.wall_s + 0.002) for state in states[:97]]
    rounds._compare(states, arrivals)
    assert (rounds.lost, rounds.heard) == (3, 97)
    assert rounds.delays_ms == pytest.approx([2.0] * 97, abs=1e-3)
    met = {target.name: target.met for target in targets_of(rounds)}
    assert met == {
        "bridge": True,
        "memory of the bridge": True,
        "tick and doors at p99, with over without": True,
        "states lost beside one that stalls": False,
        "from a tick to a subscriber, p99": True,
    }


def test_nothing_heard_is_no_age() -> None:
    rounds = Rounds(cpu=[0.03], without=[figures(1.0)], beside=[figures(1.0)])
    assert math.isnan(targets_of(rounds)[-1].value)
    assert not targets_of(rounds)[-1].met


def test_a_ratio_is_of_the_same_round() -> None:
    without = [figures(1.0), figures(2.0), figures(10.0)]
    beside = [figures(1.1), figures(2.4), figures(10.0)]
    assert median_ratio(beside, without, "both") == pytest.approx(1.1)
