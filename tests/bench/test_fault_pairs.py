"""Pairs of faults: what the daemon says of a joint holds, whatever else is broken."""

import pytest

from bench.study.fault_pairs import ALIKE, JOINTLESS, PAIRS, Pair, judged, sampled

#: The worst of them: what moves, and what hides it.
WORST = (
    ("encoder frozen", "quick stop said, and not kept"),
    ("everything measured frozen", "quick stop said, and not kept"),
    ("statusword false once: stops", "drive runs away"),
    ("every encoder dark", "quick stop said, and not kept"),
    ("quick stop said, and hunts", "every encoder dark"),
)


def named(first: str, second: str, later: int = 4) -> Pair:
    wanted = (first, second, False, later)
    return next(p for p in PAIRS if (p.first.name, p.second.name, p.apart, p.later) == wanted)


@pytest.mark.parametrize(
    "pair", [*(named(*names) for names in WORST), *sampled(4, seed=20)], ids=str
)
def test_what_is_said_of_a_joint_holds(pair: Pair) -> None:
    verdict = judged(pair)
    assert verdict.good, verdict


def test_pairs_are_of_cases_that_there_are() -> None:
    names = {pair.first.name for pair in PAIRS}
    assert names.isdisjoint(ALIKE)
    assert names >= JOINTLESS
    assert len(set(PAIRS)) == len(PAIRS)
    assert sampled(5, seed=3) == sampled(5, seed=3)
