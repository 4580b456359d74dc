"""Advice on a velocity loop whose gains are too low: the drive receives its setpoints.

A drive that hears nothing keeps its current. One whose current goes the way of its setpoint, though
too slowly for the friction that holds its motor, was heard: what helps is the drive's own gain, or
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
"""States before the end of a motion that are evaluated."""
_MARGIN = 1.5  # times the largest deviation that was seen: docs/porting.md
_LARGEST_MARGIN = 1.0  # times the velocity limit: a larger one is not proposed


def advice_on_following(ended: str, last: Sequence[State], c: Configuration) -> str:
    """Remedy for the joint that `ended` a motion because its drive did not follow, by the `last`
    States of it; empty where it ended otherwise, or the drive may be deaf."""
    for i, joint in enumerate(c.joints):
        if f"{Condition.NOT_FOLLOWING}: {joint.name}" not in ended or len(last) < TICKS:
            continue
        off = np.array([s.setpoint[i] - s.motor_velocity[i] for s in last[-TICKS:]])
        pressed = last[-1].current[i] - last[-TICKS].current[i]
        if pressed * off[-1] < HEARD_SHARE * joint.wiring.max_current_A * abs(off[-1]):
            return ""
        advice = f". {joint.name}: its velocity loop is soft: raise its gains by the maker's tool"
        margin = math.ceil(10.0 * _MARGIN * float(np.abs(off).max()) / joint.limits.velocity) / 10.0
        if c.supervisor.following_margin < margin <= _LARGEST_MARGIN:
            advice += (f"; if that cannot be, set supervisor.following_margin to {margin:g} (it is "
                     f"{c.supervisor.following_margin:g})")  # fmt: skip
        return f"{advice}: docs/porting.md, step 8"
    return ""
