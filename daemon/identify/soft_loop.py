"""Soft velocity loop in words: a drive that hears its setpoints, and presses too little for them.

A drive that hears nothing keeps its current. One whose current goes the way of its setpoint, though
too slowly for the friction that holds its motor, was heard: what helps is the drive's own gain, or
a larger `supervisor.following_margin` (docs/porting.md, step 8).
"""

import math
from collections.abc import Sequence

import numpy as np

from daemon.config.schema import Configuration
from daemon.faults.following import HEARD_SHARE, TICKS
from daemon.faults.table import Condition
from daemon.protocol.messages import State

REMEMBERED = TICKS + 10
"""States before the end of a motion that tell."""
_ROOM = 1.5  # times the largest deviation that was seen: docs/porting.md
_MOST = 1.0  # times the velocity limit: beyond, nobody looks


def why_not_followed(ended: str, last: Sequence[State], c: Configuration) -> str:
    """What helps the joint that `ended` a motion because its drive did not follow, by the `last`
    States of it; empty where it ended otherwise, or the drive may be deaf."""
    for i, joint in enumerate(c.joints):
        if f"{Condition.NOT_FOLLOWING}: {joint.name}" not in ended or len(last) < TICKS:
            continue
        off = np.array([s.setpoint[i] - s.motor_velocity[i] for s in last[-TICKS:]])
        pressed = last[-1].current[i] - last[-TICKS].current[i]
        if pressed * off[-1] < HEARD_SHARE * joint.wiring.max_current_A * abs(off[-1]):
            return ""
        said = f". {joint.name}: its velocity loop is soft: raise its gains by the maker's tool"
        margin = math.ceil(10.0 * _ROOM * float(np.abs(off).max()) / joint.limits.velocity) / 10.0
        if c.supervisor.following_margin < margin <= _MOST:
            said += (f"; if that cannot be, set supervisor.following_margin to {margin:g} (it is "
                     f"{c.supervisor.following_margin:g})")  # fmt: skip
        return f"{said}: docs/porting.md, step 8"
    return ""
