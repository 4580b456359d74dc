# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Laws of motors that act on their own position, beside the velocity loop: an impedance at every
step of the plant, as a loop of 20 kHz has it, and a position loop in every servo period.

Ordinary Python, which runs as it is; `motor_laws.pxd` names the types for the compiler, decision
0037.
"""

import numpy as np

from common.arrays import Vector
from simulator.servo import Servo


class MotorLaws:
    """Laws of n joints, on top of their `Servo`; SI at the link. A joint has one of them at most,
    none at the beginning, and its velocity loop acts where it has no impedance."""

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
        """numbers of joints with a position loop, with an impedance, with a filter"""

    def measure(self, joint: int, share: float) -> None:
        """Low-pass the joint's measured velocity: it takes over this share in each period."""
        self._share[joint] = share
        self.filters += 1

    def head(self, joint: int, goal: float, gain: float, fastest: float) -> None:
        """Have the velocity loop head for a position: gain [1/s], at most `fastest` [rad/s]."""
        self.release(joint)
        self._goal[joint], self._kp[joint], self._velocity[joint] = goal, gain, fastest
        self._heads[joint] = 1.0
        self.positions += 1

    def impede(
        self, joint: int, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> None:
        """Torque of the motor from now on: kp (position - theta) + kd (velocity - theta_dot) +
        torque, within the limit of `scale`."""
        self.release(joint)
        self._goal[joint], self._velocity[joint], self._torque[joint] = position, velocity, torque
        self._kp[joint], self._kd[joint] = kp, kd
        self._impeded[joint] = 1.0
        self.impedances += 1

    def scale(self, joint: int, per_torque: float, highest: float) -> None:
        """Currents of an impedance: `per_torque` [A/Nm], at most `highest` [A]."""
        self._per_torque[joint], self._highest[joint] = per_torque, highest

    def release(self, joint: int) -> None:
        """No law: the velocity loop alone."""
        self.positions -= int(self._heads[joint])
        self.impedances -= int(self._impeded[joint])
        self._heads[joint] = self._impeded[joint] = 0.0

    def steer(self, q: Vector, phi: Vector) -> None:
        """Set the targets of the position loops, by q and phi = q - theta (n,) [rad]."""
        for i in range(self._n):
            if self._heads[i] > 0.0:
                wanted = self._kp[i] * (self._goal[i] - (q[i] - phi[i]))
                self._targets[i] = max(min(wanted, self._velocity[i]), -self._velocity[i])

    def respond(self, q: Vector, phi: Vector, theta_dot: Vector) -> None:
        """Set the currents of the impedances, by the state of this instant."""
        for i in range(self._n):
            if self._impeded[i] > 0.0:
                torque = self._kp[i] * (self._goal[i] - (q[i] - phi[i])) + self._torque[i]
                torque += self._kd[i] * (self._velocity[i] - theta_dot[i])
                current = torque * self._per_torque[i]
                self._currents[i] = max(min(current, self._highest[i]), -self._highest[i])

    def follow(self, theta_dot: Vector) -> None:
        """Filter the velocities (n,) [rad/s] of one period."""
        for i in range(self._n):
            self._smooth[i] += self._share[i] * (theta_dot[i] - self._smooth[i])

    def seen(self, theta_dot: Vector) -> Vector:
        """Velocities that the sensors read (n,): filtered where the motor does that."""
        if self.filters == 0:
            return theta_dot
        return np.where(np.asarray(self._share) < 1.0, np.asarray(self._smooth), theta_dot)
