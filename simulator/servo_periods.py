# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Servo periods of the whole arm: servo, sensors and plant in sequence, several per call.

Ordinary Python that also runs uncompiled; `servo_periods.pxd` declares the C types (decision 0037).
"""

from collections.abc import Callable

from common.arrays import Matrix, Vector
from simulator.motor_laws import MotorLaws
from simulator.sensors import Sensors
from simulator.servo import Servo
from simulator.two_masses import TwoMasses


class ServoPeriods:
    """Servo, sensors and plant of one arm; torque_constant (n,) [Nm/A] is the true one, `laws` are
    control laws of motors in addition to the velocity loop."""

    def __init__(
        self,
        servo: Servo,
        sensors: Sensors,
        masses: TwoMasses,
        torque_constant: Vector,
        laws: MotorLaws | None = None,
    ) -> None:
        self._servo, self._sensors, self._masses = servo, sensors, masses
        self._laws = MotorLaws(servo) if laws is None else laws
        self._torque_constant, self._current = torque_constant, servo.current

    def begin(self) -> None:
        """Begin a period: update currents and sensors."""
        masses, laws = self._masses, self._laws
        if laws.positions > 0:
            laws.steer(masses.q, masses.phi)
        self._servo.update(masses.theta_dot)
        if laws.impedances > 0:
            laws.respond(masses.q, masses.phi, masses.theta_dot)
        if laws.filters > 0:
            laws.follow(masses.theta_dot)
        self._drive()
        self._sensors.update(masses.q, self._current)

    def advance(self, steps: int, touch: Callable[[], None] | None) -> None:
        """Advance the plant by `steps` steps, with impedances evaluated at each."""
        masses, laws = self._masses, self._laws
        if laws.impedances == 0:
            masses.advance(steps, touch)
        else:
            for _ in range(steps):
                laws.respond(masses.q, masses.phi, masses.theta_dot)
                self._drive()
                masses.advance(1, touch)

    def _drive(self) -> None:
        for i in range(self._masses.n):
            self._masses.motor[i] = self._torque_constant[i] * self._current[i]

    def run(self, periods: int, steps: int, touch: Callable[[], None] | None) -> None:
        """Advance by `periods` periods of `steps` steps each; `touch` as in `TwoMasses.advance`."""
        for _ in range(periods):
            self.begin()
            self.advance(steps, touch)

    def record(self, external: Matrix, steps: int, phi: Matrix, gear_torque: Matrix) -> None:
        """Run one period per row of `external`, the torque on the links [Nm], and write phi [rad]
        and the torque of the gear on the link [Nm] after each; all (periods, n)."""
        masses = self._masses
        for period in range(external.shape[0]):
            for i in range(masses.n):
                masses.external[i] = external[period, i]
            self.begin()
            self.advance(steps, None)
            for i in range(masses.n):
                phi[period, i], gear_torque[period, i] = masses.phi[i], -masses.gear[i]
