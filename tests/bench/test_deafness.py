"""Bench of deafness: what it draws, how it judges, and some of its cases."""

from dataclasses import replace

import numpy as np
import pytest

from bench.deafness import ARMS, MODES, Case, Heard, cases, led, losses, measure, verdict
from bench.rigs.losses import Loss, Pattern
from daemon.modes.table import Mode

CASE = Case(
    arm="romeo",
    mode=Mode.TRACKING,
    loss=Loss("samples", Pattern(2, 5), 6),
    joint=2,
    blow=False,
    seed=3,
)
NOTHING = Heard(felt_s=None, lost_ticks=0, deaf_s=None, stopped_s=None, resumed_early=False)
FELT = replace(NOTHING, felt_s=0.04)


@pytest.mark.parametrize(
    ("lossy", "found"),
    [
        (FELT, "felt"),
        (replace(NOTHING, felt_s=0.19), "felt"),
        (replace(NOTHING, felt_s=0.20), "deaf"),
        (NOTHING, "deaf"),
        (replace(NOTHING, stopped_s=0.15), "stopped"),
        (replace(NOTHING, stopped_s=0.16), "deaf"),
        (replace(NOTHING, stopped_s=0.5, deaf_s=0.4), "stopped"),
        (replace(NOTHING, stopped_s=0.16, deaf_s=-1.0), "deaf"),
    ],
)
def test_how_a_push_is_judged(lossy: Heard, found: str) -> None:
    assert verdict(CASE, FELT, lossy) == found
    told = "told" if found == "stopped" else found
    assert verdict(replace(CASE, mode=Mode.HOLDING), FELT, lossy) == told


@pytest.mark.parametrize("loss", list(losses()), ids=str)
def test_as_much_is_lost_as_it_says(loss: Loss) -> None:
    lost = loss.drawn(np.random.default_rng(1), 20_000, 4)
    pattern = loss.pattern
    share = pattern.share or pattern.lost / pattern.of
    if loss.whose == "all":
        assert (lost.all(axis=1) == lost.any(axis=1)).all()
    elif loss.whose == "each":
        assert (lost.all(axis=1) != lost.any(axis=1)).any()
    else:
        assert not lost[:, 1:].any()
    assert lost[:, 0].mean() == pytest.approx(share, rel=0.15)


def test_every_mode_arm_and_loss_is_drawn() -> None:
    drawn = list(cases(tuple(ARMS), 2))
    assert {case.mode for case in drawn} == set(MODES)
    assert {(case.arm, case.mode) for case in drawn} == {(a, m) for a in ARMS for m in MODES}
    assert {str(case.loss.pattern) for case in drawn} == {str(loss.pattern) for loss in losses()}
    assert {case.blow for case in drawn} == {False, True}


@pytest.mark.parametrize(
    "case",
    [
        CASE,  # a wrist that misses two samples of five used to blind the elbow
        replace(CASE, loss=Loss("deadlines", Pattern(2, 3), "all")),
        replace(CASE, loss=Loss("deadlines", Pattern(2, 4), "all"), joint=0, blow=True),
        replace(CASE, loss=Loss("samples", Pattern(share=0.2), "each"), mode=Mode.ADMITTANCE),
        replace(CASE, loss=Loss("samples", Pattern(8, 80, burst=True), "all")),
    ],
    ids=str,
)
def test_it_is_felt_or_the_arm_stops(case: Case) -> None:
    lossless, lossy = (measure(case, lossy=way) for way in (False, True))
    assert lossless.felt_s is not None
    assert verdict(case, lossless, lossy) != "deaf"


@pytest.mark.parametrize("arm", list(ARMS))
def test_it_never_goes_on_by_itself_in_a_hand(arm: str) -> None:
    for seed, pattern in enumerate((Pattern(2, 3), Pattern(2, 5), Pattern(share=0.2))):
        early, _ = led(arm, Loss("samples", pattern, 0), seed)
        assert not early
