"""Gap of one joint of a live arm without a hand: to a pose where gravity changes side, and
strokes of its motor there.

Bounded: the motor turns at 30 mrad/s at most, its joint stays within its limits, what will move is
announced first, and a contact of any joint ends it.
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

_EDGE = 0.02  # [rad] of the limits that no stroke enters
_FAR = 0.2  # [rad]
_LITTLE = 0.02  # of a joint's friction, which holds a link against so little gravity
_MUCH = 0.5  # of the same
_THERE = 0.005  # [rad]


class UnobservableError(ContactdError):
    """Joint whose gap does not show without a hand."""


@dataclass(frozen=True, slots=True)
class StrokesOfJoint:
    """Search for the gap of joint `i`, as paths of the whole arm."""

    c: Configuration
    model: Model
    i: int
    here: Vector
    """Link positions (n,) [rad] at the beginning"""
    pose: Vector
    """and where gravity changes side at the joint"""

    @classmethod
    def of(cls, c: Configuration, model: Model, i: int, here: Vector) -> Self:
        """Search for joint i of an arm that stands at `here`. Raises UnobservableError where
        gravity keeps its side at the joint in every pose that the limits allow."""
        joint, bounds = c.joints[i], bounds_of(c)
        rub = joint.friction.motor_coulomb + joint.friction.link_coulomb
        pose = None
        # Rather well within the limits: masses differ, and so does where gravity changes side.
        for edge in (_FAR, _EDGE + joint.half_gap + 0.02):
            lower, upper = bounds.lower + edge, bounds.upper - edge
            pose = balanced_pose(model, i, here, lower, upper, _LITTLE * rub)
            if pose is not None:
                break
        if pose is None:
            raise UnobservableError(
                f"gravity holds {joint.name} at one border of its gap in every pose within its "
                f"limits: `contactd identify gap {joint.name} --by-hand`"
            )
        return cls(c, model, i, here, pose)

    @property
    def weighs(self) -> bool:
        """True where gravity holds the joint at one border of its gap, as the arm stands."""
        joint = self.c.joints[self.i]
        rub = joint.friction.motor_coulomb + joint.friction.link_coulomb
        return abs(float(self.model.gravity(self.here)[self.i])) > _MUCH * rub

    def way_to_pose(self) -> Matrix:
        """Path (N, n) from here to where gravity changes side."""
        return point_to_point(self.here, self.pose, slow(bounds_of(self.c)), self.c.period_s)

    @property
    def room(self) -> tuple[float, float]:
        """Link positions [rad] between which the joint stays."""
        limits = self.c.joints[self.i].limits
        return limits.lower + _EDGE, limits.upper - _EDGE

    def begin(self) -> Search:
        """The search, which asks for strokes and is sent their logs."""
        joint = self.c.joints[self.i]
        return search(
            self.i, joint.torque_constant, joint.wiring.gear, joint.half_gap,
            lambda pose: float(self.model.gravity(pose)[self.i]),
            float(self.pose[self.i]), self.room, self.c.period_s,
        )  # fmt: skip

    def announcement(self) -> str:
        """Announcement of the motions, and their ranges."""
        ways = [
            f"{name} from {a:z.2f} to {b:z.2f} rad"
            for name, a, b in zip(self.c.joint_names, self.here, self.pose, strict=True)
            if abs(b - a) > _THERE
        ]
        go = f"The arm goes slowly: {', '.join(ways)}. " if ways else ""
        name = self.c.joint_names[self.i]
        low, high = self.room
        return (f"{go}Then {name} moves to and fro by itself, at most 30 mrad/s, within "
                f"{low:z.2f} and {high:z.2f} rad. Hands off: a touch ends it.")  # fmt: skip

    def way_to(self, here: Vector, asked: Strokes) -> Matrix | None:
        """Path (N, n) from here to the pose of the strokes; None where the arm is there."""
        pose = self.pose.copy()
        pose[self.i] = asked.about
        if float(np.abs(pose - here).max()) < _THERE:
            return None
        return point_to_point(here, pose, slow(bounds_of(self.c)), self.c.period_s)

    def path(self, here: Vector, asked: Strokes) -> Matrix:
        """Path (N, n) of the strokes, for the motors alone."""
        return strokes(here, self.i, asked.way, asked.speed, asked.count, self.c.period_s)


def searched(search: Search, record: Callable[[Strokes], MotionLog]) -> None:
    """Run a search to its end: `record` makes the strokes."""
    asked = next(search)
    while True:
        try:
            asked = search.send(record(asked))
        except StopIteration:
            return
