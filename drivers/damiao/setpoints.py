"""Setpoints of motors: an impedance about a position that follows the target velocity.

    torque = stiffness (p - q) + damping (v - q_dot),  p += v T

In the motor this is a velocity loop with an integral, whose gains have units, and whose joint ends
next to p where setpoints cease. A motor that does not run has p where it is, so that it holds there
when it is enabled; p goes no further from it than the torque that its current limit allows.
"""

import math
from collections.abc import Iterable, Sequence

from drivers.can.wire import Frame
from drivers.damiao.frames import MOST_DAMPING, STIFFEST, scaled, setpoint, setpoint_of
from drivers.damiao.settings import DamiaoDrive


class Setpoints:
    """Setpoints of an arm, written into frames that stay."""

    def __init__(self, drives: Sequence[DamiaoDrive], period_s: float) -> None:
        self._period_s = period_s
        self._signs = [float(drive.wiring.motor_sign) for drive in drives]
        self._most = [(d.profile.position_max, d.profile.velocity_max) for d in drives]
        self._gains = [
            (_share(d.profile.stiffness, STIFFEST), _share(d.profile.damping, MOST_DAMPING))
            for d in drives
        ]
        self._reach = [
            d.wiring.max_current_A * d.profile.Nm_per_A / d.profile.stiffness for d in drives
        ]
        self._data = [bytearray(8) for _ in drives]
        self.frames: list[Frame] = [
            (drive.node, data) for drive, data in zip(drives, self._data, strict=True)
        ]
        self.positions: list[float] = [math.nan] * len(drives)
        """Position p of each motor [rad at the link]; NaN where it is not known yet."""

    def write(self, joint: int, velocity: float, measured: float, *, runs: bool) -> bool:
        """Move p of a joint on with its target velocity [rad/s], about its `measured` motor [rad];
        take it to the motor where it does not run. False where neither was ever known: there is no
        setpoint then."""
        before, reach = self.positions[joint], self._reach[joint]
        here = measured if math.isfinite(measured) else before
        p = before + velocity * self._period_s if runs and math.isfinite(before) else here
        self.positions[joint] = min(max(p, here - reach), here + reach)
        if known := math.isfinite(here):
            self._pack(joint, velocity if runs else 0.0)
        return known

    def adopt(self, joint: int, data: bytes | bytearray) -> None:
        """Take the p of a setpoint that the guardian sent: the motor is held there."""
        if (found := setpoint_of(data)) is not None:
            step = 2.0 * self._most[joint][0] / 0xFFFF
            self.positions[joint] = self._signs[joint] * step * (found[0] - 0x7FFF)

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
        return [self.frames[joint] for joint in known]

    def _pack(self, joint: int, velocity: float) -> None:
        sign, (furthest, fastest) = self._signs[joint], self._most[joint]
        setpoint(
            self._data[joint],
            scaled(sign * self.positions[joint], furthest, 16),
            scaled(sign * velocity, fastest, 12),
            self._gains[joint],
        )


def _share(value: float, most: float) -> int:
    return round(value / most * 0xFFF)
