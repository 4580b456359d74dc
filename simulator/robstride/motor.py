"""One RobStride motor on the bus, in operation mode: it sends a feedback for each command and each
written parameter, and an answer for each read; there is no heartbeat and no SYNC."""

import struct
from math import inf, isfinite, remainder

from simulator.motor import Command, Motor
from simulator.profile import TURN
from simulator.robstride import frames as f
from simulator.robstride.frames import Ranges, identifier
from simulator.robstride.models import FILTER_MS, MODELS, PARAMETERS, REACH, RobStrideMake
from simulator.surroundings import Surroundings

RESET, RUN = 0, 2
"""Modes in a feedback."""
UNDER_VOLTAGE, OVER_CURRENT, HOT, ENCODER, OVERLOAD, UNCALIBRATED = (1 << bit for bit in range(6))
"""Fault bits of a feedback."""
FAULT_WORDS = {
    UNDER_VOLTAGE: 1 << 2, OVER_CURRENT: 1 << 1, HOT: 1 << 0, ENCODER: 1 << 8, OVERLOAD: 1 << 14,
    UNCALIBRATED: 1 << 7,
}  # fmt: skip
"""The same faults in a frame of type 21."""
RUN_MODE, LIMIT_TORQUE, MECH_POS, IQF, MECH_VEL, VBUS, TIMEOUT, ZERO_STA = (
    0x7005, 0x700B, 0x7019, 0x701A, 0x701B, 0x701C, 0x7028, 0x7029,
)  # fmt: skip
TICK_S = 50e-6
"""Unit of the timeout [s]."""
_BYTES, _WORDS = {RUN_MODE, ZERO_STA}, {TIMEOUT}
_TAKES = {RUN_MODE: (0, 5), LIMIT_TORQUE: (0.0, 1e3), ZERO_STA: (0, 1), TIMEOUT: (0, 100_000)}
_WRITE_ONLY = {TIMEOUT, ZERO_STA}


