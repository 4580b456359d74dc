"""Queries again until the answer is the one, or the timeout."""

from types import SimpleNamespace
from typing import cast

import pytest

from programs.clients.client import Client
from programs.clients.waiting import asked_until, reset

NOT_SEEN = SimpleNamespace(ok=False, unproved=["a"])
REFUSED = SimpleNamespace(ok=False, unproved=[])
DONE = SimpleNamespace(ok=True, unproved=[])
LONG_S = 60.0


@pytest.mark.parametrize(
    ("answers", "timeout_s", "found"),
    [
        ([1, 2, 3], LONG_S, 3),  # the first that is so
        ([3, 4], LONG_S, 3),
        ([1, 3], 0.0, 1),  # without a timeout it is asked once
    ],
)
def test_it_asks_until_the_answer_is_reached_or_the_timeout(answers, timeout_s, found):
    left = iter(answers)
    assert asked_until(lambda: next(left), lambda answer: answer >= 3, timeout_s) == found


@pytest.mark.parametrize(
    ("replies", "found"),
    [
        ([NOT_SEEN, NOT_SEEN, DONE], DONE),
        ([NOT_SEEN, REFUSED, DONE], REFUSED),  # no timeout helps against another reason
        ([DONE, REFUSED], DONE),
    ],
)
def test_a_reset_is_repeated_until_the_arm_is_confirmed_at_standstill(replies, found):
    asked: list[str] = []
    left = iter(replies)

    def request(command: str) -> object:
        asked.append(command)
        return next(left)

    client = cast(Client, SimpleNamespace(request=request))
    assert reset(client, LONG_S) is found
    assert set(asked) == {"reset"}
