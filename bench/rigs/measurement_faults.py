"""Numbers that are none, sensors that lie, and somebody stronger than the arm."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np

from bench.rigs.breakable_arm import ELBOW, PITCH, YAW, BreakableArm, for_ever
from daemon.motion.path import Follower, Reference
from simulator.sensors import Readings


def not_a_number(on: BreakableArm) -> Iterator[None]:
    on.rig.tick.estimator.residual.values[0][ELBOW] = np.nan
    yield


class _Infinite:
    """A follower whose reference is beyond all bounds."""

    def __init__(self, follower: Follower) -> None:
        self._follower = follower

    def __getattr__(self, name: str) -> Any:
        return getattr(self._follower, name)

    def step(self, dt: float) -> Reference:
        """As Follower.step."""
        return replace(self._follower.step(dt), q=np.full(7, np.inf))


def infinite_reference(on: BreakableArm) -> Iterator[None]:
    motion = on.rig.tick.controller.motion
    follower = motion.follower
    motion.follower = cast(Follower, _Infinite(follower))
    try:
        for _ in range(3):
            yield
    finally:
        motion.follower = follower


def _counts(on: BreakableArm, rad: float) -> int:
    profile = on.rig.robot.configuration.drives["two_encoder_drive"]
    return round(rad / profile.link_position.scale)


def _at(values: list[int], joint: int, value: int) -> list[int]:
    return [*values[:joint], value, *values[joint + 1 :]]


def encoder_jump(on: BreakableArm) -> Iterator[None]:
    jump = _counts(on, 0.2)

    def jumped(r: Readings) -> Readings:
        return replace(r, link_position=_at(r.link_position, ELBOW, r.link_position[ELBOW] + jump))

    with on.sensing(jumped):
        yield from for_ever()


def encoder_frozen(on: BreakableArm) -> Iterator[None]:
    held: list[int] = []

    def frozen(r: Readings) -> Readings:
        held[:] = held or [r.link_position[ELBOW]]
        return replace(r, link_position=_at(r.link_position, ELBOW, held[0]))

    with on.sensing(frozen):
        yield from for_ever()


def gear_slips(on: BreakableArm) -> Iterator[None]:
    slipped = 0.0

    def slipping(r: Readings) -> Readings:
        where = r.link_position[ELBOW] + _counts(on, slipped)
        return replace(r, link_position=_at(r.link_position, ELBOW, where))

    with on.sensing(slipping):
        while True:
            slipped += 0.008  # a tick
            yield


def torque_stuck(on: BreakableArm) -> Iterator[None]:
    held: list[int] = []

    def stuck(r: Readings) -> Readings:
        held[:] = held or [r.current[0]]
        return replace(r, current=_at(r.current, 0, held[0]))

    with on.sensing(stuck):
        yield from for_ever()


def torque_saturated(on: BreakableArm) -> Iterator[None]:
    joint = on.rig.robot.configuration.joints[PITCH].wiring
    full = round(1000 * joint.max_current_A / joint.rated_current_A)

    def saturated(r: Readings) -> Readings:
        return replace(r, current=_at(r.current, PITCH, full))

    with on.sensing(saturated):
        for _ in range(25):
            yield


def hit_hard(on: BreakableArm) -> Iterator[None]:
    on.rig.arm.external_torque[ELBOW] = 9.0
    try:
        for _ in range(15):
            yield
    finally:
        on.rig.arm.external_torque[ELBOW] = 0.0


def pushed_beyond_a_limit(on: BreakableArm) -> Iterator[None]:
    on.rig.arm.external_torque[YAW] = 1.4
    try:
        for _ in range(100):
            yield
    finally:
        on.rig.arm.external_torque[YAW] = 0.0
