"""Numbers that are none, sensors that lie, and a person stronger than the arm."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import repeat
from typing import Any, cast

import numpy as np

from bench.rigs.breakable_arm import BreakableArm, for_ever, throughout
from daemon.motion.path import Follower, Reference
from drivers.stopping.witness import STANDS
from simulator.sensors import Readings


def not_a_number(on: BreakableArm) -> Iterator[None]:
    on.rig.tick.estimator._kernel.residual.values[0, on.joint] = np.nan
    yield


class _Infinite:
    """A follower whose reference is beyond all bounds."""

    def __init__(self, follower: Follower) -> None:
        self._follower = follower

    def __getattr__(self, name: str) -> Any:
        return getattr(self._follower, name)

    def step(self, dt: float) -> Reference:
        """A step that is not finite, in place of `Follower.step`."""
        reference = self._follower.step(dt)
        return replace(reference, q=np.full_like(reference.q, np.inf))


def infinite_reference(on: BreakableArm) -> Iterator[None]:
    motion = on.rig.tick.controller.motion
    follower = motion.follower
    motion.follower = cast(Follower, _Infinite(follower))
    try:
        yield from repeat(None, 3)
    finally:
        motion.follower = follower


def _counts(on: BreakableArm, rad: float) -> int:
    return round(rad / on.make.speech.link_scale(on.drive))


def _at(values: list[int], joint: int, value: int) -> list[int]:
    return [*values[:joint], value, *values[joint + 1 :]]


def encoder_jump(on: BreakableArm) -> Iterator[None]:
    jump, joint = _counts(on, 0.2), on.joint

    def jumped(r: Readings) -> Readings:
        return replace(r, link_position=_at(r.link_position, joint, r.link_position[joint] + jump))

    with on.sensing(jumped):
        yield from for_ever()


def encoder_frozen(on: BreakableArm) -> Iterator[None]:
    held: list[int] = []
    joint = on.joint

    def frozen(r: Readings) -> Readings:
        held[:] = held or [r.link_position[joint]]
        return replace(r, link_position=_at(r.link_position, joint, held[0]))

    with on.sensing(frozen):
        yield from for_ever()


def all_frozen(on: BreakableArm) -> Iterator[None]:
    """Nothing that the drive measures changes any more; its statusword does."""
    held: list[Readings] = []

    def frozen(r: Readings) -> Readings:
        held[:] = held or [r]
        joint, names = on_joint, Readings.__dataclass_fields__
        return replace(
            r,
            **{name: _at(getattr(r, name), joint, getattr(held[0], name)[joint]) for name in names},
        )

    on_joint = on.joint
    with on.sensing(frozen):
        yield from for_ever()


def encoders_dark(on: BreakableArm) -> Iterator[None]:
    """Supply of one drive's encoders gone: positions stay, and of the velocity, which the drive
    filters, a share is left a tick later."""
    joint = on.joint
    held: list[Readings] = []
    left = 1.0

    def dark(r: Readings) -> Readings:
        nonlocal left
        held[:] = held or [r]
        left *= 0.3
        velocity = round(left * held[0].motor_velocity[joint])
        return replace(
            r,
            link_position=_at(r.link_position, joint, held[0].link_position[joint]),
            motor_position=_at(r.motor_position, joint, held[0].motor_position[joint]),
            motor_velocity=_at(r.motor_velocity, joint, velocity),
        )

    with on.sensing(dark):
        yield from for_ever()


def gear_slips(on: BreakableArm) -> Iterator[None]:
    """It slips while its motor turns."""
    slipped, joint, per_rad = 0.0, on.joint, _counts(on, 1.0)

    def slipping(r: Readings) -> Readings:
        where = r.link_position[joint] + round(slipped * per_rad)
        return replace(r, link_position=_at(r.link_position, joint, where))

    with on.sensing(slipping):
        while True:
            turns = abs(on.rig.arm.plant.theta_dot[joint]) > STANDS
            slipped += 0.008 * turns  # a tick
            yield


def torque_stuck(on: BreakableArm) -> Iterator[None]:
    held: list[int] = []

    def stuck(r: Readings) -> Readings:
        held[:] = held or [r.current[on.make.stuck]]
        return replace(r, current=_at(r.current, on.make.stuck, held[0]))

    with on.sensing(stuck):
        yield from for_ever()


def torque_saturated(on: BreakableArm) -> Iterator[None]:
    wiring = on.drives[on.make.saturated].wiring
    full = round(1000 * wiring.max_current_A / wiring.rated_current_A)

    def saturated(r: Readings) -> Readings:
        return replace(r, current=_at(r.current, on.make.saturated, full))

    with on.sensing(saturated):
        yield from repeat(None, 25)


@contextmanager
def _pushed(on: BreakableArm, joint: int, torque: float) -> Iterator[None]:
    """A hand pushes a joint inside the block [Nm]."""
    on.rig.arm.external_torque[joint] = torque
    try:
        yield
    finally:
        on.rig.arm.external_torque[joint] = 0.0


hit_hard = throughout(lambda on: _pushed(on, on.joint, on.make.hit_Nm), 15)
pushed_beyond_a_limit = throughout(lambda on: _pushed(on, on.make.pushed, on.make.push_Nm), 100)
