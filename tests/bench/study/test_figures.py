"""Figures of reports: flat names, and what counts as a difference."""

import math
from typing import Any

import pytest

from bench.study.figures import Figure, figures, verdicts


def report(value: float, data: dict[str, Any]) -> dict[str, Any]:
    return {"targets": [{"name": "alarms", "value": value, "met": True}], "data": data}


def test_figures_are_named_by_where_they_stand() -> None:
    found = figures(report(2, {"joints": ["a", "b"], "p": {"q": [1, {"r": None}]}, "ok": True}))
    assert found == {
        "target alarms": 2.0,
        "joints / 0": "a",
        "joints / 1": "b",
        "p / q / 0": 1.0,
        "p / q / 1 / r": None,
        "ok": "True",
    }


@pytest.mark.parametrize(
    ("before", "today", "kind"),
    [
        ([1.0, 2.0], [1.0, 2.0], "same"),
        ([math.nan, None], [math.nan, None], "same"),
        ([1.0, 2.0, 3.0], [2.0, 3.0, 4.0], "noise"),
        ([1.0, 2.0, 3.0], [3.0, 1.0, 2.0], "noise"),
        ([1.0, 2.0, 3.0], [3.5, 4.5, 5.5], "differs"),
        ([1.0, 2.0, 3.0], [-1.5, -0.5, 0.5], "differs"),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], "differs"),
        ([1.0], [1.0000001], "differs"),
        ([1.0, math.nan], [1.0 + 1e-12, math.nan], "same"),
        (["yes", "no"], ["no", "no"], "noise"),
        (["yes", "yes"], ["yes", "no"], "differs"),
        ([1.0, None], [None, 1.0], "noise"),
        ([1.0, 1.0], [1.0, None], "differs"),
        ([None, None], [None, 5.0], "differs"),
        ([1.0, 2.0], [1.0, math.nan], "differs"),
    ],
)
def test_a_figure_differs_where_it_moves_by_more_than_between_seeds(
    before: list[Figure], today: list[Figure], kind: str
) -> None:
    (found,) = verdicts([{"f": x} for x in before], [{"f": x} for x in today])
    assert (found.name, found.kind) == ("f", kind)


def test_a_figure_that_only_one_code_has_differs() -> None:
    found = verdicts([{"a": 1.0}], [{"a": 1.0, "b": 2.0}])
    assert [verdict.kind for verdict in found] == ["same", "differs"]
    assert str(found[1]) == "b: None before, 2 today"
