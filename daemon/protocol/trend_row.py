"""Row of one tick that the daemon sends to the process that gathers trends: float64, in order.

[tick, wall_s, quiet], and for each joint [q, theta, theta_dot, residual, friction, doubt], SI at
the link: theta NaN where no drive measures it; quiet 1 where nothing is felt; Coulomb friction
learned over that of the configuration, doubt what is left of its deviation.
"""

from typing import Final

TICK, WALL, QUIET = range(3)
HEAD: Final = 3
Q, THETA, THETA_DOT, RESIDUAL, FRICTION, DOUBT = range(6)
PER_JOINT: Final = 6


def row_length(n: int) -> int:
    """Numbers in a row of n joints."""
    return HEAD + PER_JOINT * n
