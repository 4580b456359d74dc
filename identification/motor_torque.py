"""Torque that a motor reports over the one that its own loop was asked for: a range of its feedback
that is another than configured, which shows at any joint, also where gravity does not act.

    asked = stiffness (p - q) + damping (u - q_dot),  p += u T;    reported = ratio asked + constant

Friction, whose direction turns, is what it works against. All errors are those of `asked`, which
is therefore fitted by `reported`. In which part of a period the setpoint in force was taken
up is not known: by one of the tick before and of two before, the ratio lies between both.
"""

import numpy as np

from identification.motion_log import MotionLog

_TICKS = (1, 2)
_LEAST_R2 = 0.9


def reported_by_asked(
    log: MotionLog, joint: int, stiffness: float, damping: float, Nm_per_A: float
) -> tuple[float, float]:
    """Ratio, and how far it may be off; NaN and infinity where the motion does not show it."""
    if log.setpoint is None:
        return np.nan, np.inf
    q, v, u = log.link_position[:, joint], log.motor_velocity[:, joint], log.setpoint[:, joint]
    p, torque = np.cumsum(u) * log.period_s, Nm_per_A * log.current[:, joint]
    ratios = []
    for k in _TICKS:
        asked = stiffness * (p[:-k] - q[k:]) + damping * (u[:-k] - v[k:])
        (of_asked, both), (_, of_torque) = np.cov(asked, torque[k:])
        if not both**2 > _LEAST_R2 * of_asked * of_torque:
            return np.nan, np.inf
        ratios.append(float(of_torque / both))
    return 0.5 * sum(ratios), 0.5 * abs(ratios[1] - ratios[0])
