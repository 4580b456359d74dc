"""The subtractive dead-band."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.contact import dead_band

FINITE = st.floats(-100, 100)


@given(r=FINITE, threshold=st.floats(0.01, 10))
def test_dead_band_is_the_formula(r: float, threshold: float) -> None:
    expected = np.sign(r) * max(abs(r) - threshold, 0.0)
    result = dead_band(np.array([r]), np.array([threshold]))[0]
    assert result == pytest.approx(expected, abs=1e-12)
