# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Control laws of motors in addition to the velocity loop: an impedance, evaluated at every step of
the plant like a 20 kHz loop, and a position loop, evaluated in every servo period.

Ordinary Python that also runs uncompiled; `motor_laws.pxd` declares the C types (decision 0037).
"""

import numpy as np

from common.arrays import Vector
from simulator.servo import Servo


class MotorLaws:
    """Control laws of n joints, on top of their `Servo`; SI units at the link. A joint has at most
    one of them, initially none; its velocity loop is active unless it has an impedance."""

    def __init__(self, servo: Servo) -> None:
        n = self._n = len(servo.target)
        self._targets, self._currents = servo.target, servo.current
        self._goal, self._velocity, self._torque = np.zeros((3, n))
        self._kp, self._kd, self._highest = np.zeros((3, n))
        self._per_torque = np.ones(n)
        self._heads, self._impeded = np.zeros((2, n))
        self._share = np.ones(n)
        self._smooth = np.zeros(n)
        self.positions = self.impedances = self.filters = 0
        """Numbers of joints with a position loop, with an impedance, with a velocity filter."""

    def measure(self, joint: int, share: float) -> None:
        """Low-pass filter the joint's measured velocity: each period moves it by this share."""
        self._share[joint] = share
        self.filters += 1

    def head(self, joint: int, goal: float, gain: float, fastest: float) -> None:
        """Position loop: the target velocity is gain [1/s] times the error, up to `fastest`
        [rad/s]."""
        self.release(joint)
        self._goal[joint], self._kp[joint], self._velocity[joint] = goal, gain, fastest
        self._heads[joint] = 1.0
        self.positions += 1

    def set_impedance(
        self, joint: int, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> None:
        """Impedance: the motor torque is kp (position - theta) + kd (velocity - theta_dot) +
        torque, within the limit set by `scale`."""
        self.release(joint)
        self._goal[joint], self._velocity[joint], self._torque[joint] = position, velocity, torque
        self._kp[joint], self._kd[joint] = kp, kd
        self._impeded[joint] = 1.0
        self.impedances += 1

    def scale(self, joint: int, per_torque: float, highest: float) -> None:
        """Set the current of an impedance: `per_torque` [A/Nm], at most `highest` [A]."""
        self._per_torque[joint], self._highest[joint] = per_torque, highest

    def release(self, joint: int) -> None:
        """Remove the law: the velocity loop acts alone."""
        self.positions -= int(self._heads[joint])
        self.impedances -= int(self._impeded[joint])
        self._heads[joint] = self._impeded[joint] = 0.0

    def steer(self, q: Vector, phi: Vector) -> None:
        """Update the targets of the position loops from q and phi = q - theta (n,) [rad]."""
        for i in range(self._n):
            if self._heads[i] > 0.0:
                wanted = self._kp[i] * (self._goal[i] - (q[i] - phi[i]))
                self._targets[i] = max(min(wanted, self._velocity[i]), -self._velocity[i])

    def respond(self, q: Vector, phi: Vector, theta_dot: Vector) -> None:
        """Update the currents of the impedances from the present state."""
        for i in range(self._n):
            if self._impeded[i] > 0.0:
                torque = self._kp[i] * (self._goal[i] - (q[i] - phi[i])) + self._torque[i]
                torque += self._kd[i] * (self._velocity[i] - theta_dot[i])
                current = torque * self._per_torque[i]
                self._currents[i] = max(min(current, self._highest[i]), -self._highest[i])

    def follow(self, theta_dot: Vector) -> None:
        """Update the velocity filters with the velocities (n,) [rad/s] of one period."""
        for i in range(self._n):
            self._smooth[i] += self._share[i] * (theta_dot[i] - self._smooth[i])

    def seen(self, theta_dot: Vector) -> Vector:
        """Velocities that the sensors read (n,), filtered for motors that do so."""
        if self.filters == 0:
            return theta_dot
        return np.where(np.asarray(self._share) < 1.0, np.asarray(self._smooth), theta_dot)
