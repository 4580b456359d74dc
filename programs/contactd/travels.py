"""Worst-case stopping travel of each joint after a fault, for `contactd check`."""

import math
from typing import Final

from daemon.config.schema import Configuration
from daemon.faults.following import LATENCY_TICKS, TICKS
from drivers.stopping.travel import Travel, worst_travel
from drivers.stopping.witness import FROZEN_READINGS

#: Ticks to add to rules that count samples: the fault begins with the first of them, which arrives
#: with the next SYNC.
SAMPLED_TICKS: Final = 2


def detection_ticks(c: Configuration) -> int:
    """Ticks until a drive that does not follow its setpoints is detected: those of the slowest
    rule, since only one of them may apply."""
    silence_s = max(profile.silence_s for profile in c.drives.values())
    lag_ticks = math.ceil(3.0 * c.control.drive_lag_ms / c.period_ms)
    return max(
        c.supervisor.stale_ticks,
        FROZEN_READINGS + SAMPLED_TICKS,  # readings are frozen
        math.ceil(round(silence_s / c.period_s, 6)) + 1,
        TICKS + LATENCY_TICKS + lag_ticks + SAMPLED_TICKS,  # velocity does not follow the setpoint
    )


def travels(c: Configuration) -> list[Travel]:
    """Worst-case travel of each joint."""
    detection_s = detection_ticks(c) * c.period_s
    return worst_travel(
        c.joint_drives, c.period_s, detection_s, speed_margin=c.supervisor.speed_margin
    )
