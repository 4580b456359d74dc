"""Stops of motors: a ramp of setpoints to 0, watched; power is cut only where one runs on.

These motors have no stop of their own, and go limp when nothing is sent. So the stronger stages
of `StopWatch` go on holding, and silence is none: a motor that is not heard may still hear.
Only one that is seen to go on beyond its travel loses its power.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from common.arrays import Vector
from drivers.api import Event, Kind, PowerTarget, Samples
from drivers.motors.language import MotorDrives
from drivers.stopping.stop_watch import OBEYING, Seen, Stage
from drivers.stopping.watches import REPEATS, Watches, seen_in

_ON: Final = PowerTarget.ON
_STRONGER: Final = {Stage.LAST: Kind.NOT_SEEN_TO_STOP, Stage.SILENCE: Kind.UNPROVED}


class Stops:
    """Stops of one arm; `step` once per tick, before its setpoints go out."""

    def __init__(self, drives: MotorDrives, period_s: float) -> None:
        self._names = tuple(drive.name for drive in drives)
        self._fastest = [drive.velocity for drive in drives]
        self._braking = [drive.quick_stop * period_s for drive in drives]  # in a tick [rad/s]
        self.watches = Watches(drives, period_s, falls=True)

    def setpoints(
        self, targets: Sequence[PowerTarget], wanted: Sequence[float], last: Sequence[float]
    ) -> list[float]:
        """Target velocities (n,) [rad/s] of this tick: those `wanted` of motors that may run; of
        the others the `last`, brought down along their ramps."""
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
        let_go: Sequence[bool],
    ) -> list[Event]:
        """Judge every motor commanded to stop. velocity: (n,) wanted [rad/s]; let_go: those that
        have no power because we said so."""
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
            stage = watch.step(now, self._seen(i, samples, let_go[i]))
            if stage in _STRONGER:
                found.setdefault((_STRONGER[stage], "it goes on being commanded"), []).append(i)
            if watch.cut and not cut:
                beyond = "it goes on beyond its travel: power cut"
                found.setdefault((Kind.NOT_SEEN_TO_STOP, beyond), []).append(i)
        return [
            Event(kind, f"{', '.join(self._names[i] for i in joints)}: {text}")
            for (kind, text), joints in found.items()
            if joints
        ]

    def _seen(self, joint: int, samples: Samples, let_go: bool) -> Seen | None:
        if not samples.came[joint]:
            return None
        if self.watches.repeat[joint]:
            condition = samples.drives[joint].condition
            return Seen(condition, math.nan) if condition in OBEYING else None
        seen = seen_in(samples, joint)
        # A hand or the load moves a limp one: what it reports as torque then is noise.
        limp = let_go and not seen.condition.powered
        return replace(seen, current=math.nan) if limp else seen
