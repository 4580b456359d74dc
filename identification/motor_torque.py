"""Ratio of the torque that a motor reports to the one that its own loop was asked for: it shows a
wrong range of the feedback, at any joint, also where gravity does not act.

    asked = stiffness (p - q) + damping (u - q_dot),  p += u T;    reported = ratio asked + constant

Friction, which changes direction, is the load. All errors are attributed to `asked`, which is
therefore fitted by `reported`. In which part of a period the setpoint in force was adopted is
unknown: the ratio lies between those by the setpoints of the last tick and of the one before.
"""

import numpy as np

from identification.motion_log import MotionLog

_TICKS = (1, 2)
_LEAST_R2 = 0.9


def reported_by_asked(
    log: MotionLog, joint: int, stiffness: float, damping: float, Nm_per_A: float
) -> tuple[float, float]:
    """Ratio, and its error; NaN and infinity if the motion does not show it."""
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
