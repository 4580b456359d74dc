"""Bounds of the numbers in requests. Pure data."""

from typing import Final

# Gain K_a of a joint [rad/s per Nm]: 0, or between these. The largest is the softest.
LEAST_GAIN: Final = 1e-4
MAX_GAIN: Final = 5.0
# Payload that is announced [kg]: 0, or at least this. A lighter one is not detectable.
LIGHTEST_KG: Final = 0.001
# Speed of `go` [rad/s].
SLOWEST: Final = 0.001
FASTEST: Final = 2.0
# Any time, position or velocity of a trajectory, so that no sum overflows.
PLAUSIBLE: Final = 1e9
