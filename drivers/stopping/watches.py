"""Stop watches of all drives of one arm, with the motion history from their samples."""

import math
from collections.abc import Sequence
from typing import Any, Final

from common.arrays import Vector
from drivers.api import PowerTarget, Samples
from drivers.drive import Drive
from drivers.stopping.stop_watch import StopBounds, StopReading, StopWatch
from drivers.stopping.travel import least_master_timeout_s, stage_ticks, worst_travel

REPEATS: Final = "all of its samples repeat while its motor moves, or was commanded to"


class Watches:
    """One watch for each drive, in the order of the joints."""

    def __init__(
        self, drives: Sequence[Drive[Any]], period_s: float, *, falls: bool = False
    ) -> None:
        """falls: the joints fall when their power is cut."""
        ticks = stage_ticks(least_master_timeout_s(drives), period_s)
        # From the first stop command on: the fault has been detected by then.
        travels = worst_travel(drives, period_s, detection_s=0.0)
        self.each = [
            StopWatch(
                StopBounds(
                    deceleration=drive.quick_stop,
                    current=drive.wiring.max_current_A,
                    travel=travel.total,
                    play=drive.play,
                    master_timeout_s=drive.profile.master_timeout_s,
                    ticks=ticks,
                    period_s=period_s,
                    falls=falls,
                )
            )
            for drive, travel in zip(drives, travels, strict=True)
        ]
        self.repeat = [False] * len(drives)
        """True for drives whose samples all repeat."""
        self._no_motors = [math.nan] * len(drives)

    @property
    def unproved(self) -> list[int]:
        """Joints commanded to stop and not confirmed at standstill, or moving since."""
        return [i for i, watch in enumerate(self.each) if watch.unproved or watch.moves]

    def may_be_off(self, joint: int) -> bool:
        """True if a drive may lose its power: it stands, or its quick stop was observed to fail. A
        moving drive is ramped down first."""
        watch = self.each[joint]
        return watch.proved or watch.cut

    def follow(
        self, now: float, samples: Samples, targets: Sequence[PowerTarget], velocity: Vector
    ) -> list[int]:
        """Record the motion and the commanded `velocity` (n,) [rad/s] of each drive, in every tick,
        whether or not it is to stop. Returns the joints whose samples begin to repeat."""
        motors = samples.motor_position
        columns = zip(
            self.each,
            samples.arrived.tolist(),
            samples.motor_velocity.tolist(),
            samples.current.tolist(),
            samples.link_position.tolist(),
            self._no_motors if motors is None else motors.tolist(),
            targets,
            velocity.tolist(),
            strict=True,
        )
        repeat = []
        for watch, fresh, speed, current, link, motor, target, wanted in columns:
            witness = watch.witness
            if fresh:
                witness.take(now, speed, current, link, motor)
            repeat.append(witness.repeats)
            if target is PowerTarget.ON:
                witness.command(now, wanted)
        if repeat == self.repeat:
            return []
        before, self.repeat = self.repeat, repeat
        return [i for i, is_so in enumerate(repeat) if is_so and not before[i]]

    def take_over(self, before: "Watches") -> None:
        """Take over the motion history of the drives until now."""
        self.repeat = before.repeat
        for watch, old in zip(self.each, before.each, strict=True):
            watch.witness = old.witness


def stop_reading(samples: Samples, joint: int) -> StopReading:
    """Reading of one drive from the samples of the arm."""
    motors = samples.motor_position
    return StopReading(
        samples.drives[joint].condition,
        float(samples.motor_velocity[joint]),
        float(samples.current[joint]),
        float(samples.link_position[joint]),
        math.nan if motors is None else float(motors[joint]),
    )
