"""One Damiao motor on the bus: commands and registers in, a feedback for each; no heartbeat, no
SYNC. It keeps its last command until the next, or until its time-out, and is limp after that."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import exp, inf, isfinite
from types import MappingProxyType

from simulator.damiao import frames
from simulator.damiao import registers as r
from simulator.damiao.frames import Command
from simulator.damiao.models import ENCODER_COUNTS, FILTER_MS, MODELS, DamiaoMake
from simulator.profile import TURN
from simulator.servo import SERVO_PERIOD_S
from simulator.surroundings import Surroundings

REGISTERS_ID = 0x7FF
READ, WRITE, SAVE, REFRESH = 0x33, 0x55, 0xAA, 0xCC
DISABLED, ENABLED = 0, 1
OVER_VOLTAGE, UNDER_VOLTAGE, OVER_CURRENT, MOS_HOT, ROTOR_HOT, LOST, OVERLOAD = range(8, 15)
TICK_S = 50e-6
"""Unit of the time-out."""
OBSERVER = 600.0
"""Bandwidth of the velocity loop's observer of disturbances [1/s]: with it, the loop is a PI."""
_SPECIAL = b"\xff" * 7

_DECODERS: Mapping[int, Callable[[bytes, frames.Ranges], Command | None]] = MappingProxyType(
    {
        r.MIT: frames.impedance, r.POSITION: frames.position_velocity,
        r.VELOCITY: frames.velocity, r.HYBRID: frames.hybrid,
    }
)  # fmt: skip
"""By mode; the frame's identifier is that of the motor + 0x100 * (mode - 1)."""


