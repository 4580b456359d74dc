"""Force at the tool, in words."""

from typing import Any

import pytest

from daemon.protocol.state import Wrench
from programs.clients.wrench import bound_N, wrench_words

SURE = [1.0, 0.0, 0.0, 1.0, 0.0, 4.0]


def wrench(**fields: Any) -> Wrench:
    made = {"force": [0.0, 0.0, -18.0], "covariance": SURE, "unseen": [], "strength": 4.0}
    return Wrench(**made | {"misfit": 0.8} | fields)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "18 N +- 4, towards -z of hand"),
        ({"force": [12.0, 9.0, 0.0]}, "15 N +- 2, towards (0.8 0.6 0.0) of hand"),
        ({"unseen": [[0.0, 1.0, 0.0]]}, "18 N +- 4, towards -z of hand; along y not seen"),
        ({"misfit": 2.5},
         "18 N +- 4, towards -z of hand; not one force at the tool: elsewhere, or two"),
        ({"force": [0.0, 0.0, 0.0], "strength": 0.5}, "nothing beyond its level"),
        ({"force": [0.0, 0.0, 0.0], "strength": 0.5, "misfit": 5.5},
         "not one force at the tool: elsewhere, or two"),
        ({"force": [0.0, 0.0, 0.0], "unseen": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]},
         "a force beyond its level; along x and y not seen"),
    ],
)  # fmt: skip
def test_words(fields: dict[str, Any], words: str) -> None:
    assert wrench_words(wrench(**fields), "hand") == words


def test_the_bound_counts_what_directions_share() -> None:
    along = wrench(covariance=[1.0, 0.9, 0.0, 1.0, 0.0, 1.0])
    assert bound_N(along, [0.6, 0.8, 0.0]) == pytest.approx(1.96 * (1.0 + 2 * 0.9 * 0.48) ** 0.5)
