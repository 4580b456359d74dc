"""Bench of an armed arm at work, and what made it yield."""

import pytest

from bench.only_the_hand import Day, run, targets


def test_a_hand_is_yielded_to_and_nothing_else() -> None:
    day = run(1.0, 2e-4, 1)
    assert (day.pushes, day.yielded_to, day.yields, day.contacts, day.faults) == (1, 1, [], [], 0)
    assert day.tracked_s > 45.0
    assert all(target.met for target in targets(day))


@pytest.mark.parametrize(
    "changes", [{"yields": [3.0]}, {"contacts": ["one"]}, {"yielded_to": 1}, {"faults": 1}]
)
def test_what_is_not_as_it_should_be(changes: dict) -> None:
    day = Day(**{"pushes": 2, "yielded_to": 2} | changes)
    assert sum(not target.met for target in targets(day)) == 1
