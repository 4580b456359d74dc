"""Sweep over levels, against counting tick by tick at each level alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimator.level_sweep import FADE_S, Debounce, Sweep, Window, levels_passed
from tests.examples import scaled

LEVELS = np.array([0.2, 0.5, 0.9, 1.4])


def begins(residual: NDArray[np.float64], level: float, debounce: int) -> list[int]:
    """Ticks at which a contact begins, as `ContactDetector` counts them."""
    found, streak = [], 0
    for k, r in enumerate(residual):
        past = 1 if r > level else -1 if r < -level else 0
        streak = past + streak if past * streak > 0 else past
        if abs(streak) == debounce:
            found.append(k)
    return found


def swept(
    residual: NDArray[np.float64], debounce: int, parts: int, windows: tuple[Window, ...] = ()
) -> Sweep:
    sweep, debounced = Sweep(len(LEVELS), windows), Debounce(1, debounce)
    time_s = 0.01 * np.arange(len(residual))
    for part in np.array_split(np.arange(len(residual)), parts):
        if len(part):
            column = residual[part, np.newaxis]
            passed = debounced.add(np.abs(column), column)[:, 0]
            sweep.add(time_s[part], levels_passed(passed, LEVELS))
    return sweep


@settings(max_examples=scaled(60), deadline=None)
@given(seed=st.integers(0, 10**6), debounce=st.integers(1, 4), parts=st.integers(1, 9))
def test_every_level_is_counted_as_if_it_were_alone(seed: int, debounce: int, parts: int) -> None:
    rng = np.random.default_rng(seed)
    residual = np.convolve(rng.normal(size=160), np.ones(3) / 2.0)
    windows = (Window(0.3, 0.5), Window(1.1, 1.15))
    sweep = swept(residual, debounce, parts, windows)
    for k, level in enumerate(LEVELS):
        began = begins(residual, float(level), debounce)
        assert sweep.contacts[k] == len(began)
        outside = [
            i for i in began
            if not any(w.begin_s <= 0.01 * i <= w.end_s + FADE_S for w in windows)
        ]  # fmt: skip
        assert sweep.false[k] == len(outside)


def test_a_touch_is_found_at_once_where_a_contact_lasts_already() -> None:
    residual = np.array([0.0] * 10 + [0.6] * 30)
    sweep = swept(residual, 2, 3, (Window(0.2, 0.3), Window(0.0, 0.25)))
    assert sweep.delays_s[0].tolist() == pytest.approx([0.0, 0.0, np.inf, np.inf])
    assert sweep.delays_s[1].tolist() == pytest.approx([0.11, 0.11, np.inf, np.inf])
    assert sweep.beyond.tolist() == [29, 29, 0, 0]


def test_a_gap_ends_what_lasted() -> None:
    debounce, sweep = Debounce(1, 2), Sweep(len(LEVELS))
    rows = np.full((5, 1), 0.6)
    for _ in range(2):
        sweep.add(0.01 * np.arange(5), levels_passed(debounce.add(rows, rows)[:, 0], LEVELS))
    assert sweep.contacts.tolist() == [1, 1, 0, 0]
    debounce.forget()
    sweep.forget()
    sweep.add(0.01 * np.arange(5), levels_passed(debounce.add(rows, rows)[:, 0], LEVELS))
    assert sweep.contacts.tolist() == [2, 2, 0, 0]
