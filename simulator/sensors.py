# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Sensors of the drives: encoders, motor velocity and current, with their noise, delay and
filters.

Ordinary Python that also runs uncompiled; `sensors.pxd` declares the C types (decision 0037).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.elementary import sine
from simulator.description import ArmDescription, EncoderError, SimulationSettings
from simulator.profile import PROFILE, TURN, SimulatedMake
from simulator.servo import SERVO_PERIOD_S


@dataclass(frozen=True, slots=True)
class Readings:
    """One sample of all drives, in the drives' own counts; lists of n integers."""

    link_position: list[int]
    motor_position: list[int]
    motor_velocity: list[int]
    current: list[int]


class Sensors:
    """Sensors of all joints: call `update` every millisecond, `read` whenever a drive samples.
    Noise is determined by the seed.

    The reported current is low-pass filtered; the link encoder may have a latency.
    """

    def __init__(
        self,
        description: ArmDescription,
        settings: SimulationSettings,
        q: Vector,
        makes: Sequence[SimulatedMake] = (),
    ) -> None:
        """makes: make of each joint's drive; if empty, all are `PROFILE`."""
        joints, n = description.joints, len(description.joints)
        gear = np.array([joint.gear for joint in joints], dtype=np.float64)
        rated = np.array([joint.rated_current_A for joint in joints], dtype=np.float64)
        self._n = n
        self._rng = np.random.default_rng((settings.seed, 1))
        makes = makes or [PROFILE] * n
        self._link_per_rad = np.array([make.link_counts / TURN for make in makes])
        self._link_zero = np.array([float(make.link_zero) for make in makes])
        self._at_motor = np.array([float(make.link_at_motor) for make in makes])
        self._gear = gear
        errors = [joint.encoder_errors for joint in joints]
        self._link_errors, self._motor_errors = _of("link", errors), _of("motor", errors)
        self._motor_per_turn = np.array([make.motor_counts / TURN for make in makes])
        self._velocity_unit = np.array([make.measured_velocity_unit for make in makes])
        self._velocity_step = np.array([make.velocity_step for make in makes])
        self._velocity_scale = 1.0 + settings.velocity_scale_error
        self._velocity_bias, self._velocity_noise = settings.velocity_bias, settings.velocity_noise
        self._per_ampere = 1.0 / (rated * np.array([make.effort_unit for make in makes]))
        self._current_noise = settings.current_noise_permille
        self._gain = np.array([_share(make, settings) for make in makes])
        self._current = np.zeros(n)
        self._late = settings.link_latency_ms > 0.0
        late, self._late_share = divmod(settings.link_latency_ms, 1.0)
        # Link positions of the last milliseconds, the oldest in row `_oldest`.
        self._rows, self._oldest = int(late) + 2, 0
        self._history = np.repeat([q], self._rows, axis=0)

    def update(self, q: Vector, current: Vector) -> None:
        """Advance by one servo period: link positions (n,) [rad], motor currents (n,) [A]."""
        for i in range(self._n):
            self._current[i] += (current[i] - self._current[i]) * self._gain[i]
        if self._late:
            for i in range(self._n):
                self._history[self._oldest, i] = q[i]
            self._oldest = (self._oldest + 1) % self._rows

    def read(self, q: Vector, theta: Vector, theta_dot: Vector) -> Readings:
        """Sample: link position, motor position and motor velocity (n,), at the link side."""
        return self._counts(q, theta, theta_dot, self._rng.standard_normal((2, self._n)))

    def _counts(self, q: Vector, theta: Vector, theta_dot: Vector, noise: Matrix) -> Readings:
        """Sample with given noise (2, n) of velocity and current, of unit variance."""
        link, motor, velocities, currents = [], [], [], []
        newer = (self._oldest + 1) % self._rows
        for i in range(self._n):
            where = q[i]
            if self._late:
                older = self._history[self._oldest, i]
                where = self._history[newer, i]
                where += self._late_share * (older - where)
            if self._at_motor[i] > 0.0:
                where = theta[i]
            velocity = theta_dot[i] * self._velocity_scale + self._velocity_bias
            velocity += self._velocity_noise * noise[0, i]
            current = self._current[i] * self._per_ampere[i] + self._current_noise * noise[1, i]
            where += repeated(self._link_errors, i, where)
            turned = theta[i] + repeated(self._motor_errors, i, theta[i] * self._gear[i])
            link.append(whole(where * self._link_per_rad[i] + self._link_zero[i]))
            motor.append(whole(turned * self._gear[i] * self._motor_per_turn[i]))
            velocity *= self._gear[i]
            step = self._velocity_step[i]
            if step > 0.0:
                velocity = whole(velocity / step) * step
            velocities.append(whole(velocity / self._velocity_unit[i]))
            currents.append(whole(max(min(current, 32767.0), -32768.0)))
        return Readings(link, motor, velocities, currents)


def _of(encoder: str, errors: Sequence[Sequence[EncoderError]]) -> NDArray[np.float64]:
    """Order, amplitude and phase (n, k, 3) of the errors of one encoder, padded with zeros."""
    of = [[one for one in joint if one.encoder == encoder] for joint in errors]
    table = np.zeros((len(of), max(map(len, of), default=0), 3))
    for row, joint in zip(table, of, strict=True):
        for place, one in zip(row, joint, strict=False):
            place[:] = one.order, one.amplitude, one.phase
    return table


def repeated(errors: NDArray[np.float64], joint: int, angle: float) -> float:
    """Periodic encoder error of a joint [rad], from its table (n, k, 3) and shaft angle [rad]."""
    off = 0.0
    for k in range(errors.shape[1]):
        off += errors[joint, k, 1] * sine(errors[joint, k, 0] * angle + errors[joint, k, 2])
    return off


def _share(make: SimulatedMake, settings: SimulationSettings) -> float:
    """Share by which the filter of the reported current approaches a new value in a period."""
    own = make.current_filter_ms
    filter_s = 1e-3 * (settings.current_filter_ms if own is None else own)
    return 1.0 - float(np.exp(-SERVO_PERIOD_S / filter_s)) if filter_s > 0.0 else 1.0


def whole(x: float) -> int:
    """Nearest integer, ties to even; |x| below 2^51."""
    # Adding and subtracting 1.5 * 2^52 rounds.
    return int((x + 6755399441055744.0) - 6755399441055744.0)
