"""Pairs: ratios with bounds, turns, and workers that run on both codes."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.study.before import ROOT, code_before
from bench.study.pairs import Sides, Worker, in_turns, named, ratio, sides


def test_a_ratio_is_of_pairs_and_not_of_sums() -> None:
    # The machine was ten times slower in the third pair.
    found = ratio([(1.0, 2.0), (1.1, 2.0), (10.0, 20.0)])
    assert found.median == 0.5
    assert (found.low, found.high, found.pairs) == (0.5, 0.55, 3)


@pytest.mark.parametrize(
    ("pairs", "low", "high"),
    # Ranks of the sign test at 5 %, from tables: 1 of 6 to 8, 2 of 9 to 11, 3 of 12 to 14, 6 of 20.
    [(1, 1, 1), (5, 1, 5), (6, 1, 6), (8, 1, 8), (9, 2, 8), (12, 3, 10), (20, 6, 15)],
)
def test_bounds_of_a_median_are_those_of_the_sign_test(pairs: int, low: int, high: int) -> None:
    found = ratio([(float(k), 1.0) for k in range(pairs, 0, -1)])
    assert (found.low, found.high) == (low, high)
    assert found.low <= found.median <= found.high


def test_bounds_hold_the_true_median_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(1000):
        found = ratio([(float(x), 1.0) for x in rng.lognormal(0.0, 0.5, 12)])
        held += found.low <= 1.0 <= found.high
    assert 940 <= held <= 985  # 96.1 % for twelve pairs


def test_percentiles_of_ratios() -> None:
    found = ratio([(float(k), 1.0) for k in range(1, 21)])
    assert (found.p10, found.p90) == (2.0, 18.0)
    assert found.data()["median"] == 10.5


def test_without_pairs_there_is_no_ratio() -> None:
    with pytest.raises(ValueError, match="no pairs"):
        ratio([])


class _Asked(Worker):
    def __init__(self) -> None:
        """No process."""


def test_turns_begin_with_the_other_side_each_time() -> None:
    both = Sides(_Asked(), _Asked())
    order: list[Worker] = []

    def measure(worker: Worker) -> int:
        order.append(worker)
        return len(order)

    today, before = in_turns(both, 3, measure)
    assert (today, before) == ([1, 4, 5], [2, 3, 6])
    assert in_turns(Sides(both.today, None), 2, lambda _: 0.0) == ([0.0, 0.0], [])


@pytest.fixture(scope="module")
def before() -> Iterator[Path]:
    with code_before() as found:
        if found is None:
            pytest.skip(named(found))
        yield found


def options(name: str, folder: Path) -> dict[str, Any]:
    return {
        "lockstep": {"seed": 1},
        "replay": {"seed": 1, "seconds": 2.0, "folder": str(folder)},
        "loop": {"hz": 100, "waits": False},
    }[name]


REQUESTS: dict[str, list[dict[str, Any]]] = {
    "lockstep": [{"seconds": 0.1}],
    "replay": [{"arm": "desk_arm", "part": part} for part in ("replay", "decode", "step")],
    "loop": [{"ticks": 150}, {"ticks": 20}],
}


@pytest.mark.parametrize("name", list(REQUESTS))
def test_a_worker_runs_on_both_codes(name: str, before: Path, tmp_path: Path) -> None:
    for side in ("today", "before"):
        (tmp_path / side).mkdir()
    with sides(name, before, lambda side: options(name, tmp_path / side)) as found:
        assert found.before is not None
        for request in REQUESTS[name]:
            today, then = ([worker.ask(**request)] for worker in found.both())
            assert today[0].keys() == then[0].keys()
            if name == "replay":
                assert today[0]["states"] == then[0]["states"] > 100
            if name == "loop":
                assert today[0]["mode"] == then[0]["mode"] == "tracking"
                assert len(today[0]["setpoint_us"]) == request["ticks"]
                assert all(0.0 < us < math.inf for us in today[0]["setpoint_us"][-20:])
            else:
                assert today[0]["cpu_s"] > 0.0


def test_a_worker_measures_the_code_in_its_folder(tmp_path: Path) -> None:
    """Not that of the folder its file lies in."""
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "__init__.py").write_text("raise SystemExit(7)")
    worker = Worker("lockstep", tmp_path, {"seed": 1})
    with pytest.raises(RuntimeError, match="ended with status 7"):
        worker.receive()
    worker.close()


def test_a_worker_that_fails_is_no_silence(capfd: pytest.CaptureFixture[str]) -> None:
    worker = Worker("replay", ROOT, {"seed": 1})
    with pytest.raises(RuntimeError, match=r"worker replay on .* ended with status 1"):
        worker.receive()
    worker.close()
    assert "KeyError: 'folder'" in capfd.readouterr().err
