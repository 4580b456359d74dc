"""One CiA 402 drive as a CANopen node: NMT, SDO, heartbeats, EMCY, and its way of stopping."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from canopen.sdo import SdoServer
from canopen.sdo.exceptions import SdoAbortedError

from simulator import objects as o
from simulator.description import ArmDescription
from simulator.objects import Objects, key
from simulator.pdo import PDOS, ReceivePdo, TransmitPdo, guard_pdos, pdo_number
from simulator.plant import Plant
from simulator.profile import PROFILE
from simulator.servo import Servo
from simulator.state_machine import HOLDING_OPTIONS, Event, State, on_controlword, step

HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT = 0x8210
COMMUNICATION_ERROR = 0x11
GENERIC_ERROR = 0x01
CSV = 9
VOLTAGE_PRESENT, REMOTE, LIMIT_ACTIVE, FOLLOWS = 1 << 4, 1 << 9, 1 << 11, 1 << 12

CONTROLWORD, STATUSWORD = key(0x6040), key(0x6041)
MODE, MODE_DISPLAY, TARGET_VELOCITY = key(0x6060), key(0x6061), key(0x60FF)
ERROR_REGISTER, ERROR_CODE = key(0x1001), key(0x603F)
ALLOWED = {0x605A: {0, 2, 6}, 0x605E: {0, 2}, 0x6060: {0, CSV}, 0x1005: {0x80}}
"""Values that this drive supports where the EDS can only give a range."""


class Nmt(IntEnum):
    """NMT states; the value is what the heartbeat carries."""

    BOOT = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a drive is wired to. `send(cob_id, data)` puts a frame on the bus."""

    description: ArmDescription
    servo: Servo
    plant: Plant
    send: Callable[[int, bytes], None]
    tell: Callable[[str], None]


