"""Scores of `bench.wrench`, and a short run of one arm."""

from typing import Any

import numpy as np
import pytest

from bench.study.wrench import Job, run
from bench.study.wrench_bound import most_decided
from bench.wrench import links, points, scores


def tick(**fields: Any) -> dict[str, Any]:
    made = {
        "place": "tool", "acts": True, "error": np.array([0.5, -1.0, 30.0]), "naive": 4.0,
        "sigma": np.array([1.0, 0.5, 200.0]), "seen": np.array([True, True, False]),
        "misfit": 0.8, "shows": np.array([9.0, 5.0, 0.1]), "called": np.array([True, True, False]),
    }  # fmt: skip
    return made | fields


def test_errors_count_along_seen_directions_while_a_force_is_shown() -> None:
    quiet = tick(acts=False, error=np.full(3, 50.0))
    elsewhere = tick(place="link", misfit=3.0, called=np.array([False, True, True]))
    found = scores([{"forces": [tick(), quiet, elsewhere], "links": []}])
    assert found["tool"]["shown"] == pytest.approx(0.5)
    assert found["tool"]["error_N"][0] == pytest.approx(0.75)
    assert found["tool"]["error_of_all_three_N"][0] == pytest.approx(np.hypot(0.5, 1.0))
    assert found["tool"]["within_bounds"] == pytest.approx(0.5)  # 1.0 is beyond 1.96 * 0.5
    assert found["called_seen"] == pytest.approx(5.0 / 6.0)
    assert found["called_unseen"] == pytest.approx(2.0 / 3.0)
    assert found["elsewhere_misfit_above_2"] == pytest.approx(1.0)


def test_names_of_links_count_from_where_one_is_named() -> None:
    named = [[-1, 2, 3], [-1, -1, 4], [-1, -1, -1], [3, 3, 3]]
    early = {"after_s": 0.2, "first": 0, "least": 0, "decided": True, "placed": True, "error": 0.02,
             "doubt": 0.03}  # fmt: skip
    said = [
        [early],
        [
            early | {"first": -2, "least": -2, "decided": False, "placed": False},
            early | {"first": -2},
        ],
        [early | {"decided": False, "least": 1}, early | {"after_s": 0.6, "error": 0.05}],
        [],
    ]
    runs = [
        {"links": [
            {"row": 3, "n": 5, "named": np.array(one), "touches": touches, "size": 20.0,
             "bound": (True, 0.9, k == 0, 0.5)}
            for k, (one, touches) in enumerate(zip(named, said, strict=True))
        ]}
    ]  # fmt: skip
    found = links(runs)
    assert found["decided"] == pytest.approx(2.0 / 3.0)
    assert found["decided_right"] == found["decided_off_by_more_than_one"] == 0.5
    assert found["not_the_last_right"] == 0.5
    assert found["could_be_decided"] == 1.0
    assert found["could_be_by_even_odds"] == pytest.approx(1.0 / 3.0)
    assert found["decided_ticks_right"] == pytest.approx(2.0 / 3.0)
    assert found["at_first_a_true_at_least"] == pytest.approx(2.0 / 3.0)
    placed = points(runs)
    assert placed["given"] == pytest.approx(4.0 / 5.0)
    assert placed["within_doubt"] == pytest.approx(3.0 / 4.0)
    assert found["presses"] == 3
    assert found["first_right"] == pytest.approx(1.0 / 3.0)
    assert found["first_further_out"] == pytest.approx(1.0 / 3.0)
    assert found["last_right"] == pytest.approx(2.0 / 3.0)


def test_a_short_run_of_an_arm() -> None:
    """At rest, two presses at the tool: what is said is near the truth, along the tool's axes."""
    found = run(Job("romeo", "rest", "dahl", 2, worked_s=20.0, seconds=13.0))
    assert found["free_s"] > 2.0
    ticks = [f for f in found["forces"] if f["acts"] and f["place"] in ("tool", "beside")]
    assert ticks
    beyond = [np.abs(f["error"])[f["seen"]] > 4.0 * f["sigma"][f["seen"]] for f in ticks]
    assert np.mean(np.concatenate(beyond)) < 0.1
    assert np.median([np.abs(f["error"])[f["seen"]].max() for f in ticks]) < 4.0
    right, sure, _, _ = found["links"][0]["bound"]
    assert right
    assert sure > 0.9


def test_as_many_are_decided_as_leave_95_of_100_right() -> None:
    right = np.array([1.0] * 19 + [0.0] + [0.0] * 5)
    assert most_decided(right, np.arange(25, 0, -1)) == pytest.approx(20 / 25)
    assert most_decided(np.zeros(3), np.ones(3)) == 0.0
