"""Setpoints of motors: an impedance about a position p that follows the target velocity v.

    torque = stiffness (p - q) + damping (v - q_dot),  p += v T

In the motor this acts as a PI velocity loop with physical gains, whose joint stays near p when
setpoints cease. For an unpowered motor p is its position, so that it holds there once enabled; for
a motor found holding, p follows from its torque. The distance of p from the motor is limited to the
torque of its current limit; if the motor is forced further, p follows it no faster than the joint
may move, so that a wrong position has little effect.
"""

import math
from collections.abc import Iterable
from typing import Final

from drivers.can.wire import Frame
from drivers.motors.language import Language, MotorDrives

#: Largest distance of a motor from its p at which it may be enabled [rad].
AT: Final = 1e-3


class Setpoints:
    """Setpoints of an arm, packed into preallocated frames."""

    def __init__(self, drives: MotorDrives, language: Language, period_s: float) -> None:
        self._language, self._period_s = language, period_s
        self._signs = [float(drive.wiring.motor_sign) for drive in drives]
        self._rad_per_A = [d.profile.Nm_per_A / d.profile.stiffness for d in drives]
        self._max_current_A = [d.wiring.max_current_A for d in drives]
        self._max_follow = [d.velocity * period_s for d in drives]
        self.positions: list[float] = [math.nan] * len(drives)
        """Position p of each motor [rad at the link]; NaN while unknown."""

    def write(
        self, joint: int, velocity: float, measured: float, current: float, *, powered: bool
    ) -> bool:
        """Advance p of a joint by its target velocity [rad/s], bounded about its motor position
        `measured` [rad], or set it there if the motor is unpowered; an unknown p is initialised
        from position and `current` [A]. False if both positions are unknown: there is no setpoint
        then."""
        before, heard = self.positions[joint], math.isfinite(measured)
        if self.known(joint):
            p = before + velocity * self._period_s if powered or not heard else measured
            if heard:
                p = measured + self._bounded(joint, p - measured)
            most = max(abs(velocity) * self._period_s, self._max_follow[joint])
            self.positions[joint] = min(max(p, before - most), before + most)
        elif heard:
            held = current * self._rad_per_A[joint] if powered and math.isfinite(current) else 0.0
            self.positions[joint] = measured + self._bounded(joint, held)
        if known := self.known(joint):
            self._pack(joint, velocity)
        return known

    def _bounded(self, joint: int, beyond: float) -> float:
        """Distance from the motor to its p, bounded by the current limit [rad]."""
        reach: float = self._max_current_A[joint] * self._rad_per_A[joint]
        return min(max(beyond, -reach), reach)

    def adopt(self, joint: int, position: float) -> None:
        """Adopt p of a setpoint sent by the guardian [rad, in the motor's direction]: the motor is
        held there."""
        self.positions[joint] = self._signs[joint] * position

    def at(self, joint: int, measured: float) -> bool:
        """True if p is at the motor position, so that the motor may be enabled."""
        return abs(self.positions[joint] - measured) <= AT

    def known(self, joint: int) -> bool:
        """True if p is known."""
        return math.isfinite(self.positions[joint])

    def forget(self, joints: Iterable[int]) -> None:
        """Discard p of these joints: it is initialised anew from their motors."""
        for joint in joints:
            self.positions[joint] = math.nan

    def stop(self) -> list[Frame]:
        """Frames that hold each motor with a known p there."""
        known = [joint for joint in range(len(self.positions)) if self.known(joint)]
        for joint in known:
            self._pack(joint, 0.0)
        return [self._language.setpoints[joint] for joint in known]

    def _pack(self, joint: int, velocity: float) -> None:
        sign = self._signs[joint]
        self._language.pack(joint, sign * self.positions[joint], sign * velocity)
