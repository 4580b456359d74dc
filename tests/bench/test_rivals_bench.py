"""Bench of rivals: what counts as felt, what the networks see, and the whole where PyTorch is."""

import importlib.util
import json
import math
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from bench import rivals
from bench.rigs.arm_without_bus import Recording
from bench.study.population import Step
from bench.study.rivals import Recipe, Recurrent, seen_by_network

needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None, reason="NOT TRIED: no PyTorch (extra `rivals`)"
)


def test_a_hand_is_felt_while_it_pushes_and_one_of_ten_may_be_missed():
    nothing = dict.fromkeys(Recording.__dataclass_fields__, np.zeros((1, 1)))
    seen = Recording(**nothing | {"time_s": np.zeros(100), "phi": np.zeros((1000, 2))})
    late, never = pytest.approx(0.047), math.inf
    cases = [(1, 24, 0.6, late), (-1, 24, -0.6, late), (1, 24, -0.6, never), (1, 24, 0.4, never)]
    for torque, begin, value, expected in [*cases, (1, 10, 0.6, never), (1, 70, 0.6, never)]:
        r = np.zeros((100, 2))
        r[begin:, 1] = value
        assert rivals.delay_s(seen, r, np.full((100, 2), 0.5), Step(1, torque, 203)) == expected
    felt = [(1.0 + 0.1 * k, 0.05) for k in range(18)]
    assert rivals.smallest([*felt, (0.9, never), (0.8, never), (0.7, never)]) == 0.8
    assert rivals.smallest([(0.5, 0.05), (3.0, never)]) == never


def test_the_networks_do_not_see_the_current_and_the_bench_says_what_it_lacks(monkeypatch):
    samples = np.random.default_rng(1).normal(size=(50, 4, 2))
    before = seen_by_network(samples, 0.01)
    samples[:, 0] = 0.0
    np.testing.assert_array_equal(seen_by_network(samples, 0.01), before)
    monkeypatch.setitem(sys.modules, "torch", None)
    result = CliRunner().invoke(rivals.main, ["--quick"])
    assert (result.exit_code, result.output.count("\n")) == (1, 1)
    assert "[rivals]" in result.output


@needs_torch
def test_a_network_learns_what_depends_on_the_past_alone():
    x = np.random.default_rng(2).normal(size=(2000, 1))
    y = 5.0 + np.vstack((np.zeros((1, 1)), x[:-1]))
    net = Recurrent(x, y, 1, Recipe(8, 20, 5, 16, dropout=0.0, rate=0.05, epochs=12))
    assert np.std(y - net.expects(x)) < 0.3
    np.testing.assert_allclose(net.expects(x[:99]), net.expects(x)[:99], atol=1e-5)


@needs_torch
def test_the_command_compares_every_residual_under_every_change():
    result = CliRunner().invoke(rivals.main, "--quick --arms 1 --jobs 1 --json")
    found = json.loads(result.stdout.splitlines()[-1])["data"]["found"]
    assert set(found) == {*rivals.RIVALS, "backlash", rivals.SHIPPED}
    assert {len(changes) for changes in found.values()} == {4, 5}
