"""Motion that the thresholds have seen, against a path that is about to run.

A level was learned at some speeds and in some poses. Beyond them the residual may be larger, and
what exceeds a level there is no touch. Pure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from arrays import Vector
from daemon.motion.path import Place

_FASTER = 1.1  # of the speed seen, before it is told
_FURTHER = 0.1  # [rad] outside the range seen


@dataclass(frozen=True, slots=True)
class SeenMotion:
    """Largest speed [rad/s] and range of the links [rad], (n,); infinite where nothing is known."""

    speed: Vector
    lower: Vector
    upper: Vector

    def beyond(self, joints: Sequence[str], q: Vector, place: Place) -> list[str]:
        """Warnings for each joint that the rest of the path, anchored at q (n,) [rad], leads faster
        or further than its levels have seen."""
        fastest = place.path.fastest(place.s)
        low, high = place.path.extent(place.s)
        origin = q - place.path.offset(place.s)
        warnings = []
        for i, name in enumerate(joints):
            if fastest[i] > _FASTER * self.speed[i]:
                warnings.append(
                    f"{name} will reach {fastest[i]:.2g} rad/s; its thresholds have seen "
                    f"{self.speed[i]:.2g}"
                )
            a, b = min(q[i], origin[i] + low[i]), max(q[i], origin[i] + high[i])
            if fastest[i] > 0.0 and (a < self.lower[i] - _FURTHER or b > self.upper[i] + _FURTHER):
                warnings.append(
                    f"{name} will move within [{a:.2f}, {b:.2f}] rad; its thresholds have seen "
                    f"[{self.lower[i]:.2f}, {self.upper[i]:.2f}]"
                )
        return warnings
