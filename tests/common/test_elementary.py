"""Elementary functions against numpy's, and where they have no value."""

import math
from itertools import pairwise

import numpy as np
import pytest

from common.elementary import cosine, decay, sine, smooth_sign

RNG = np.random.default_rng(1)
ANGLES = np.concatenate(
    [RNG.uniform(-7, 7, 3000), RNG.uniform(-1e6, 1e6, 1000), np.arange(-40, 41) * np.pi / 8]
).tolist()


@pytest.mark.parametrize(("ours", "theirs"), [(sine, np.sin), (cosine, np.cos)])
def test_angles(ours, theirs) -> None:
    for x in ANGLES:
        assert abs(ours(x) - theirs(x)) < 3e-16


def test_sines_keep_the_digits_of_small_angles() -> None:
    for x in (1e-3, -1e-9, 1e-300, 0.0):
        assert sine(x) == pytest.approx(math.sin(x), rel=3e-16, abs=0.0)


def test_decay_and_the_smooth_sign() -> None:
    for x in np.concatenate([[0.0], RNG.uniform(0, 2, 2000), RNG.uniform(0, 690, 2000)]).tolist():
        assert decay(x) == pytest.approx(math.exp(-x), rel=5e-16, abs=0.0)
        for signed in (x, -x):
            assert abs(smooth_sign(signed) - math.tanh(signed)) < 3e-16
    assert decay(701.0) == decay(math.inf) == 0.0
    assert (smooth_sign(math.inf), smooth_sign(-math.inf)) == (1.0, -1.0)


def test_nothing_jumps_where_one_series_takes_over_from_the_other() -> None:
    near = [
        border + step * 1e-12 for border in (0.125, math.pi / 4, 1.0) for step in range(-50, 50)
    ]
    for function in (sine, cosine, decay, smooth_sign):
        for a, b in pairwise(sorted(near)):
            if b - a < 1e-11:
                assert abs(function(a) - function(b)) < 2e-12


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf, 1e6, -1e200])
def test_what_is_no_angle_is_no_number(x: float) -> None:
    assert math.isnan(sine(x))
    assert math.isnan(cosine(x))
    assert math.isnan(decay(math.nan))
    assert math.isnan(smooth_sign(math.nan))
