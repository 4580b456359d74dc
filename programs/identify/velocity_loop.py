"""Advice on a velocity loop whose gains are too low, although the drive receives its setpoints.

A drive that receives no setpoints keeps its current. If the current changes towards the setpoint,
only too slowly to overcome friction, setpoints arrive: the remedy is a higher gain in the drive, or
a larger `supervisor.following_margin` (docs/porting.md, step 8).
"""

import math
from collections.abc import Sequence

import numpy as np

from daemon.config.schema import Configuration
from daemon.faults.conditions import Condition
from daemon.faults.following import HEARD_SHARE, TICKS
from daemon.protocol.state import State

REMEMBERED = TICKS + 10
"""Number of States before the end of a motion that are evaluated."""
_MARGIN = 1.5  # proposed margin over the largest velocity error: docs/porting.md
_LARGEST_MARGIN = 1.0  # largest margin that is proposed, over the velocity limit


def advice_on_following(ended: str, last: Sequence[State], c: Configuration) -> str:
    """Remedy for a joint whose drive did not follow its setpoints, if that `ended` a motion, from
    its `last` States; empty for any other end, or if the drive may not receive setpoints."""
    for i, joint in enumerate(c.joints):
        if f"{Condition.NOT_FOLLOWING}: {joint.name}" not in ended or len(last) < TICKS:
            continue
        off = np.array([s.setpoint[i] - s.motor_velocity[i] for s in last[-TICKS:]])
        pressed = last[-1].current[i] - last[-TICKS].current[i]
        if pressed * off[-1] < HEARD_SHARE * joint.wiring.max_current_A * abs(off[-1]):
            return ""
        advice = f". {joint.name}: its velocity loop is too soft: raise its gains (maker's tool)"
        margin = math.ceil(10.0 * _MARGIN * float(np.abs(off).max()) / joint.limits.velocity) / 10.0
        if c.supervisor.following_margin < margin <= _LARGEST_MARGIN:
            advice += (f"; if that is impossible, set supervisor.following_margin to {margin:g} "
                       f"(it is {c.supervisor.following_margin:g})")  # fmt: skip
        return f"{advice}: docs/porting.md, step 8"
    return ""
