"""Inner velocity loops of all drives at 1 kHz, side by side in vectors."""

import numpy as np
from numpy import add, maximum, minimum, multiply, negative, subtract

from arrays import Vector
from simulator.description import ArmDescription

SERVO_PERIOD_S = 0.001
BANDWIDTH = 2.0 * np.pi * 16.0
"""Of the proportional loop with rotor and link in contact [rad/s]."""
INTEGRAL_RATE = 20.0
"""ki / kp [1/s]: a stop is held like a spring of K_c ki [Nm/rad] on the motor."""


class Servo:
    """PI on motor velocity, reference approached by a ramp; velocities at the link, output in A.

    A ramp serves the interpolation of setpoints over the SYNC period as well as a quick stop: the
    reference moves towards `target` by at most `rate` per period. Drives write single entries, the
    arm calls `update` every millisecond. Tuned to nominal inertias, as a maker would.
    """

    def __init__(self, description: ArmDescription, link_inertia: Vector) -> None:
        joints = description.joints
        n = len(joints)
        rotor = np.array([joint.rotor_inertia for joint in joints])
        constant = np.array([joint.torque_constant for joint in joints])
        self._kp = (rotor + link_inertia) * BANDWIDTH / constant
        self.damping = constant * self._kp
        """Of the proportional part (n,) [Nm s/rad], with nominal torque constants."""
        self.stiffness = self.damping * INTEGRAL_RATE
        """Of the spring like which a stop is held (n,) [Nm/rad], likewise."""
        self._ki_step = self._kp * INTEGRAL_RATE * SERVO_PERIOD_S
        self._highest = np.array([joint.max_current_A for joint in joints])
        self._lowest = -self._highest
        self.target, self.reference, self.rate = np.zeros((3, n))
        self.current, self._wanted, self._integral, self._error = np.zeros((4, n))
        self._energised = np.zeros(n)
        self._limp = True  # some joint is

    def energise(self, joint: int, velocity: float) -> None:
        """Switch on at the present velocity: the current does not jump."""
        self._energised[joint] = 1.0
        self._limp = not self._energised.all()
        self.reference[joint] = self.target[joint] = velocity
        self.rate[joint] = self._integral[joint] = 0.0

    def release(self, joint: int) -> None:
        """No current: the motor is limp."""
        self._energised[joint] = 0.0
        self._limp = True

    def limit(self, joint: int, current: float) -> None:
        """Let the joint's motor have no more than this current [A]."""
        self._highest[joint], self._lowest[joint] = current, -current

    def energised(self, joint: int) -> bool:
        """True while the joint's motor has current."""
        return bool(self._energised[joint])

    def follow(self, joint: int, velocity: float, over_s: float) -> None:
        """Reach `velocity` [rad/s] in a straight line over `over_s`."""
        self.target[joint] = velocity
        periods = max(1.0, over_s / SERVO_PERIOD_S)
        self.rate[joint] = abs(velocity - self.reference[joint]) / periods

    def ramp(self, joint: int, velocity: float, acceleration: float) -> None:
        """Reach `velocity` at `acceleration` [rad/s^2]."""
        self.target[joint] = velocity
        self.rate[joint] = acceleration * SERVO_PERIOD_S

    def arrived(self, joint: int) -> bool:
        """True when the ramp is over."""
        return bool(self.reference[joint] == self.target[joint])

    def saturated(self, joint: int) -> bool:
        """True while the current limit is at work."""
        return bool(self._wanted[joint] != self.current[joint])

    def update(self, velocity: Vector) -> None:
        """Advance by one period: motor velocities (n,) [rad/s] in, motor currents in `current` (n,)
        [A]."""
        error, wanted, integral = self._error, self._wanted, self._integral
        reference, current, energised = self.reference, self.current, self._energised
        subtract(self.target, reference, error)
        minimum(error, self.rate, out=error)
        maximum(error, negative(self.rate, wanted), out=error)
        add(reference, error, reference)
        subtract(reference, velocity, error)
        multiply(self._kp, error, wanted)
        multiply(error, self._ki_step, error)
        add(integral, error, integral)
        add(wanted, integral, wanted)
        if self._limp:
            multiply(wanted, energised, wanted)
        minimum(wanted, self._highest, out=current)
        maximum(current, self._lowest, out=current)
        # Back-calculation: what the limit cut off does not pile up in the integral.
        subtract(current, wanted, error)
        add(integral, error, integral)
        if self._limp:
            multiply(integral, energised, integral)
