"""Zero and sign of a joint's link encoder: from where the link stands, and which way it was pushed.

Both are seen at the arm alone: no data sheet has them, and no motion of the motor tells them from
the motor's own. A person who says where the link stands and which way it went gives both at once.
"""

import hashlib
from collections.abc import Mapping
from math import radians

import numpy as np

from arrays import Vector
from daemon.config.dynamics import model_of
from daemon.config.identified import ZeroEntry
from daemon.config.load import Robot
from daemon.config.problem import figure
from daemon.identify.steps import Line, Outcome

_REST_S = 0.2
_STILL = 0.0005  # [rad]
MOVED = 0.001  # [rad]: less than the play of most gears
_BEYOND = 0.2  # [rad]: a link may lean on a stop that the URDF's limits lie before


def resting_samples(period_s: float) -> int:
    """Samples of a link that stands, with which what is seen of it begins."""
    return max(2, round(_REST_S / period_s))


def stands(positions: Vector, least: int) -> bool:
    """True for at least so many positions (N,) [rad] of a link that stands."""
    return len(positions) >= least and float(np.ptp(positions)) < _STILL


def departure(seen: Vector, period_s: float) -> tuple[float, float]:
    """Where a link stood and how far away it is held [rad], from the positions seen (N,) [rad],
    which begin at rest and end while it is held; 0 where it is not clearly to one side."""
    few = resting_samples(period_s)
    rest = float(np.median(seen[:few]))
    away = seen[-few:] - rest
    held = np.all(away > MOVED) or np.all(away < -MOVED)
    return rest, float(np.median(away)) if held else 0.0


def not_possible(robot: Robot, stated: Mapping[str, float]) -> list[str]:
    """Angles [rad] at which no link stands, well outside the URDF's limits, in words."""
    model = model_of(robot.configuration, robot.urdf)
    reasons = []
    for name, angle in stated.items():
        i = robot.configuration.joint_names.index(name)
        lower, upper = float(model.lower[i]), float(model.upper[i])
        if not lower - _BEYOND <= angle <= upper + _BEYOND:
            within = lower <= radians(angle) <= upper
            meant = f"; in degrees? then {name}={figure(radians(angle))}" if within else ""
            reasons.append(
                f"{name}={figure(angle)}: by the URDF it stands within "
                f"[{lower:g}, {upper:g}] rad{meant}"
            )
    return reasons


def zero_step(
    robot: Robot, joint: str, seen: Vector, stands: float, *, upward: bool, date: str
) -> Outcome:
    """Sign and zero of one link encoder, by the positions (N,) [rad] that the daemon showed; the
    link stood at `stands` [rad], and went `upward` or the other way, by the URDF."""
    c = robot.configuration
    wiring = c.joints[c.joint_names.index(joint)].wiring
    rest, went = departure(seen, c.period_s)
    if went == 0.0:
        ways = 1e3 * (seen - rest)
        reason = (f"it went from {ways.min():+.1f} to {ways.max():+.1f} mrad, to {ways[-1]:+.1f} "
                  f"at last: push its link one way, by {1e3 * MOVED:.0f} mrad or more, and hold it "
                  "there until you have answered")  # fmt: skip
        return Outcome([Line(joint, "not seen", good=False, reason=reason)], {})
    sign = wiring.link_sign if (went > 0.0) == upward else -wiring.link_sign
    offset = round(stands - sign * wiring.link_sign * (rest - wiring.link_offset), 5)
    entry = ZeroEntry(
        date=date,
        log=hashlib.sha256(np.ascontiguousarray(seen).tobytes()).hexdigest(),
        link_sign=1 if sign > 0 else -1,
        link_offset=offset,
    )
    figures = (
        f"link_sign {sign:+d}, link_offset {offset:+.4g} rad; it went by {1e3 * went:+.1f} mrad"
    )
    verdict = "as it was" if sign == wiring.link_sign else "sign turned"
    return Outcome([Line(joint, verdict, good=True, figures=figures)], {joint: entry})
