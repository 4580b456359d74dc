"""Ways in which drives reach their setpoints, for set-ups without a bus.

A drive ramps from setpoint to setpoint over the period, as contactd asks for, takes each as a step,
or ramps at an acceleration of its own; its velocity loop is fast or slow. Identification must see
through all of them.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from common.arrays import Vector
from simulator.description import ArmDescription
from simulator.servo import BANDWIDTH, SERVO_PERIOD_S, Servo

Way = Literal["ramps", "steps", "accelerates"]
WAYS: Final[tuple[Way, ...]] = ("ramps", "steps", "accelerates")
_USUAL_HZ: Final = BANDWIDTH / (2.0 * np.pi)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reaching:
    """Lag of the drives of one arm behind their setpoints."""

    way: Way = "ramps"
    bandwidth_Hz: float = _USUAL_HZ
    acceleration: float = 30.0  # of those that accelerate [rad/s2 at the link]

    def servo(self, description: ArmDescription, link_inertia: Vector) -> Servo:
        """Velocity loops of this bandwidth."""
        # A servo's gain is that of the rotor and the link that it is tuned to.
        rotor = np.array([joint.rotor_inertia for joint in description.joints])
        share = self.bandwidth_Hz / _USUAL_HZ
        return Servo(description, share * (rotor + link_inertia) - rotor)

    def reach(self, servo: Servo, velocity: Vector, period_s: float) -> None:
        """Give every drive its next setpoint (n,) [rad/s]."""
        servo.target[:] = velocity
        match self.way:
            case "ramps":
                periods = round(period_s / SERVO_PERIOD_S)
                servo.rate[:] = np.abs(velocity - servo.reference) / periods
            case "steps":
                servo.rate[:] = np.abs(velocity - servo.reference)
            case "accelerates":
                servo.rate[:] = self.acceleration * SERVO_PERIOD_S


RAMPING: Final = Reaching()
