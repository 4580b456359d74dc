"""Words on the force at the tool: norm, confidence, direction, and unobservable directions."""

from collections.abc import Sequence
from math import hypot, sqrt

from daemon.protocol.state import Wrench
from programs.clients.sensitivity import AXES, along

_BOUND = 1.96  # standard deviations: 95 %
_ALONG_AN_AXIS = 0.9  # cosine of 26 degrees
NO_FIT = 2.0
"""Misfit above which no single force at the tool explains the residuals."""

_ELSEWHERE = "not one force at the tool: elsewhere, or two"


def wrench_words(wrench: Wrench, frame: str) -> str:
    """Words such as `18 N +- 4, towards -z of FRAME; along y not seen`."""
    unseen = f"along {' and '.join(map(along, wrench.unseen))} not seen" if wrench.unseen else ""
    size = hypot(*wrench.force)
    if size == 0.0:
        words = f"{'nothing' if wrench.strength < 1.0 else 'a force'} beyond its level"
        words = _ELSEWHERE if wrench.misfit > NO_FIT else words
        return f"{words}; {unseen}" if unseen else words
    words = force_words(wrench.force, frame, f" +- {bound_N(wrench, _unit(wrench.force)):.0f}")
    if wrench.misfit > NO_FIT:
        words += f"; {_ELSEWHERE}"
    return f"{words}; {unseen}" if unseen else words


def force_words(force: Sequence[float], frame: str, bound: str = "") -> str:
    """Words such as `18 N, towards -z of FRAME` for a non-zero force (3,) [N]."""
    return f"{hypot(*force):.0f} N{bound}, towards {_towards(_unit(force))} of {frame}"


def bound_N(wrench: Wrench, direction: list[float]) -> float:
    """Half-width of the 95 % confidence interval of the force along a unit vector (3,) [N]."""
    xx, xy, xz, yy, yz, zz = wrench.covariance
    x, y, z = direction
    variance = xx * x * x + yy * y * y + zz * z * z
    variance += 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    return _BOUND * sqrt(max(variance, 0.0))


def most_aside_N(wrench: Wrench, direction: list[float]) -> float:
    """Largest such half-width among directions perpendicular to a unit vector (3,) [N]."""
    least = min(range(3), key=lambda axis: abs(direction[axis]))
    x, y, z = direction
    axis = [float(k == least) for k in range(3)]
    first = _unit([y * axis[2] - z * axis[1], z * axis[0] - x * axis[2], x * axis[1] - y * axis[0]])
    u, v, w = first
    second = [y * w - z * v, z * u - x * w, x * v - y * u]
    across = [
        _unit([a * p + b * q for p, q in zip(first, second, strict=True)])
        for a, b in ((1, 0), (1, 1), (0, 1), (1, -1))
    ]
    return max(bound_N(wrench, one) for one in across)


def _unit(direction: Sequence[float]) -> list[float]:
    size = hypot(*direction)
    return [part / size for part in direction]


def _towards(direction: list[float]) -> str:
    for axis, part in zip(AXES, direction, strict=True):
        if abs(part) > _ALONG_AN_AXIS:
            return ("-" if part < 0.0 else "+") + axis
    return "(" + " ".join(f"{round(part, 1) + 0.0:.1f}" for part in direction) + ")"
