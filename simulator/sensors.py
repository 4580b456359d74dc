"""Sensors of the drives: encoders, motor velocity and current, with their noise, delay and
filters."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from arrays import Vector
from simulator.description import ArmDescription, SimulationSettings
from simulator.profile import PROFILE, TURN, SimulatedMake
from simulator.servo import SERVO_PERIOD_S


@dataclass(frozen=True, slots=True)
class Readings:
    """One sample of all drives in the drives' own counts; lists of n integers."""

    link_position: list[int]
    motor_position: list[int]
    motor_velocity: list[int]
    current: list[int]


class Sensors:
    """Sensors of all joints. `update` is called every millisecond, `read` whenever a drive samples.
    Noise comes from the seed.

    The reported current is low-passed; the link encoder may be late.
    """

    def __init__(
        self,
        description: ArmDescription,
        settings: SimulationSettings,
        q: Vector,
        profile: SimulatedMake = PROFILE,
    ) -> None:
        joints = description.joints
        self._settings = settings
        self._rng = np.random.default_rng((settings.seed, 1))
        self._gear = np.array([joint.gear for joint in joints])
        self._per_ampere = 1.0 / (
            np.array([joint.rated_current_A for joint in joints]) * profile.effort_unit
        )
        self._profile = profile
        filter_s = 1e-3 * settings.current_filter_ms
        self._gain = 1.0 - np.exp(-SERVO_PERIOD_S / filter_s) if filter_s > 0.0 else 1.0
        self._current = np.zeros(len(joints))
        self._scratch = np.zeros(len(joints))
        self._counts = np.zeros((4, len(joints)))
        self._late = settings.link_latency_ms > 0.0
        late, self._late_share = divmod(settings.link_latency_ms, 1.0)
        self._history = deque([q.copy() for _ in range(int(late) + 2)], maxlen=int(late) + 2)

    def update(self, q: Vector, current: Vector) -> None:
        """Follow one servo period: link positions (n,) [rad], motor currents (n,) [A]."""
        np.subtract(current, self._current, out=self._scratch)
        np.multiply(self._scratch, self._gain, out=self._scratch)
        np.add(self._current, self._scratch, out=self._current)
        if self._late:
            row = self._history.popleft()
            row[:] = q
            self._history.append(row)

    def read(self, q: Vector, theta: Vector, theta_dot: Vector) -> Readings:
        """Sample: link position, motor position and motor velocity (n,), at the link side."""
        settings, profile = self._settings, self._profile
        if self._late:
            older, newer = self._history[0], self._history[1]
            q = newer + self._late_share * (older - newer)
        noise = self._rng.standard_normal((2, len(q)))
        velocity = theta_dot * (1.0 + settings.velocity_scale_error) + settings.velocity_bias
        velocity += settings.velocity_noise * noise[0]
        counts = self._counts
        np.multiply(q, profile.link_counts / TURN, out=counts[0])
        np.add(counts[0], profile.link_zero, out=counts[0])
        np.multiply(theta * self._gear, profile.motor_counts / TURN, out=counts[1])
        np.divide(velocity * self._gear, profile.measured_velocity_unit, out=counts[2])
        np.multiply(self._current, self._per_ampere, out=counts[3])
        np.add(counts[3], settings.current_noise_permille * noise[1], out=counts[3])
        np.maximum(np.minimum(counts[3], 32767.0, out=counts[3]), -32768.0, out=counts[3])
        link, motor, motor_velocity, current = np.rint(counts).astype(np.int64).tolist()
        return Readings(link, motor, motor_velocity, current)