class RobStrideMotor(Motor):
    """One RobStride motor. `keeps`: whether a command received before it runs is kept, which is not
    published. `mode` and `faults` are those of its feedback."""

    extended = True

    def __init__(self, joint: int, wired: Surroundings, make: RobStrideMake) -> None:
        super().__init__(joint, wired, make, FILTER_MS)
        model = MODELS[make.model]
        self.make, self._model = make, model
        self.can_id = wired.description.joints[joint].node
        saved = {RUN_MODE: 0, LIMIT_TORQUE: model.t_max, TIMEOUT: 0, ZERO_STA: 0}
        self._saved: dict[int, float] = saved | dict(make.parameters)
        self.parameters = dict(self._saved)
        p_max, v_max, t_max = (
            self._saved.get(PARAMETERS[name], usual)
            for name, usual in (("P_MAX", REACH), ("V_MAX", model.v_max), ("T_MAX", model.t_max))
        )
        self.ranges = Ranges(p_max, v_max, t_max, model.kp_max, model.kd_max)
        self.mode, self.faults, self.keeps = RESET, 0, False
        self._host = 0  # address to which it answers

    @property
    def status(self) -> int:
        """Mode and, in the lower bits, faults, as in a feedback's identifier."""
        return self.mode << 6 | self.faults

    @property
    def moves(self) -> bool:
        """True while it is commanded to move."""
        return self.mode == RUN and abs(self.command.velocity) > 0.002 * self.ranges.v_max

    def boot(self) -> None:
        """Power up or reset: saved parameters, limp, position within one turn of the output, from 0
        or about 0 by ZERO_STA; it sends its ID."""
        self.parameters = dict(self._saved)
        self.mode = RESET
        self._limp()
        self._wired.sample()
        self._turns = 0.0
        here, about_0 = self.positions[0], self.parameters[ZERO_STA] == 1
        wanted = remainder(here, TURN) if about_0 else here % TURN
        self._turns = wanted - here
        self._send_id()

    def fail(self, fault: int) -> None:
        """Raise a fault: the motor is limp until it is cleared and enabled again."""
        self._wired.report(f"motor {self.can_id}: fault {fault:X}")
        self.mode, self.faults = RESET, self.faults | fault
        self._limp()
        words = sum(word for bit, word in FAULT_WORDS.items() if bit & self.faults)
        self._send(identifier(f.FAULTS, self.can_id, self._host), struct.pack("<II", words, 0))

    def tick(self, now: float) -> None:
        """Perform due actions: the timeout, and recurring faults."""
        if self.trouble and not self.faults:
            self.fail(self.trouble)
        limit, self.due = self.parameters[TIMEOUT] * TICK_S, inf
        if self.mode == RUN and limit:
            if now - self._heard_at > limit:
                self._wired.report(f"motor {self.can_id}: no command for {limit:g} s")
                self.mode = RESET
                self._limp()
            else:
                self.due = self._heard_at + limit

    def on_frame(self, can_id: int, data: bytes) -> None:
        """Take a frame from the bus, if it is addressed to this motor."""
        kind, data2, address = can_id >> 24 & 0x1F, can_id >> 8 & 0xFFFF, can_id & 0xFF
        if self.silent or address != self.can_id or kind == f.FEEDBACK:
            return
        self._heard_at, self.due = self._wired.now(), 0.0
        if kind == f.CONTROL:
            self._on_control(data2, data)
            return
        self._host = data2 & 0xFF
        if kind == f.GET_ID:
            self._send_id()
        elif kind == f.READ and len(data) >= 2:
            self._on_read(int.from_bytes(data[:2], "little"))
        elif kind in (f.ENABLE, f.STOP, f.ZERO, f.WRITE, f.SAVE):
            self._on_order(kind, data)
            self._answer()

    def _on_control(self, torque: int, data: bytes) -> None:
        command = f.control(torque, data, self.ranges)
        if command is not None and (self.mode == RUN or self.keeps):
            self.command = command
            self._act()
        self._answer()

    def _on_order(self, kind: int, data: bytes) -> None:
        if kind == f.ENABLE and not self.faults and self.mode == RESET:
            self.mode = RUN
            self._brake(closed=False)
            self._act()
        elif kind == f.STOP:
            self.mode = RESET
            self.faults = 0 if data[:1] == b"\x01" else self.faults
            self._limp()
        elif kind == f.ZERO and data[:1] == b"\x01":
            self._zero()
            self.command = Command(0.0, 0.0, self.command.kp, self.command.kd)
            self._act()
        elif kind == f.WRITE and len(data) == 8:
            self._on_write(int.from_bytes(data[:2], "little"), data[4:])
        elif kind == f.SAVE and self.mode == RESET:
            self._saved = dict(self.parameters)

    def _on_write(self, index: int, raw: bytes) -> None:
        whole = int.from_bytes(raw[:1] if index in _BYTES else raw, "little")
        value = whole if index in _BYTES | _WORDS else struct.unpack("<f", raw)[0]
        low, high = _TAKES.get(index, (1.0, 0.0))
        if isfinite(value) and low <= value <= high:
            self.parameters[index] = value
            self._act()

    def _on_read(self, index: int) -> None:
        self._wired.sample()
        live = {
            MECH_POS: self.positions[0], IQF: self._current, MECH_VEL: self._velocity, VBUS: 48.0,
        }  # fmt: skip
        value = live.get(index, self.parameters.get(index))
        known = value is not None
        value = 0 if value is None or index in _WRITE_ONLY else value
        whole = index in _BYTES | _WORDS
        raw = int(value).to_bytes(4, "little") if whole else struct.pack("<f", value)
        head = index.to_bytes(4, "little")
        data2 = (0 if known else 1) << 8 | self.can_id
        self._send(identifier(f.READ, data2, self._host), head + raw)

    def _send_id(self) -> None:
        uid = self.make.uid + self.can_id
        self._send(identifier(f.GET_ID, self.can_id, f.BROADCAST), uid.to_bytes(8, "little"))

    def _answer(self) -> None:
        self._wired.sample()
        reach = self.ranges.p_max
        position = (self.positions[0] + reach) % (2.0 * reach) - reach
        measured = (position, self._velocity, self._current * self._model.torque_constant)
        data = f.feedback(measured, self.ranges, self.degC[1])
        self._send(identifier(f.FEEDBACK, self.status << 8 | self.can_id, self._host), data)

    def _send(self, can_id: int, data: bytes) -> None:
        if not self.silent:
            self._wired.send(can_id, data, extended=True)

    def _act(self) -> None:
        """Execute the last command; the motor is limp in modes other than operation mode."""
        if self.mode != RUN:
            return
        if self.parameters[RUN_MODE]:
            self._servo.release(self._joint)
            self._laws.release(self._joint)
            return
        constant = self._model.torque_constant
        highest = min(self._model.max_current_A, self.parameters[LIMIT_TORQUE] / constant)
        self._set_impedance(constant, highest)
