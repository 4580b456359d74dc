"""Delays of a configuration: times in which a touch or a failure is not detected yet."""

from collections.abc import Iterator

from daemon.config.problem import Problem
from daemon.config.schema import Configuration
from daemon.faults.detector import patience_deaf
from estimator.estimate import SENSED_PERIODS

LONGEST_TIMEOUT_MS = 500
"""Longest time that a drive may continue when its master is silent."""
LATEST_S = 0.15
"""Time within which a steady torque of twice its level must be detected [s]."""


def delays(c: Configuration) -> Iterator[Problem]:
    """Warnings about long delays. Not refused: such an arm still holds."""
    stale_s = c.supervisor.stale_ticks * c.period_s
    if stale_s > LATEST_S:
        yield Problem(
            ["supervisor", "stale_ticks"],
            "supervisor.stale_ticks",
            f"{c.supervisor.stale_ticks} ticks: a drive that sends nothing is found after "
            f"{stale_s:.3g} s, more than {LATEST_S:g} s, in which it is unknown where its joint "
            "goes",
        )
    for name, profile in c.drives.items():
        if profile.master_timeout_ms > LONGEST_TIMEOUT_MS:
            yield Problem(
                ["drives", name, "master_timeout_ms"],
                f"drives.{name}.master_timeout_ms",
                f"{profile.master_timeout_ms} ms: for so long its joints go on, at up to "
                f"limits.velocity, when the daemon has died; usual is 100, up to "
                f"{LONGEST_TIMEOUT_MS} no warning is given",
            )
    seconds = (SENSED_PERIODS + patience_deaf(c.period_s)) * c.period_s
    if seconds > LATEST_S:
        yield Problem(
            ["period_ms"],
            "period_ms",
            f"{c.period_ms} ms: where samples go missing, the arm stops or holds only after "
            f"{seconds:.2g} s in which a touch may go undetected; up to 40 ms it takes at most "
            f"{LATEST_S:g} s",
        )
