"""Motor with integrated gear, encoder and controller, as seen from the bus: base of all makes.

It keeps its last command until the next one or its timeout, and is limp after that.
"""

from dataclasses import dataclass
from math import exp, inf

from simulator.profile import TURN, MotorMake
from simulator.servo import SERVO_PERIOD_S
from simulator.surroundings import Surroundings


@dataclass(frozen=True, slots=True)
class Command:
    """Contents of a command, in the motor's own direction: position [rad], velocity [rad/s] (its
    limit in a position loop), gains, torque [Nm] and share of the current."""

    position: float = 0.0
    velocity: float = 0.0
    kp: float = 0.0
    kd: float = 0.0
    torque: float = 0.0
    share: float = 1.0


class Motor:
    """One motor: frames in, frames out. Time is an argument [s]; call `tick` from `due` on.

    Faults: `silent` cuts it off the bus, `frozen` freezes its encoders, `boot` resets it, `fail`
    raises an error, which recurs as long as it is the `trouble`.
    """

    extended = False
    """True if it responds to 29-bit identifiers only, False for 11-bit ones only."""

    def __init__(self, joint: int, wired: Surroundings, make: MotorMake, filter_ms: float) -> None:
        about = wired.description.joints[joint]
        self._joint, self._wired, self._make, self._about = joint, wired, make, about
        self._servo, self._laws = wired.servo, wired.laws
        self.due = inf
        """Time of the next action of its own [s]."""
        self.silent = self.frozen = False
        self.degC = (30.0, 35.0)
        """Temperatures of MOSFET and rotor."""
        self.command = Command()
        self.trouble = 0
        self._heard_at = 0.0
        # Positions of output and rotor, and their offsets: zeros that were set, turns.
        self._output = self._motor = self._velocity = self._current = 0.0
        self._zero_output, self._zero_motor = 0.0, -make.motor_sign * make.offset
        self._turns = 0.0
        sensors = make.sensors()
        self._per_output = TURN / abs(sensors.link_counts)
        self._per_count = TURN / abs(sensors.motor_counts) / about.gear
        self._per_velocity = abs(sensors.measured_velocity_unit) / about.gear
        self._per_effort = abs(sensors.effort_unit) * about.rated_current_A
        wired.laws.measure(joint, 1.0 - exp(-1e3 * SERVO_PERIOD_S / filter_ms))

    @property
    def moves(self) -> bool:
        """True while it is commanded to move."""
        raise NotImplementedError

    def on_frame(self, can_id: int, data: bytes) -> None:
        """Take a frame from the bus."""
        raise NotImplementedError

    def boot(self) -> None:
        """Power up or reset."""
        raise NotImplementedError

    def tick(self, now: float) -> None:
        """Perform due actions."""
        raise NotImplementedError

    def _limp(self) -> None:
        self.command, self.due = Command(), inf
        self._servo.release(self._joint)
        self._laws.release(self._joint)
        self._brake(closed=True)

    def _brake(self, *, closed: bool) -> None:
        if self._about.brake:
            self._wired.plant.brake(self._joint, closed)

    def _set_impedance(self, per_ampere: float, highest: float) -> None:
        """Execute the command as an impedance, with at most the `highest` current [A]."""
        c, sign, joint = self.command, self._make.motor_sign, self._joint
        self._servo.release(joint)
        self._laws.scale(joint, 1.0 / per_ampere, min(highest, self._about.max_current_A))
        self._laws.set_impedance(joint, self._goal, sign * c.velocity, c.kp, c.kd, sign * c.torque)

    @property
    def _goal(self) -> float:
        """Commanded position in the joint's coordinates [rad]."""
        return self._make.motor_sign * (self.command.position - self._zero_motor - self._turns)

    def _zero(self) -> None:
        """Set the present position to 0."""
        self._wired.sample()
        motor, output = self.positions
        self._zero_motor -= motor
        self._zero_output -= output

    def measure(self, link: int, motor: int, velocity: int, current: int) -> None:
        """Store the counts sampled by the sensors."""
        if not self.frozen:
            self._output, self._motor = self._per_output * link, self._per_count * motor
        self._velocity, self._current = velocity * self._per_velocity, current * self._per_effort

    @property
    def positions(self) -> tuple[float, float]:
        """Positions of the rotor (behind the gear) and the output in the motor's coordinates
        [rad]."""
        turns = self._turns
        return self._motor + self._zero_motor + turns, self._output + self._zero_output + turns


def to_uint(x: float, low: float, high: float, bits: int) -> int:
    """Integer code of x, which is saturated at the range; rounded down."""
    return int((min(max(x, low), high) - low) * ((1 << bits) - 1) / (high - low))


def to_float(u: int, low: float, high: float, bits: int) -> float:
    """Value of an integer code."""
    return u * (high - low) / ((1 << bits) - 1) + low
