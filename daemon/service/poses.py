"""Poses for the `go` command: given as joint positions, or by their names in the configuration."""

from dataclasses import dataclass, field

import numpy as np

from common.arrays import Vector
from common.errors import TrajectoryError
from daemon.config.load import Robot
from daemon.config.vectors import limits_of
from daemon.motion.limits import Limits
from daemon.motion.pose_path import PosePath, run_time_s
from daemon.protocol.replies import PlannedPath
from daemon.protocol.requests import Go
from daemon.tick.refusals import START_TOLERANCE

# Default speed of the joint that goes furthest [rad/s].
USUAL_SPEED = 0.2
WARNED_RAD = 1e-3  # shortfall of a joint above which a warning is given


@dataclass(slots=True)
class Poses:
    """Poses of one arm."""

    robot: Robot
    joints: list[str] = field(init=False)
    named: dict[str, dict[str, float]] = field(init=False)
    """Joint positions by name of the pose [rad]; other joints stay"""
    _limits: Limits = field(init=False)
    _ramp_s: float = field(init=False)

    def __post_init__(self) -> None:
        c = self.robot.configuration
        self.joints, self.named = c.joint_names, c.poses
        self._limits, self._ramp_s = limits_of(c), c.trajectory.ramp_s

    def path(self, request: Go, q: Vector) -> PosePath:
        """Path from q (n,) [rad] to the pose of a request. Raises TrajectoryError for an unknown
        pose, or if the arm is elsewhere than where the request was planned."""
        name, values = self._requested(request)
        goal = q.copy()
        for joint, value in values.items():
            if joint not in self.joints:
                raise TrajectoryError(f"no joint {joint!r}; there are: {', '.join(self.joints)}")
            i = self.joints.index(joint)
            lower, upper = self._limits.lower[i], self._limits.upper[i]
            if not lower <= value <= upper:
                raise TrajectoryError(
                    f"{joint}={value:g} is outside its limits [{lower:g}, {upper:g}] rad"
                )
            goal[i] = value
        # A joint that is to stay, but is slightly outside, is moved back, as while holding.
        goal = np.clip(goal, self._limits.lower, self._limits.upper)
        self._refuse_elsewhere(request, q)
        speed = request.speed or USUAL_SPEED
        return PosePath.planned(
            f"the way to {name}", q.copy(), goal, speed, self._limits, self._ramp_s
        )

    def planned_path(self, path: PosePath) -> PlannedPath:
        """Description of the path, for a person to check before the arm moves."""
        return PlannedPath(
            name=path.name,
            joints=self.joints,
            start=path.start.tolist(),
            goal=path.goal.tolist(),
            speed=path.fastest(0.0).tolist(),
            duration_s=run_time_s(path.duration, self._ramp_s),
            shapes=self.robot.walls is not None,
        )

    def short_of(self, path: PosePath) -> list[str]:
        """Warnings for joints that the path moves nearer to a limit than the width of their gap:
        they stop short, unless the link has fallen to that side of the gap already."""
        goal, limits = path.goal, self._limits
        gaps = np.array([2.0 * joint.half_gap for joint in self.robot.configuration.joints])
        short = gaps - np.minimum(goal - limits.lower, limits.upper - goal)
        return [
            f"{joint} may stop up to {short[i]:.3f} rad short of {goal[i]:.3f}: nearer to its "
            f"limit its link could fall beyond, through its gap"
            for i, joint in enumerate(self.joints)
            if path.displacement[i] and short[i] > WARNED_RAD
        ]

    def _requested(self, request: Go) -> tuple[str, dict[str, float]]:
        if (request.pose is None) == (not request.targets):
            raise TrajectoryError("it takes either a `pose` or `targets`")
        if request.pose is None:
            values = request.targets or {}
            named = " ".join(f"{joint}={value:.4g}" for joint, value in values.items())
            return named if len(values) < 3 else f"a pose of {len(values)} joints", values
        if request.pose in self.joints and request.pose not in self.named:
            raise TrajectoryError(
                f"{request.pose} is a joint: JOINT=VALUE is expected, with its position in rad, "
                f"such as {request.pose}={self._inside(request.pose):g}"
            )
        if request.pose not in self.named:
            known = f"there are: {', '.join(self.named)}" if self.named else "there is none"
            raise TrajectoryError(
                f"no pose {request.pose!r} under `poses` in config.yaml as last read; {known}"
            )
        return request.pose, self.named[request.pose]

    def _inside(self, joint: str) -> float:
        """Position within a joint's limits [rad], for an example."""
        i = self.joints.index(joint)
        return round(0.5 * float(self._limits.lower[i] + self._limits.upper[i]), 1)

    def _refuse_elsewhere(self, request: Go, q: Vector) -> None:
        planned = request.planned_from
        if planned is None:
            return
        if len(planned) != len(q):
            raise TrajectoryError(f"`planned_from` has {len(planned)} joints instead of {len(q)}")
        if not (np.abs(q - planned) <= START_TOLERANCE).all():
            raise TrajectoryError("the arm has moved since this was planned: ask again")
