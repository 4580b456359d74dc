"""Gap measurement without a hand: strokes of one motor of a live arm, in a pose where gravity
changes sign at its joint.

The motor moves at 30 mrad/s at most, the joint stays within its limits, motions are announced
first, and a contact of any joint ends them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import ContactdError
from daemon.config.schema import Configuration
from estimator.model import Model
from identification.balance import balanced_pose
from identification.excitation import point_to_point
from identification.gap_search import Search, Strokes, search
from identification.motion_log import MotionLog
from programs.identify.motions import bounds_of, slow, strokes

_EDGE = 0.02  # margin of the strokes to the limits [rad]
_FAR = 0.2  # preferred margin of the pose to the limits [rad]
_LITTLE = 0.02  # gravity torque at the pose, over friction: the link stays where it is
_MUCH = 0.5  # gravity torque, over friction, that holds the link at one edge of its gap
_THERE = 0.005  # tolerance of reaching a pose [rad]


class UnobservableError(ContactdError):
    """Error of a joint whose gap cannot be observed without a hand."""


@dataclass(frozen=True, slots=True)
class StrokesOfJoint:
    """Search for the gap of joint `i`, as paths of the whole arm."""

    c: Configuration
    model: Model
    i: int
    here: Vector
    """Link positions (n,) [rad] at the start."""
    pose: Vector
    """Link positions (n,) [rad] at which gravity changes sign at the joint."""

    @classmethod
    def of(cls, c: Configuration, model: Model, i: int, here: Vector) -> Self:
        """Search for joint i of an arm that stands at `here`. Raises UnobservableError if gravity
        has the same sign at the joint in all poses within the limits."""
        joint, bounds = c.joints[i], bounds_of(c)
        rub = joint.friction.motor_coulomb + joint.friction.link_coulomb
        pose = None
        # Preferably well within the limits, as errors of the masses shift the sign change.
        for edge in (_FAR, _EDGE + joint.half_gap + 0.02):
            lower, upper = bounds.lower + edge, bounds.upper - edge
            pose = balanced_pose(model, i, here, lower, upper, _LITTLE * rub)
            if pose is not None:
                break
        if pose is None:
            raise UnobservableError(
                f"gravity holds {joint.name} at one edge of its gap in every pose within its "
                f"limits: use `contactd identify gap {joint.name} --by-hand`"
            )
        return cls(c, model, i, here, pose)

    @property
    def weighs(self) -> bool:
        """True if gravity holds the joint at one edge of its gap in the present pose."""
        joint = self.c.joints[self.i]
        rub = joint.friction.motor_coulomb + joint.friction.link_coulomb
        return abs(float(self.model.gravity(self.here)[self.i])) > _MUCH * rub

    def way_to_pose(self) -> Matrix:
        """Path (N, n) [rad] to the pose at which gravity changes sign."""
        return point_to_point(self.here, self.pose, slow(bounds_of(self.c)), self.c.period_s)

    @property
    def room(self) -> tuple[float, float]:
        """Range of link positions [rad] in which the joint stays."""
        limits = self.c.joints[self.i].limits
        return limits.lower + _EDGE, limits.upper - _EDGE

    def begin(self) -> Search:
        """Search generator, which yields strokes and is sent their logs."""
        joint = self.c.joints[self.i]
        return search(
            self.i, joint.torque_constant, joint.wiring.gear, joint.half_gap,
            lambda pose: float(self.model.gravity(pose)[self.i]),
            float(self.pose[self.i]), self.room, self.c.period_s,
        )  # fmt: skip

    def announcement(self) -> str:
        """Announcement of the motions, and their ranges."""
        moves = [
            f"{name} from {a:z.2f} to {b:z.2f} rad"
            for name, a, b in zip(self.c.joint_names, self.here, self.pose, strict=True)
            if abs(b - a) > _THERE
        ]
        go = f"The arm moves slowly: {', '.join(moves)}. " if moves else ""
        name = self.c.joint_names[self.i]
        low, high = self.room
        return (f"{go}Then {name} moves to and fro by itself, at most 30 mrad/s, within "
                f"{low:z.2f} and {high:z.2f} rad. Hands off: a touch ends it.")  # fmt: skip

    def way_to(self, here: Vector, asked: Strokes) -> Matrix | None:
        """Path (N, n) [rad] to the pose of the strokes; None if the arm is there."""
        pose = self.pose.copy()
        pose[self.i] = asked.about
        if float(np.abs(pose - here).max()) < _THERE:
            return None
        return point_to_point(here, pose, slow(bounds_of(self.c)), self.c.period_s)

    def path(self, here: Vector, asked: Strokes) -> Matrix:
        """Path (N, n) [rad] of the strokes, for the motors alone."""
        return strokes(here, self.i, asked.travel, asked.speed, asked.count, self.c.period_s)


def searched(search: Search, record: Callable[[Strokes], MotionLog]) -> None:
    """Run a search to its end; `record` executes and records the strokes."""
    asked = next(search)
    while True:
        try:
            asked = search.send(record(asked))
        except StopIteration:
            return
