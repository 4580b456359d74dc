"""One Damiao motor on the bus: it answers each command and register request; there is no heartbeat
and no SYNC."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf, isfinite
from types import MappingProxyType

from simulator.damiao import frames
from simulator.damiao import registers as r
from simulator.damiao.models import FILTER_MS, MODELS, DamiaoMake
from simulator.motor import Command, Motor
from simulator.profile import TURN
from simulator.servo import SERVO_PERIOD_S
from simulator.surroundings import Surroundings

REGISTERS_ID = 0x7FF
READ, WRITE, SAVE, REFRESH = 0x33, 0x55, 0xAA, 0xCC
DISABLED, ENABLED = 0, 1
OVER_VOLTAGE, UNDER_VOLTAGE, OVER_CURRENT, MOS_HOT, ROTOR_HOT, LOST, OVERLOAD = range(8, 15)
TICK_S = 50e-6
"""Unit of the timeout [s]."""
OBSERVER = 600.0
"""Bandwidth of the velocity loop's disturbance observer [1/s], which makes it a PI loop."""
_SPECIAL = b"\xff" * 7

_DECODERS: Mapping[int, Callable[[bytes, frames.Ranges], Command | None]] = MappingProxyType(
    {
        r.MIT: frames.impedance, r.POSITION: frames.position_velocity,
        r.VELOCITY: frames.velocity, r.HYBRID: frames.hybrid,
    }
)  # fmt: skip
"""Decoders by mode; the frame's identifier is the motor's + 0x100 * (mode - 1)."""


class DamiaoMotor(Motor):
    """One Damiao motor, with any register values."""

    def __init__(self, joint: int, wired: Surroundings, make: DamiaoMake) -> None:
        super().__init__(joint, wired, make, FILTER_MS)
        self.make = make
        self.registers = r.Registers.of(make, wired.description.joints[joint].node)
        self._saved = dict(self.registers.values)
        self.status = DISABLED

    @property
    def can_id(self) -> int:
        """Identifier of its commands, without the offset of the mode."""
        return self.registers.number(r.CAN_ID)

    @property
    def moves(self) -> bool:
        """True while it is commanded to move."""
        asked = abs(self.command.velocity) > 0.002 * self.registers.ranges.v_max
        return self.status == ENABLED and asked

    def boot(self) -> None:
        """Power up or reset: saved registers, limp, position within one turn of the output."""
        self.registers.values = dict(self._saved)
        self._switch_off(DISABLED)
        self._wired.sample()
        self._turns = 0.0
        self._turns = -TURN * round(self.positions[1] / TURN)

    def fail(self, status: int) -> None:
        """Raise an error: the motor is limp until it is cleared and enabled again."""
        self._wired.report(f"motor {self.can_id}: error {status:X}")
        self._switch_off(status)

    def tick(self, now: float) -> None:
        """Perform due actions: the timeout, and recurring errors."""
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
        self.status = status
        self._limp()

    def _enable(self) -> None:
        if self.status == DISABLED:
            self.status = ENABLED
            self._brake(closed=False)
            self._act()

    def on_frame(self, cob_id: int, data: bytes) -> None:
        """Take a frame from the bus: only the low byte of the identifier is evaluated."""
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
            self._zero()
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
        """Execute the last command with the present registers."""
        if self.status != ENABLED:
            return
        v, c, joint, sign = self.registers.values, self.command, self._joint, self.make.motor_sign
        gear, mode, per_ampere = v[20], int(v[r.MODE]), self.registers.torque_constant
        full = MODELS[self.make.model].max_current_A
        share = c.share if mode == r.HYBRID else v[r.OVER_CURRENT]
        if mode == r.MIT:
            self._set_impedance(per_ampere, share * full)
            return
        self._laws.release(joint)
        if not self._servo.energised(joint):
            self._servo.energise(joint, 0.0)
        self._servo.limit(joint, min(share * full, self._about.max_current_A))
        # The observer adds its bandwidth to the gain, scaled by the inertia in its register.
        believed = OBSERVER * v[12] * gear * gear / per_ampere
        kp = v[r.KP_ASR] * full * gear
        self._servo.tune(joint, kp + believed, OBSERVER * kp + v[r.KI_ASR] * full * gear)
        per_period = 1.0 / (SERVO_PERIOD_S * gear)
        rise, fall = v[r.ACC] * per_period, -v[r.DEC] * per_period
        fastest = v[r.MAX_SPEED] / gear
        speed = sign * min(max(c.velocity, -fastest), fastest) if mode == r.VELOCITY else 0.0
        self._servo.slew(joint, speed, *((rise, fall) if sign > 0 else (fall, rise)))
        if mode != r.VELOCITY:
            self._laws.head(joint, self._goal, v[r.KP_APR] / gear, c.velocity)