class Drive:
    """Frames in, frames out, and single entries of the servo. Time is an argument [s]."""

    def __init__(self, joint: int, wired: Surroundings) -> None:
        self.joint, self._wired = joint, wired
        about = wired.description.joints[joint]
        self.node, self._about = about.node, about
        self.unit = PROFILE.velocity_unit / about.gear
        """One count of 606C and 60FF at the link side [rad/s]."""
        self.objects = Objects(wired.description.eds, self.node)
        rated = round(about.rated_current_A / PROFILE.rated_current_unit)
        peak = round(about.max_current_A / about.rated_current_A / PROFILE.current_unit)
        self.objects.set_default(key(0x6075), rated)
        for index in (0x6072, 0x6073):
            self.objects.set_default(key(index), peak)
        self.objects.set_default(key(0x1018, 4), wired.description.serial_number + joint)
        for index in (*ALLOWED, 0x1003, 0x1016, 0x6072, 0x6073):
            self.objects.guards[index] = self._guard(index, peak)
        guard_pdos(self.objects)
        self.objects.written = self._on_write
        self._sdo = _sdo_server(self)
        self.receive_pdos = [ReceivePdo(self.objects, n) for n in range(PDOS)]
        self.transmit_pdos = [TransmitPdo(self.objects, n) for n in range(PDOS)]
        self.nmt = Nmt.BOOT
        self.state = State.NOT_READY_TO_SWITCH_ON
        self.why = ""
        """The last reason for stopping or faulting, for people."""
        self._stopping = False
        self._controlword = 0
        self._errors: deque[int] = deque(maxlen=8)
        self._heard_at: float | None = None
        self._next_heartbeat = 0.0

    # -- life ------------------------------------------------------------------------------------

    def boot(self) -> None:
        """Power-up or NMT reset node: defaults everywhere, limp, boot-up message."""
        self.objects.restore(0x1000, 0x9FFF)
        self.state, self._controlword = State.NOT_READY_TO_SWITCH_ON, 0
        self._errors.clear()
        self._enter(step(self.state, Event.INITIALISED))
        self._configure_all()
        self._boot_up()

    def _reset_communication(self) -> None:
        self._connection_lost("NMT reset communication")
        self.objects.restore(0x1000, 0x1FFF)
        self._configure_all()
        self._boot_up()

    def _boot_up(self) -> None:
        self._heard_at = None
        self.nmt = Nmt.PRE_OPERATIONAL
        self._wired.send(0x700 + self.node, bytes([Nmt.BOOT]))

    def on_nmt(self, command: int) -> None:
        """An NMT command for this node or for all."""
        if command == 1:
            self.nmt = Nmt.OPERATIONAL
        elif command == 2:
            self._connection_lost("NMT stop")
            self.nmt = Nmt.STOPPED
        elif command == 128:
            self.nmt = Nmt.PRE_OPERATIONAL
        elif command == 129:
            self.boot()
        elif command == 130:
            self._reset_communication()
        if command in (1, 128):
            for pdo in self.transmit_pdos:
                pdo.reload()

    # -- what comes in ---------------------------------------------------------------------------

    def on_sdo(self, data: bytes) -> None:
        """A request to this node's SDO server; answered before this returns."""
        if self.nmt is not Nmt.STOPPED and len(data) == 8:
            self.show_state()
            self._sdo.on_request(self._sdo.rx_cobid, data, 0.0)

    def on_heartbeat(self, node: int, now: float) -> None:
        """Somebody's heartbeat: the watch starts with the first one of the node in 1016."""
        watched = self.objects.number(0x1016, 1)
        if watched >> 16 != node or not watched & 0xFFFF:
            return
        self._heard_at = now
        if self.objects.number(0x603F) == HEARTBEAT_LOST and self.state is not State.FAULT:
            self._clear_error()

    def on_pdo(self, cob_id: int, data: bytes) -> None:
        """A frame that may be one of this drive's RPDOs."""
        if self.nmt is not Nmt.OPERATIONAL:
            return
        for pdo in self.receive_pdos:
            if pdo.cob_id == cob_id:
                if len(data) < pdo.length:
                    self._emergency(PDO_TOO_SHORT, COMMUNICATION_ERROR)
                else:
                    pdo.receive(data, self._apply)

    def transmit(self) -> None:
        """SYNC, first half: send what was sampled."""
        if self.nmt is Nmt.OPERATIONAL:
            self.show_state()
            for pdo in self.transmit_pdos:
                data = pdo.on_sync()
                if data is not None:
                    self._wired.send(pdo.cob_id, data)

    def latch(self) -> None:
        """SYNC, second half: act on the RPDOs that came since the last one."""
        if self.nmt is Nmt.OPERATIONAL:
            for pdo in self.receive_pdos:
                pdo.latch(self._apply)

    @property
    def talks_by_itself(self) -> bool:
        """Whether a TPDO is sent without a SYNC."""
        return self.nmt is Nmt.OPERATIONAL and any(p.by_event for p in self.transmit_pdos)

    def tick(self, now: float) -> None:
        """Every millisecond: ramps that end, heartbeats due, TPDOs on change."""
        if self._stopping:
            self._stop_further()
        period = self.objects.number(0x1017)
        if period and now >= self._next_heartbeat:
            self._next_heartbeat = max(self._next_heartbeat, now) + 1e-3 * period
            self._wired.send(0x700 + self.node, bytes([self.nmt]))
        if self._heard_at is not None:
            limit_ms = self.objects.number(0x1016, 1) & 0xFFFF
            if limit_ms and now - self._heard_at > 1e-3 * limit_ms:
                self._heard_at = None
                self._lose_master()
        if self.talks_by_itself:
            self.show_state()
            for pdo in self.transmit_pdos:
                data = pdo.on_time(now) if pdo.by_event else None
                if data is not None:
                    self._wired.send(pdo.cob_id, data)

    # -- objects ---------------------------------------------------------------------------------

    def measure(self, link: int, motor: int, velocity: int, current: int) -> None:
        """Counts that the sensors have sampled."""
        values = self.objects.values
        values[key(0x60E4, 1)], values[key(0x6064)] = link, motor
        values[key(0x606C)], values[key(0x6078)], values[key(0x6077)] = velocity, current, current

    def show_state(self) -> None:
        """Bring 6041 up to date."""
        word = self.state.value | VOLTAGE_PRESENT
        if self.nmt is Nmt.OPERATIONAL:
            word |= REMOTE
        if self.state is State.OPERATION_ENABLED:
            if self.objects.values[MODE] == CSV:
                word |= FOLLOWS
            if self._wired.servo.saturated(self.joint):
                word |= LIMIT_ACTIVE
        self.objects.values[STATUSWORD] = word

    def _guard(self, index: int, peak: int) -> o.Guard:
        def guard(subindex: int, value: int) -> None:
            refused = (
                (index in ALLOWED and value not in ALLOWED[index])
                or (index == 0x1003 and value != 0)
                or (index == 0x1016 and bool(value & 0xFFFF) and not 1 <= value >> 16 <= 127)
            )
            if refused:
                raise SdoAbortedError(o.INVALID_VALUE)
            if index in (0x6072, 0x6073) and value > peak:
                raise SdoAbortedError(o.TOO_HIGH)

        return guard

    def _on_write(self, where: int) -> None:
        """An object was written, by SDO or by RPDO: let it take effect."""
        index = where >> 8
        number = pdo_number(where)
        if number is not None:
            pdos = self.receive_pdos if index < 0x1800 else self.transmit_pdos
            pdos[number].reload()  # type: ignore[attr-defined]
        elif where == CONTROLWORD:
            self._on_controlword()
        elif where in (MODE, TARGET_VELOCITY):
            self.objects.values[MODE_DISPLAY] = self.objects.values[MODE]
            self._follow()
        elif index in (0x6072, 0x6073):
            share = min(self.objects.number(0x6072), self.objects.number(0x6073))
            limit = share * PROFILE.current_unit * self._about.rated_current_A
            self._wired.servo.current_limit[self.joint] = limit
        elif index == 0x1016:
            self._heard_at = None
        elif index == 0x1003:
            self._errors.clear()
            self._show_errors()

    def _configure_all(self) -> None:
        for pdo in (*self.receive_pdos, *self.transmit_pdos):
            pdo.reload()
        self._on_write(key(0x6073))

    def _apply(self, keys: tuple[int, ...], values: tuple[int, ...]) -> None:
        """Values of an RPDO: what is out of range is left alone, as there is nobody to tell."""
        for where, value in zip(keys, values, strict=True):
            entry = self.objects.entries[where]
            low, high = entry.low, entry.high
            if (low is None or value >= low) and (high is None or value <= high):
                self.objects.values[where] = value
                self._on_write(where)

    # -- power state machine ---------------------------------------------------------------------

    def _on_controlword(self) -> None:
        previous, self._controlword = self._controlword, self.objects.number(0x6040)
        option = self.objects.number(0x605A)
        after = on_controlword(self.state, previous, self._controlword, option)
        if self.state is State.FAULT and after is not State.FAULT:
            self._clear_error()
        if after is not self.state:
            self._enter(after)

    def _enter(self, state: State) -> None:
        servo, joint = self._wired.servo, self.joint
        before, self.state = self.state, state
        self._stopping = False
        if state is State.OPERATION_ENABLED:
            if not servo.energised(joint):
                servo.energise(joint, float(self._wired.plant.theta_dot[joint]))
            self._brake()
            self._follow()
        elif state in (State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE):
            option = self.objects.number(0x605A if state is State.QUICK_STOP_ACTIVE else 0x605E)
            deceleration = self.objects.number(0x6085) * self.unit
            servo.ramp(joint, 0.0, deceleration if option else float("inf"))
            self._stopping = True
            if option == 0 or before is State.NOT_READY_TO_SWITCH_ON or not servo.energised(joint):
                servo.release(joint)
                self._stop_further()
        else:
            servo.release(joint)
            self._brake()

    def _stop_further(self) -> None:
        """The ramp of a quick stop or fault reaction may be over."""
        servo, joint = self._wired.servo, self.joint
        energised = servo.energised(joint)
        if energised and not servo.arrived(joint):
            return
        self._stopping = False
        if self.state is State.FAULT_REACTION_ACTIVE:
            self._enter(step(self.state, Event.REACTION_DONE))
        elif self.state is State.QUICK_STOP_ACTIVE:
            if not energised:
                self._enter(step(self.state, Event.DISABLE_VOLTAGE))
            elif self.objects.number(0x605A) in HOLDING_OPTIONS:
                self._tell("standing, holding")
            else:
                self._enter(step(self.state, Event.QUICK_STOP_DONE, self.objects.number(0x605A)))

    def _follow(self) -> None:
        """Head for 60FF over the interpolation period of 60C2."""
        if self.state is State.OPERATION_ENABLED and self.objects.values[MODE] == CSV:
            fastest = self.objects.number(0x6080) * PROFILE.speed_unit / self._about.gear
            velocity = self.objects.number(0x60FF) * self.unit
            velocity = min(max(velocity, -fastest), fastest)
            period = self.objects.number(0x60C2, 1) * 10.0 ** self.objects.number(0x60C2, 2)
            self._wired.servo.follow(self.joint, velocity, period)

    def _brake(self) -> None:
        if self._about.brake:
            closed = not self._wired.servo.energised(self.joint)
            self._wired.plant.brake(self.joint, closed)

    # -- errors ----------------------------------------------------------------------------------

    def fault(self, code: int, reason: str) -> None:
        """Something broke: EMCY with `code`, fault reaction by 605E."""
        self._tell(reason)
        self._emergency(code, GENERIC_ERROR)
        self._enter(step(self.state, Event.FAULT_DETECTED))

    def _lose_master(self) -> None:
        self._emergency(HEARTBEAT_LOST, COMMUNICATION_ERROR)
        self._connection_lost("heartbeat of the master lost")
        behaviour = self.objects.number(0x1029, 1)
        if behaviour == 2:
            self.nmt = Nmt.STOPPED
        elif behaviour == 0 and self.nmt is Nmt.OPERATIONAL:
            self.nmt = Nmt.PRE_OPERATIONAL

    def _connection_lost(self, reason: str) -> None:
        """Act by 6007, if the drive is enabled; tells why."""
        if self.state is not State.OPERATION_ENABLED:
            return
        option = self.objects.number(0x6007)
        words = ("no action, going on", "fault", "voltage disabled", "quick stop")[option]
        self._tell(f"{reason}, {words}")
        event = (None, Event.FAULT_DETECTED, Event.DISABLE_VOLTAGE, Event.QUICK_STOP)[option]
        if event is not None:
            self._enter(step(self.state, event))

    def _emergency(self, code: int, register: int) -> None:
        values = self.objects.values
        values[ERROR_REGISTER], values[ERROR_CODE] = register, code
        self._errors.appendleft(code)
        self._show_errors()
        self._send_emergency(code, register)

    def _clear_error(self) -> None:
        values = self.objects.values
        values[ERROR_REGISTER] = values[ERROR_CODE] = 0
        self._send_emergency(0, 0)

    def _send_emergency(self, code: int, register: int) -> None:
        if self.nmt is not Nmt.STOPPED:
            self._wired.send(
                0x80 + self.node, code.to_bytes(2, "little") + bytes([register, *[0] * 5])
            )

    def _show_errors(self) -> None:
        values = self.objects.values
        values[key(0x1003, 0)] = len(self._errors)
        for sub in range(1, 9):
            values[key(0x1003, sub)] = self._errors[sub - 1] if sub <= len(self._errors) else 0

    def _tell(self, reason: str) -> None:
        self.why = reason
        self._wired.tell(f"node {self.node}: {reason}")


class _Wire:
    """What canopen's SDO server believes to be a network and a node."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self.object_dictionary: Any = None

    def send_message(self, cob_id: int, data: bytes) -> None:
        self._drive._wired.send(cob_id, bytes(data))

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        return self._drive.objects.read(index, subindex)

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        self._drive.objects.write(index, subindex, bytes(data))


def _sdo_server(drive: Drive) -> Any:
    """canopen's SDO server is driven frame by frame and needs no thread."""
    wire = _Wire(drive)
    server = SdoServer(0x600 + drive.node, 0x580 + drive.node, wire)
    server.network = wire
    # A segment or an abort without a transfer would otherwise meet None.
    server._index = server._subindex = 0
    server._buffer = bytearray()
    return server
