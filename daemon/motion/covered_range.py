"""Range of motion covered by the thresholds, compared with a path, or with a stream so far.

A level was learned at certain speeds and in certain poses. Beyond them the residual may be larger,
and exceed its level without a contact. Pure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from daemon.motion.path import PathPoint

_FASTER = 1.1  # ratio to the speed covered, above which a warning is given
_FURTHER = 0.1  # [rad] outside the covered range, above which a warning is given


@dataclass(frozen=True, slots=True)
class CoveredRange:
    """Largest speed [rad/s] and range of the links [rad], (n,); infinite where unknown."""

    speed: Vector
    lower: Vector
    upper: Vector

    def beyond(self, joints: Sequence[str], q: Vector, place: PathPoint) -> list[str]:
        """Warnings for each joint that the rest of the path, anchored at q (n,) [rad], moves faster
        or further than its levels cover."""
        low, high = place.path.extent(place.s)
        origin = q - place.path.offset(place.s)
        lowest, highest = np.minimum(q, origin + low), np.maximum(q, origin + high)
        return self.warnings(joints, place.path.fastest(place.s), lowest, highest)

    def warnings(
        self, joints: Sequence[str], fastest: Vector, lowest: Vector, highest: Vector
    ) -> list[str]:
        """Warnings about a motion of this largest speed (n,) [rad/s] and range (n,) [rad]."""
        warnings = []
        for i, name in enumerate(joints):
            if fastest[i] > _FASTER * self.speed[i]:
                warnings.append(
                    f"{name} moves at up to {fastest[i]:.2g} rad/s; its thresholds cover "
                    f"{self.speed[i]:.2g}"
                )
            a, b = lowest[i], highest[i]
            if fastest[i] > 0.0 and (a < self.lower[i] - _FURTHER or b > self.upper[i] + _FURTHER):
                warnings.append(
                    f"{name} moves within [{a:.2f}, {b:.2f}] rad; its thresholds cover "
                    f"[{self.lower[i]:.2f}, {self.upper[i]:.2f}]"
                )
        return warnings
