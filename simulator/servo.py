# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inner velocity loops of all drives at 1 kHz.

Ordinary Python that also runs uncompiled; `servo.pxd` declares the C types (decision 0037).
"""

import numpy as np

from common.arrays import Vector
from simulator.description import ArmDescription

SERVO_PERIOD_S = 0.001
BANDWIDTH = 2.0 * np.pi * 16.0
"""Bandwidth of the proportional loop with rotor and link in contact [rad/s]."""
INTEGRAL_RATE = 20.0
"""ki / kp [1/s]: at a stop the motor is held as by a spring of stiffness K_c ki [Nm/rad]."""


class Servo:
    """PI control of motor velocity with a ramped reference; velocities at the link, output in A.

    The ramp implements both the interpolation of setpoints over the SYNC period and a quick stop:
    the reference moves towards `target` by at most `rate` per period. Drives write single entries;
    the arm calls `update` every millisecond. Tuned for nominal inertias, as by a manufacturer.
    """

    def __init__(self, description: ArmDescription, link_inertia: Vector) -> None:
        joints = description.joints
        n = self._n = len(joints)
        rotor = np.array([joint.rotor_inertia for joint in joints])
        constant = np.array([joint.torque_constant for joint in joints])
        kp: Vector = (rotor + link_inertia) * BANDWIDTH / constant
        self.damping = constant * kp
        """Damping of the proportional part (n,) [Nm s/rad], with nominal torque constants."""
        self.stiffness = self.damping * INTEGRAL_RATE
        """Stiffness of holding at a stop (n,) [Nm/rad], likewise."""
        self._kp, self._ki_step = kp, kp * INTEGRAL_RATE * SERVO_PERIOD_S
        self._highest = np.array([joint.max_current_A for joint in joints], dtype=np.float64)
        self.target, self.reference, self.rate, self.current = np.zeros((4, n))
        # The same arrays again: public ones for other modules, typed ones for `update`.
        self._targets, self._references = self.target, self.reference
        self._rates, self._currents = self.rate, self.current
        self._wanted, self._integral = np.zeros((2, n))
        self._per_rise = np.ones(n)  # falling rate relative to `rate`
        self._energised = np.zeros(n)

    def energise(self, joint: int, velocity: float) -> None:
        """Switch on at the present velocity, without a jump of the current."""
        self._energised[joint] = 1.0
        self._references[joint] = self._targets[joint] = velocity
        self._rates[joint] = self._integral[joint] = 0.0

    def release(self, joint: int) -> None:
        """Switch off the current: the motor is limp."""
        self._energised[joint] = 0.0

    def limit(self, joint: int, current: float) -> None:
        """Set the current limit of the joint's motor [A]."""
        self._highest[joint] = current

    def tune(self, joint: int, kp: float, ki: float) -> None:
        """Set the gains of the joint's loop: kp [A s/rad], ki [A/rad]."""
        self._kp[joint], self._ki_step[joint] = kp, ki * SERVO_PERIOD_S

    def energised(self, joint: int) -> bool:
        """True while the joint's motor has current."""
        return bool(self._energised[joint])

    def follow(self, joint: int, velocity: float, over_s: float) -> None:
        """Reach `velocity` [rad/s] by linear interpolation over `over_s` [s]."""
        self._targets[joint] = velocity
        periods = max(1.0, over_s / SERVO_PERIOD_S)
        self._rates[joint] = abs(velocity - self._references[joint]) / periods
        self._per_rise[joint] = 1.0

    def ramp(self, joint: int, velocity: float, acceleration: float) -> None:
        """Reach `velocity` [rad/s] at `acceleration` [rad/s^2]."""
        self._targets[joint] = velocity
        self._rates[joint], self._per_rise[joint] = acceleration * SERVO_PERIOD_S, 1.0

    def slew(self, joint: int, velocity: float, rise: float, fall: float) -> None:
        """Reach `velocity` at separate rates of rise and fall [rad/s^2], both positive."""
        self.ramp(joint, velocity, rise)
        self._per_rise[joint] = fall / rise

    def arrived(self, joint: int) -> bool:
        """True once the ramp has ended."""
        return bool(self._references[joint] == self._targets[joint])

    def saturated(self, joint: int) -> bool:
        """True while the current is limited."""
        return bool(self._wanted[joint] != self._currents[joint])

    def update(self, velocity: Vector) -> None:
        """Advance by one period: from motor velocities (n,) [rad/s], compute `current` (n,) [A]."""
        for i in range(self._n):
            way = self._targets[i] - self._references[i]
            rise = self._rates[i]
            self._references[i] += max(min(way, rise), -rise * self._per_rise[i])
            error = self._references[i] - velocity[i]
            self._integral[i] += error * self._ki_step[i]
            wanted = (self._kp[i] * error + self._integral[i]) * self._energised[i]
            current = max(min(wanted, self._highest[i]), -self._highest[i])
            # Anti-windup by back-calculation of the integral.
            self._integral[i] = (self._integral[i] + (current - wanted)) * self._energised[i]
            self._wanted[i], self._currents[i] = wanted, current
