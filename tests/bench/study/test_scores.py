"""Statistics of the detection bench, by tables."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.study import scores
from bench.study.detection_score import stiction
from bench.study.scores import Detection, Errors, Trial


def test_a_perfect_residual_is_half_there_after_ln_2_over_K() -> None:
    shown = scores.filtered(np.ones((2000, 1)), 25.0, 0.001)[:, 0]
    assert 1e-3 * np.argmax(shown > 0.5) == pytest.approx(math.log(2) / 25.0, abs=1e-3)
    assert shown[-1] == pytest.approx(1.0)


def trial(residual: list[float], raised: float = 0.0, travelled_from: int = 9) -> Trial:
    ticks = np.arange(len(residual))
    return Trial(
        joint=0,
        size=1.0,
        delay_s=0.004 + 0.01 * ticks,
        residuals=np.array([residual], dtype=float),
        before=np.zeros(1),
        raised=np.full((1, len(residual)), raised),
        travelled=ticks >= travelled_from,
        hidden=0.0,
        breakaway=0.0,
        moving=True,
    )


@pytest.mark.parametrize(
    ("tried", "expected"),
    [
        (trial([0.0, 0.4, 0.6, 0.9]), Detection(0.024, False)),
        (trial([0.0, 0.4, 0.6, 0.9], travelled_from=1), Detection(0.024, True)),
        (trial([0.0, 0.4, 0.6, 0.9], travelled_from=3), Detection(0.024, False)),
        (trial([0.0, 0.4, 0.6, 0.9], raised=0.3), Detection(0.034, False)),
        (trial([0.0, -0.9, -0.9, 0.5]), None),
        (trial([0.9, 0.0, 0.0, 0.0]), Detection(0.004, False)),
    ],
)
def test_a_step_is_felt_where_the_residual_first_exceeds(tried: Trial, expected: object) -> None:
    found = scores.detection(tried, 0, 0.5)
    assert (found is None) == (expected is None)
    if found is not None and isinstance(expected, Detection):
        assert found.delay_s == pytest.approx(expected.delay_s)
        assert found.travelled is expected.travelled


@pytest.mark.parametrize(
    ("tried", "needed"),
    [
        (trial([0.0, 0.4, 0.6, 0.9]), 0.6),
        (trial([0.0, 0.4, 0.6, 0.9], raised=0.2), 0.8),
        (trial([-0.3, 0.1, 0.4, 0.2]), 1.1),
    ],
)
def test_size_needed_would_just_have_been_felt(tried: Trial, needed: float) -> None:
    """Steps of 1 Nm, threshold 0.5 Nm."""
    size = scores.size_needed(tried, 0, 0.5)
    assert size == pytest.approx(needed)
    other = replace(tried, residuals=tried.residuals + (size - tried.size))
    assert scores.detection(other, 0, 0.5 - 1e-9) is not None
    assert scores.detection(other, 0, 0.5 + 1e-9) is None


def test_errors_add_up_over_runs() -> None:
    error = np.array([[3.0, 1.0], [4.0, 5.0], [0.0, 7.0]])
    chosen = np.array([[True, False], [True, False], [False, False]])
    whole = Errors.of(error, chosen)
    assert whole.rms == pytest.approx([math.sqrt(12.5), 0.0])
    halves = Errors.of(error[:1], chosen[:1]) + Errors.of(error[1:], chosen[1:])
    assert halves.rms == pytest.approx(whole.rms)


def test_what_stiction_may_hide_is_twice_what_it_holds_on_the_worst_arm() -> None:
    trials = [
        replace(trial([0.0]), joint=joint, breakaway=held)
        for joint, held in ((0, 0.4), (0, 0.7), (2, 0.1))
    ]
    found = stiction(trials, 3)
    assert (found[0], found[2]) == (1.4, 0.2)
    assert math.isnan(found[1])
