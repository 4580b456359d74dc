"""Detection delays of a configuration: times in which a contact or a failure goes undetected."""

from collections.abc import Iterator

from daemon.config.problem import Problem
from daemon.config.schema import Configuration
from daemon.faults.detector import tolerated_ticks
from estimator.estimate import SENSED_PERIODS

LONGEST_TIMEOUT_MS = 500
"""Longest master timeout of a drive that gives no warning [ms]."""
LATEST_S = 0.15
"""Longest permitted time to detect a constant torque of twice the contact level [s]."""


def delays(c: Configuration) -> Iterator[Problem]:
    """Warnings about long detection delays. They are not errors: such an arm still stops, later."""
    stale_s = c.supervisor.stale_ticks * c.period_s
    if stale_s > LATEST_S:
        yield Problem(
            ["supervisor", "stale_ticks"],
            "supervisor.stale_ticks",
            f"{c.supervisor.stale_ticks} ticks: a silent drive is detected only after "
            f"{stale_s:.3g} s, more than {LATEST_S:g} s, during which the position of its joint "
            "is unknown",
        )
    for name, profile in c.drives.items():
        if profile.master_timeout_ms > LONGEST_TIMEOUT_MS:
            yield Problem(
                ["drives", name, "master_timeout_ms"],
                f"drives.{name}.master_timeout_ms",
                f"{profile.master_timeout_ms} ms: if the daemon dies, its joints keep moving for "
                "this long, at up to limits.velocity; 100 is usual, and up to "
                f"{LONGEST_TIMEOUT_MS} gives no warning",
            )
    seconds = (SENSED_PERIODS + tolerated_ticks(c.period_s)) * c.period_s
    if seconds > LATEST_S:
        yield Problem(
            ["period_ms"],
            "period_ms",
            f"{c.period_ms} ms: if samples are lost, the arm stops or holds only after "
            f"{seconds:.2g} s, in which a contact may go undetected; with 40 ms or less it takes "
            f"at most {LATEST_S:g} s",
        )
