"""Stops of motors: a supervised ramp of setpoints to 0; power is cut only from a runaway.

These motors have no stop function of their own, and go limp without frames. So in the stronger
stages of `StopWatch`, even silence, setpoints are still sent: an unheard motor may still receive.
Only a motor observed beyond its travel loses its power.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from common.arrays import Vector
from drivers.api import Event, Kind, PowerTarget, Samples
from drivers.motors.language import MotorDrives
from drivers.stopping.stop_watch import OBEYING, Stage, StopReading
from drivers.stopping.watches import REPEATS, Watches, stop_reading

_ON: Final = PowerTarget.ON
_STRONGER: Final = {Stage.LAST: Kind.NOT_SEEN_TO_STOP, Stage.SILENCE: Kind.UNPROVED}


class Stops:
    """Stops of one arm; call `step` once per tick, before its setpoints are sent."""

    def __init__(self, drives: MotorDrives, period_s: float) -> None:
        self._names = tuple(drive.name for drive in drives)
        self._fastest = [drive.velocity for drive in drives]
        self._braking = [drive.quick_stop * period_s for drive in drives]  # per tick [rad/s]
        self.watches = Watches(drives, period_s, falls=True)

    def setpoints(
        self, targets: Sequence[PowerTarget], wanted: Sequence[float], last: Sequence[float]
    ) -> list[float]:
        """Target velocities (n,) [rad/s] of this tick: `wanted` for motors that may run; for the
        others `last`, reduced along their ramps."""
        return [
            want if target is _ON else math.copysign(max(abs(before) - braking, 0.0), before)
            for target, want, before, braking in zip(
                targets, wanted, last, self._braking, strict=True
            )
        ]

    def step(
        self,
        now: float,
        targets: Sequence[PowerTarget],
        samples: Samples,
        velocity: Vector,
        released: Sequence[bool],
    ) -> list[Event]:
        """Supervise every motor commanded to stop. velocity: (n,) wanted [rad/s]; released: motors
        without power by our command."""
        begun = self.watches.follow(now, samples, targets, velocity)
        found: dict[tuple[Kind, str], list[int]] = {(Kind.REPEATED_SAMPLES, REPEATS): begun}
        for i, (watch, target) in enumerate(zip(self.watches.each, targets, strict=True)):
            if target is _ON:
                watch.allow()
                continue
            if watch.stage is Stage.NONE:
                speed = float(samples.motor_velocity[i])
                known = self._fastest[i] if math.isnan(speed) else speed
                watch.begin(now, Stage.SETPOINT, known)
            cut = watch.cut
            stage = watch.step(now, self._seen(i, samples, released[i]))
            if stage in _STRONGER:
                found.setdefault((_STRONGER[stage], "its setpoints continue"), []).append(i)
            if watch.cut and not cut:
                beyond = "it keeps moving beyond its travel: power cut"
                found.setdefault((Kind.NOT_SEEN_TO_STOP, beyond), []).append(i)
        return [
            Event(kind, f"{', '.join(self._names[i] for i in joints)}: {text}")
            for (kind, text), joints in found.items()
            if joints
        ]

    def _seen(self, joint: int, samples: Samples, released: bool) -> StopReading | None:
        if not samples.arrived[joint]:
            return None
        if self.watches.repeat[joint]:
            condition = samples.drives[joint].condition
            return StopReading(condition, math.nan) if condition in OBEYING else None
        seen = stop_reading(samples, joint)
        # A limp motor is moved by a hand or the load: the torque that it reports then is noise.
        limp = released and not seen.condition.powered
        return replace(seen, current=math.nan) if limp else seen
