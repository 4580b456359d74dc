"""Force at the tool, in words: as the page has it, too."""

from typing import Any

import numpy as np
import pytest

from daemon.protocol.state import Wrench
from programs.clients.wrench import bound_N, wrench_words
from programs.web.words import force as page_force
from tests.fake_daemon import state_at

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
def test_words_of_a_force(fields: dict[str, Any], words: str) -> None:
    assert wrench_words(wrench(**fields), "hand") == words


def test_the_bound_counts_what_directions_share() -> None:
    along = wrench(covariance=[1.0, 0.9, 0.0, 1.0, 0.0, 1.0])
    assert bound_N(along, [0.6, 0.8, 0.0]) == pytest.approx(1.96 * (1.0 + 2 * 0.9 * 0.48) ** 0.5)


@pytest.mark.parametrize("force", [[0.0, 0.0, -18.0], [12.0, -9.0, 8.0], [0.0, 0.4, 3.0]])
def test_status_and_page_show_the_same_newtons(force: list[float]) -> None:
    one = wrench(force=force)
    shown = page_force(state_at(0, wrench=one))
    assert shown is not None
    assert wrench_words(one, "hand").startswith(shown.text.replace("±", "+-"))
    np.testing.assert_allclose(shown.size * np.array(shown.way), force, atol=0.05 * 18 + 0.5)
