"""Contact levels that would be in force at another speed, with present knowledge."""

import numpy as np

from common.arrays import Vector
from common.elementary import decay
from estimator.kernel import Kernel
from estimator.motor_position import Side
from estimator.transmission import REST_VELOCITY


def levels_at(kernel: Kernel, speed: Vector) -> Vector:
    """Contact levels (n,) [Nm] at motor speeds (n,) [rad/s], none of them negative."""
    return np.array([_level_at(kernel, i, float(speed[i])) for i in range(kernel.n)])


def _level_at(kernel: Kernel, i: int, speed: float) -> float:
    levels, position = kernel.levels, kernel.motor_position
    rest, unknown_side = decay((speed / REST_VELOCITY) ** 2), position.side[i] == Side.UNKNOWN
    held = kernel.stiction.unknown_at_rest(i) * rest
    load = kernel.adaptation.load_friction(i, kernel.tau_M[i])
    above = levels.friction_at(i, rest, held, position.friction[i], load)
    above += levels.uncertainty(i, unknown_side, False, False, 0.0)
    unknown = kernel.adaptation.unknown_at(i, speed, kernel.transmitted[i])
    above += levels.share[i] * (levels.configured(i, speed) - levels.configured(i, 0.0) + unknown)
    return float(levels.contact_at(i, above))
