"""Numbers of setpoints, in any make's language."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.motors.language import scaled


@given(st.floats(-100.0, 100.0), st.sampled_from((12, 16)))
def test_a_scaled_value_is_the_nearest_that_there_is(value: float, bits: int) -> None:
    step = 2.0 * 12.5 / ((1 << bits) - 1)
    found = scaled(value, 12.5, bits) * step - 12.5
    assert abs(found - min(max(value, -12.5), 12.5)) <= 0.5 * step + 1e-9
