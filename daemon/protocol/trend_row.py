"""Row of one tick that the daemon sends to the process that gathers trends: float64, in order.

[tick, wall_s, quiet], and for each joint [q, theta, theta_dot, residual, friction, doubt], SI at
the link: theta is NaN where no drive measures it; quiet is 1 where no contact is sensed; friction
is the learned Coulomb friction over that of the configuration, doubt the rest of its deviation.
"""

import re
from pathlib import Path
from typing import Final

TICK, WALL, QUIET = range(3)
HEAD: Final = 3
Q, THETA, THETA_DOT, RESIDUAL, FRICTION, DOUBT = range(6)
PER_JOINT: Final = 6


def row_length(n: int) -> int:
    """Numbers in a row of n joints."""
    return HEAD + PER_JOINT * n


def trends_folder(state: Path, arm: str) -> Path:
    """Folder of the day records of an arm, which that process writes, in the state directory."""
    slug = re.sub(r"[^A-Za-z0-9]+", "-", arm).strip("-").lower() or "arm"
    return state / "trends" / slug
