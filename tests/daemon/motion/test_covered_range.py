"""Warnings about a way that leads further than the thresholds have seen."""

import numpy as np
import pytest

from daemon.motion.covered_range import CoveredRange
from daemon.motion.path import PathPoint
from daemon.motion.pose_path import PosePath


@pytest.mark.parametrize(
    ("start", "goal", "said"),
    [
        (0.28, 0.5, "[0.28, 0.50]"),
        (0.5, 0.0, "[0.00, 0.50]"),
        (-0.3, 0.05, "[-0.30, 0.05]"),
        (0.05, -0.05, None),
    ],
)
def test_the_way_begins_where_the_arm_stands(start: float, goal: float, said: str | None) -> None:
    seen = CoveredRange(np.array([1.0]), np.array([-0.12]), np.array([0.12]))
    q = np.array([start])
    path = PosePath("pose", q, np.array([goal]), np.array([0.2]))
    expected = f"elbow moves within {said} rad; its thresholds cover [-0.12, 0.12]"
    assert seen.beyond(["elbow"], q, PathPoint(path)) == ([expected] if said else [])