class DamiaoMotor:
    """One motor: frames in, frames out. Time is an argument [s]; `tick` is due from `due` on.

    Faults: `silent` cuts it off the bus, `frozen` stops both encoders, `boot` resets it, `fail`
    raises an error, which comes again for as long as it is `trouble`; registers may hold anything.
    """

    def __init__(self, joint: int, wired: Surroundings, make: DamiaoMake) -> None:
        about = wired.description.joints[joint]
        self._joint, self._wired, self.make = joint, wired, make
        self._servo, self._laws, self._about = wired.servo, wired.laws, about
        self.registers = r.Registers.of(make, about.node)
        self._saved = dict(self.registers.values)
        self.status = DISABLED
        self.due = inf
        """Nothing happens by itself before this time [s]."""
        self.silent = self.frozen = False
        self.degC = (30.0, 35.0)
        """temperatures of MOSFET and rotor"""
        self.command = Command()
        self.trouble = 0
        self._heard_at = 0.0
        # Positions of output and rotor, and what is added to them: zeros that were set, turns.
        self._output = self._motor = self._velocity = self._current = 0.0
        self._zero_output, self._zero_motor = 0.0, -make.motor_sign * make.offset
        self._turns = 0.0
        self._per_count = TURN / ENCODER_COUNTS / about.gear
        sensors = make.sensors()
        self._per_velocity = abs(sensors.measured_velocity_unit) / about.gear
        self._per_effort = abs(sensors.effort_unit) * about.rated_current_A
        wired.laws.measure(joint, 1.0 - exp(-1e3 * SERVO_PERIOD_S / FILTER_MS))

    @property
    def can_id(self) -> int:
        """Identifier of its commands, less the mode's offset."""
        return self.registers.number(r.CAN_ID)

    @property
    def moves(self) -> bool:
        """True while it is commanded to move."""
        asked = abs(self.command.velocity) > 0.002 * self.registers.ranges.v_max
        return self.status == ENABLED and asked

    def boot(self) -> None:
        """Power-up or reset: registers as saved, limp, and within one turn of the output."""
        self.registers.values = dict(self._saved)
        self._switch_off(DISABLED)
        self._wired.sample()
        self._turns = 0.0
        self._turns = -TURN * round(self.positions[1] / TURN)

    def fail(self, status: int) -> None:
        """Raise an error: limp, until it is cleared and enabled again."""
        self._wired.report(f"motor {self.can_id}: error {status:X}")
        self._switch_off(status)

    def tick(self, now: float) -> None:
        """Do what is due: the time-out, and errors that come again."""
        if self.trouble and self.status < OVER_VOLTAGE:
            self.fail(self.trouble)
        limit = self.registers.number(r.TIMEOUT) * TICK_S
        self.due = inf
        if self.status == ENABLED and limit:
            if now - self._heard_at > limit:
                self.fail(LOST)
            else:
                self.due = self._heard_at + limit

    def _switch_off(self, status: int) -> None:
        self.status, self.command, self.due = status, Command(), inf
        self._servo.release(self._joint)
        self._laws.release(self._joint)
        self._brake(closed=True)

    def _enable(self) -> None:
        if self.status == DISABLED:
            self.status = ENABLED
            self._brake(closed=False)
            self._act()

    def _brake(self, *, closed: bool) -> None:
        if self._about.brake:
            self._wired.plant.brake(self._joint, closed)

    def on_frame(self, cob_id: int, data: bytes) -> None:
        """Take a frame from the bus: it minds the low byte of the identifier alone."""
        if self.silent:
            return
        if cob_id & 0xFF == self.can_id:
            self._heard_at = self._wired.now()
            if data[:7] == _SPECIAL and len(data) == 8:
                self._on_special(data[7])
            else:
                self._on_command((cob_id >> 8) + 1, data)
            self.due = 0.0
            self._answer()
        elif cob_id == REGISTERS_ID and len(data) >= 4 and data[:2] == self._name():
            self._on_register(data[2], data[3], data[4:8])

    def _on_special(self, what: int) -> None:
        if what == 0xFC:
            self._enable()
        elif what == 0xFD:
            self._switch_off(self.status if self.status >= OVER_VOLTAGE else DISABLED)
        elif what == 0xFE:
            self._wired.sample()
            motor, output = self.positions
            self._zero_motor -= motor
            self._zero_output -= output
            self.command = replace(self.command, position=0.0)
            self._act()
        elif what == 0xFB:
            self._switch_off(DISABLED)

    def _on_command(self, mode: int, data: bytes) -> None:
        if mode != self.registers.number(r.MODE):
            return
        command = _DECODERS[mode](data, self.registers.ranges)
        if command is not None and isfinite(command.position + command.velocity):
            self.command = command
            self._act()

    def _on_register(self, what: int, register: int, raw: bytes) -> None:
        if what == READ:
            self._wired.sample()
            positions = zip((r.P_MOTOR, r.P_OUTPUT), self.positions, strict=True)
            self.registers.values.update(positions)
            self._send(self._name() + bytes([READ, register]) + self.registers.raw(register))
        elif what == WRITE and len(raw) == 4:
            mode = self.registers.number(r.MODE)
            holds = self.registers.write(register, raw)
            if self.registers.number(r.MODE) != mode:
                self.command = Command()
            self._act()
            self.due = 0.0
            self._send(self._name() + bytes([WRITE, register]) + holds)
        elif what == SAVE and self.status != ENABLED:
            self._saved = dict(self.registers.values)
            self._send(self._name() + bytes([SAVE, 1]))
        elif what == REFRESH:
            self._answer()

    def _name(self) -> bytes:
        return self.can_id.to_bytes(2, "little")

    def _answer(self) -> None:
        self._wired.sample()
        torque = self._current * self.registers.torque_constant
        measured = (self.positions[0], self._velocity, torque)
        ranges = self.registers.ranges
        self._send(frames.feedback(self.can_id, self.status, measured, ranges, self.degC))

    def _send(self, data: bytes) -> None:
        self._wired.send(self.registers.number(r.MASTER_ID), data)

    def _act(self) -> None:
        """Have the motor do what the last command asks for, by the registers of now."""
        if self.status != ENABLED:
            return
        v, c, joint, sign = self.registers.values, self.command, self._joint, self.make.motor_sign
        gear, mode, per_ampere = v[20], int(v[r.MODE]), self.registers.torque_constant
        full = MODELS[self.make.model].max_current_A
        share = c.share if mode == r.HYBRID else v[r.OVER_CURRENT]
        highest = min(share * full, self._about.max_current_A)
        goal = sign * (c.position - self._zero_motor - self._turns)
        if mode == r.MIT:
            self._servo.release(joint)
            self._laws.scale(joint, 1.0 / per_ampere, highest)
            self._laws.impede(joint, goal, sign * c.velocity, c.kp, c.kd, sign * c.torque)
            return
        self._laws.release(joint)
        if not self._servo.energised(joint):
            self._servo.energise(joint, 0.0)
        self._servo.limit(joint, highest)
        # The observer adds its bandwidth to the gain, by the inertia that it believes in.
        believed = OBSERVER * v[12] * gear * gear / per_ampere
        kp = v[r.KP_ASR] * full * gear
        self._servo.tune(joint, kp + believed, OBSERVER * kp + v[r.KI_ASR] * full * gear)
        per_period = 1.0 / (SERVO_PERIOD_S * gear)
        rise, fall = v[r.ACC] * per_period, -v[r.DEC] * per_period
        fastest = v[r.MAX_SPEED] / gear
        speed = sign * min(max(c.velocity, -fastest), fastest) if mode == r.VELOCITY else 0.0
        self._servo.slew(joint, speed, *((rise, fall) if sign > 0 else (fall, rise)))
        if mode != r.VELOCITY:
            self._laws.head(joint, goal, v[r.KP_APR] / gear, c.velocity)

    def measure(self, link: int, motor: int, velocity: int, current: int) -> None:
        """Take the counts that the sensors have sampled."""
        if not self.frozen:
            self._output, self._motor = TURN * link / ENCODER_COUNTS, self._per_count * motor
        self._velocity, self._current = velocity * self._per_velocity, current * self._per_effort

    @property
    def positions(self) -> tuple[float, float]:
        """Positions of rotor, through the gear, and output as the motor knows them [rad]."""
        turns = self._turns
        return self._motor + self._zero_motor + turns, self._output + self._zero_output + turns
