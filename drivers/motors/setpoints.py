"""Setpoints of motors: an impedance about a position that follows the target velocity.

    torque = stiffness (p - q) + damping (v - q_dot),  p += v T

In the motor this is a velocity loop with an integral, whose gains have units, and whose joint ends
next to p where setpoints cease. A motor without power has p where it is, so that it holds there
when it is enabled; one that is found holding has it where its torque says. p goes no further from
the motor than the torque that its current limit allows, and follows a motor that is forced further
no faster than the joint may move: a false position moves it little.
"""

import math
from collections.abc import Iterable
from typing import Final

from drivers.can.wire import Frame
from drivers.motors.language import Language, MotorDrives

#: What a motor that is enabled may be away from its p [rad].
AT: Final = 1e-3


class Setpoints:
    """Setpoints of an arm, written into frames that stay."""

    def __init__(self, drives: MotorDrives, language: Language, period_s: float) -> None:
        self._language, self._period_s = language, period_s
        self._signs = [float(drive.wiring.motor_sign) for drive in drives]
        self._rad_per_A = [d.profile.Nm_per_A / d.profile.stiffness for d in drives]
        self._most_A = [d.wiring.max_current_A for d in drives]
        self._follows = [d.velocity * period_s for d in drives]
        self.positions: list[float] = [math.nan] * len(drives)
        """Position p of each motor [rad at the link]; NaN where it is not known yet."""

    def write(
        self, joint: int, velocity: float, measured: float, current: float, *, powered: bool
    ) -> bool:
        """Move p of a joint on with its target velocity [rad/s], about its motor, `measured` [rad]
        with this `current` [A]; take it to the motor where that has no power. False where neither
        was ever known: there is no setpoint then."""
        before, heard = self.positions[joint], math.isfinite(measured)
        if self.known(joint):
            p = before + velocity * self._period_s if powered or not heard else measured
            if heard:
                p = measured + self._bounded(joint, p - measured)
            most = max(abs(velocity) * self._period_s, self._follows[joint])
            self.positions[joint] = min(max(p, before - most), before + most)
        elif heard:
            held = current * self._rad_per_A[joint] if powered and math.isfinite(current) else 0.0
            self.positions[joint] = measured + self._bounded(joint, held)
        if known := self.known(joint):
            self._pack(joint, velocity)
        return known

    def _bounded(self, joint: int, beyond: float) -> float:
        """Way from the motor to its p, within what the current limit allows [rad]."""
        reach: float = self._most_A[joint] * self._rad_per_A[joint]
        return min(max(beyond, -reach), reach)

    def adopt(self, joint: int, position: float) -> None:
        """Take the p of a setpoint that the guardian sent [rad, as the motor counts]: the motor is
        held there."""
        self.positions[joint] = self._signs[joint] * position

    def at(self, joint: int, measured: float) -> bool:
        """True where p is at its motor, so that it may be enabled."""
        return abs(self.positions[joint] - measured) <= AT

    def known(self, joint: int) -> bool:
        """True where p is known."""
        return math.isfinite(self.positions[joint])

    def forget(self, joints: Iterable[int]) -> None:
        """Know no p of these joints: their motors are taken where they are found."""
        for joint in joints:
            self.positions[joint] = math.nan

    def stop(self) -> list[Frame]:
        """Frames that hold every motor at its p, of those where it is known."""
        known = [joint for joint in range(len(self.positions)) if self.known(joint)]
        for joint in known:
            self._pack(joint, 0.0)
        return [self._language.setpoints[joint] for joint in known]

    def _pack(self, joint: int, velocity: float) -> None:
        sign = self._signs[joint]
        self._language.pack(joint, sign * self.positions[joint], sign * velocity)
