"""The trajectory: sinusoids around an anchor, run along a path time that starts and stops softly.

The path is a function of a path time s. Pausing, stopping and resuming change how fast s runs,
never the path itself, so the setpoint cannot leave it; after a person moved the arm, the path is
anchored anew where the arm stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.config.schema import Sinusoid

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class JointPath:
    """offset(s) = amplitude sin(omega s), per joint; zero amplitude holds."""

    amplitude: Vector
    omega: Vector

    @classmethod
    def from_sinusoids(cls, joints: Sequence[str], waves: Mapping[str, Sinusoid]) -> "JointPath":
        """Sinusoids by joint name; joints without one hold."""
        amplitude, omega = np.zeros(len(joints)), np.zeros(len(joints))
        for i, name in enumerate(joints):
            if wave := waves.get(name):
                amplitude[i] = wave.amplitude
                omega[i] = 2.0 * np.pi * wave.frequency_Hz
        return cls(amplitude, omega)

    def offset(self, s: float) -> Vector:
        """Displacement from the anchor's origin [rad] at path time s [s]."""
        return self.amplitude * np.sin(self.omega * s)

    def slope(self, s: float) -> Vector:
        """d offset / d s [rad/s]."""
        return self.amplitude * self.omega * np.cos(self.omega * s)


@dataclass(frozen=True, slots=True)
class Reference:
    """Where the arm should be: q [rad] and its velocity [rad/s]."""

    q: Vector
    velocity: Vector


class Follower:
    """Runs one path: where on it, how fast, and around which origin."""

    def __init__(self, path: JointPath, ramp_s: float) -> None:
        self._path = path
        self._ramp_s = ramp_s
        self._s = 0.0
        self._rate = 0.0  # ds/dt: 0 at standstill, 1 at full speed
        self._origin = np.zeros_like(path.amplitude)

    def anchor(self, q: Vector) -> None:
        """Put the path where the arm stands: from q [rad], at standstill, at the present path
        time."""
        self._rate = 0.0
        self._origin = q - self._path.offset(self._s)

    def rewind(self) -> None:
        """Begin the path from its start at the next `anchor`."""
        self._s = 0.0

    def misfits(self, q: Vector, lower: Vector, upper: Vector) -> NDArray[np.bool_]:
        """Joints whose path, anchored at q, would go beyond [lower, upper]."""
        origin = q - self._path.offset(self._s)
        moves = self._path.amplitude > 0.0
        low, high = origin - self._path.amplitude, origin + self._path.amplitude
        return moves & ((low < lower) | (high > upper))

    def step(self, dt: float) -> Reference:
        """Advance by dt [s] and return the reference there; ds/dt rises linearly to 1."""
        rate = min(1.0, self._rate + dt / self._ramp_s)
        self._s += 0.5 * (self._rate + rate) * dt
        self._rate = rate
        return Reference(
            self._origin + self._path.offset(self._s), self._path.slope(self._s) * rate
        )
