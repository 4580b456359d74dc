"""Smallest contacts that the arm detects now, at its joints and at its tool. Computed between two
ticks."""

import numpy as np

from common.arrays import Vector
from daemon.protocol.replies import Sensitivity, ToolForce
from daemon.tick.tick import Tick
from estimator.tool_force import ToolSense, tool_sense

FADING = 1.02
"""Ratio to its usual level above which a level in force counts as raised."""


def sensitivity_now(tick: Tick) -> Sensitivity | None:
    """Smallest contacts detected in the pose of the last estimate, with every joint at its velocity
    limit, and at rest; None before the first estimate. A joint that does not sense now detects
    none."""
    if tick.last is None or tick.last.estimate is None:
        return None
    estimator, estimate = tick.estimator, tick.last.estimate
    # Levels raised for missing samples decay; a smaller excess is noise of the velocity.
    usual = estimator.levels_at(tick.last.samples.motor_velocity)
    fading = np.where(estimate.threshold > FADING * usual, estimate.threshold - usual, 0.0)
    fastest = tick.controller.motion.limits.velocity
    sensing = tick.last.sensing
    moving, resting = (
        np.where(sensing, estimator.levels_at(speed) + fading, np.inf)
        for speed in (fastest, np.zeros_like(fastest))
    )
    jacobian = estimator.model.tool_jacobian(estimate.q)
    return Sensitivity(
        joints=list(tick.drives.names),
        tool=estimator.model.tool,
        moving=_levels(moving),
        resting=_levels(resting),
        tool_moving=_message(tool_sense(jacobian, moving)),
        tool_resting=_message(tool_sense(jacobian, resting)),
    )


def _levels(levels: Vector) -> list[float | None]:
    """Levels (n,) [Nm], None where they are infinite: JSON has no infinity."""
    return [level if level < np.inf else None for level in levels.tolist()]


def _message(sense: ToolSense) -> ToolForce:
    return ToolForce(
        least_N=sense.least,
        least_along=sense.least_along.tolist(),
        most_N=sense.most,
        most_along=sense.most_along.tolist(),
        undetected=sense.undetected.tolist(),
    )
