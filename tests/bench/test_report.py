"""Report of a bench, where a figure could not be measured."""

import json
import math

import numpy as np
import pytest

from bench.report import Target, print_report
from daemon.modes.table import Mode


@pytest.mark.parametrize("better", ["lower", "higher"])
def test_what_was_not_measured_is_not_met_and_said(better, capsys) -> None:
    target = Target("smallest step", math.nan, 6, "x", better)
    print_report("some", 1, [target], {}, as_json=False)
    sign = {"lower": "<=", "higher": ">="}[better]
    assert (
        capsys.readouterr().out == f"  smallest step: too few trials to tell ({sign} 6) NOT MET\n"
    )
    data = {"a": {Mode.HOLDING: np.array([0.12346, math.nan]), "b": Mode.HOLDING}}
    print_report("some", 1, [], data, as_json=False)
    assert capsys.readouterr().out == "a:\n  holding: [0.1235, null]\n  b: holding\n\n"
    print_report("some", 1, [target], {}, as_json=True)

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    row = json.loads(capsys.readouterr().out, parse_constant=refuse)["targets"][0]
    assert row["value"] is None
    assert row["met"] is False
