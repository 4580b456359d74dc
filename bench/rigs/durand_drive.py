"""A CiA 402 drive of other people's making, at the far end of a virtual bus, in lockstep.

Our driver and our simulated drives have the same authors, who may have misread the same line of a
standard twice. This drive's SDO server, PDOs, NMT, heartbeat, emergencies and EDS are durand's, and
its power states those of the table in canopen's `State402`. Ours are only the objects that it has
and a motor that follows its setpoint down and up one ramp.
"""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Final

import can
from canopen.profiles.p402 import State402
from durand import Array, MinimalNode, Record, Variable, set_scheduler
from durand import DatatypeEnum as Type
from durand.scheduler import VirtualScheduler
from durand.services.nmt import StateEnum

from bench.rigs.lines import FarEnd
from simulator.sensors import Readings

SYNC: Final = 0x080
MASTER_HEARTBEAT: Final = 0x700 + 127
SERIAL: Final = 4711
SERVO_DRIVE: Final = 0x0002_0192  # Device type of CiA 402: profile 402, a servo drive.
#: As configs/single_joint has it: gear, counts per revolution, rpm / 10, current and its constant.
GEAR: Final = 100.0
LINK_COUNT: Final = 2.0 * math.pi / 131072
MOTOR_COUNT: Final = 2.0 * math.pi / 4096
VELOCITY_UNIT: Final = 0.2 * math.pi / 60.0
RATED_CURRENT_A: Final = 2.0
TORQUE_CONSTANT: Final = 3.0
RAMP: Final = 12.0  # Highest acceleration at the link [rad/s2].

# Index: type, access, value, name. What a drive with two encoders has, as its maker would set it.
_OBJECTS: Final = {
    0x6007: (Type.INTEGER16, "rw", 1, "Abort connection option code"),
    0x603F: (Type.UNSIGNED16, "ro", 0, "Error code"),
    0x6040: (Type.UNSIGNED16, "rw", 0, "Controlword"),
    0x6041: (Type.UNSIGNED16, "ro", 0, "Statusword"),
    0x605A: (Type.INTEGER16, "rw", 2, "Quick stop option code"),
    0x605E: (Type.INTEGER16, "rw", 2, "Fault reaction option code"),
    0x6060: (Type.INTEGER8, "rw", 0, "Modes of operation"),
    0x6061: (Type.INTEGER8, "ro", 0, "Modes of operation display"),
    0x6064: (Type.INTEGER32, "ro", 0, "Position actual value"),
    0x606C: (Type.INTEGER32, "ro", 0, "Velocity actual value"),
    0x6072: (Type.UNSIGNED16, "rw", 1000, "Max torque"),
    0x6073: (Type.UNSIGNED16, "rw", 1000, "Max current"),
    0x6075: (Type.UNSIGNED32, "ro", round(1000 * RATED_CURRENT_A), "Motor rated current"),
    0x6078: (Type.INTEGER16, "ro", 0, "Current actual value"),
    0x6080: (Type.UNSIGNED32, "rw", 3000, "Max motor speed"),
    0x6085: (Type.UNSIGNED32, "rw", 1000, "Quick stop deceleration"),
    0x60FF: (Type.INTEGER32, "rw", 0, "Target velocity"),
    0x6502: (Type.UNSIGNED32, "ro", 1 << 8, "Supported drive modes"),
}
_RECORDS: Final = {
    0x60C2: ((Type.UNSIGNED8, "rw", 1, "Period"), (Type.INTEGER8, "rw", -3, "Index")),
    0x60E4: ((Type.INTEGER32, "ro", 0, "1st additional position actual value"),),
}
_STATUS: Final = {name: bits for name, (_, bits) in State402.SW_MASK.items()}
# What a controlword commands depends on these bits only (CiA 402, command coding).
_COMMANDS: Final = (
    (0x02, 0x00, State402.CW_DISABLE_VOLTAGE),
    (0x06, 0x02, State402.CW_QUICK_STOP),
    (0x07, 0x06, State402.CW_SHUTDOWN),
    (0x0F, 0x07, State402.CW_SWITCH_ON),
    (0x0F, 0x0F, State402.CW_OPERATION_ENABLED),
)


_NO_OTHER: Final = nullcontext()


class PolledBus:
    """durand's network upon a bus that is polled, without a thread."""

    def __init__(self, bus: FarEnd) -> None:
        self._bus = bus
        self.on_sync: Callable[[], None] = lambda: None  # Called before a SYNC is handled.
        self._callbacks: dict[int, Callable[[int, bytes], None]] = {}

    def forget(self) -> None:
        """Forget the set-up, like a drive whose power was off."""
        self._callbacks.clear()

    def add_subscription(self, cob_id: int, callback: Callable[[int, bytes], None]) -> None:
        self._callbacks[cob_id] = callback

    def remove_subscription(self, cob_id: int, **_: Any) -> None:
        del self._callbacks[cob_id]

    def send(self, cob_id: int, msg: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=cob_id, data=msg, is_extended_id=False))

    def hear(self, cob_id: int, data: bytes) -> None:
        """Handle one frame."""
        if callback := self._callbacks.get(cob_id):
            callback(cob_id, data)

    def pump(self, timeout: float, alone: AbstractContextManager[object]) -> None:
        """Handle all queued frames, each `alone`; waits up to `timeout` s for the first."""
        while (message := self._bus.recv(timeout)) is not None:
            with alone:
                if message.arbitration_id == SYNC:
                    self.on_sync()
                self.hear(message.arbitration_id, bytes(message.data))
            timeout = 0.0


class DurandDrive:
    """One drive; time passes in `advance`, frames are answered in `pump` or while `serving`.

    torque: what the motor gives at link position [rad] and velocity [rad/s], in Nm at the link.
    """

    def __init__(self, bus: FarEnd, node: int, torque: Callable[[float, float], float]) -> None:
        self.network, self._torque, self.number = PolledBus(bus), torque, node
        self._now_s, self._heard_s = 0.0, math.inf
        self._alone = threading.Lock()
        self.q = 0.0  # link position [rad]
        self.velocity = 0.0  # [rad/s]
        self.states: list[str] = []  # Every power state it was in, in order.
        self.sense = self.read
        """Readings of its sensors; replaced where it is to lie."""
        self.power_on()

    def power_on(self) -> None:
        """For the first time or again: a boot-up message, and nothing that was written is left."""
        self.network.forget()
        self._clock = VirtualScheduler()
        set_scheduler(self._clock)  # durand has one for all
        self._heard_s = math.inf
        self._locked = False
        self._node = MinimalNode(self.network, self.number)
        self._node.nmt.state_callbacks.add(self._unlock)
        self.objects = self._node.object_dictionary
        self._furnish()
        self.network.add_subscription(MASTER_HEARTBEAT, self._hear_master)
        self._enter("SWITCH ON DISABLED")

    @property
    def eds(self) -> str:
        """Its EDS, as durand writes it."""
        return str(self._node.eds.content)

    @property
    def state(self) -> str:
        return self.states[-1]

    def hear(self, cob_id: int, data: bytes) -> None:
        """Take a frame as if it had come over the bus."""
        set_scheduler(self._clock)
        self.network.hear(cob_id, data)

    def pump(self, timeout: float = 0.0, alone: AbstractContextManager[object] = _NO_OTHER) -> None:
        """Answer what is on the bus, frame by frame `alone`."""
        set_scheduler(self._clock)
        self.network.pump(timeout, alone)

    def let_pass(self, seconds: float) -> None:
        """While serving: let so much time pass for the drive, and not less for who waits."""
        time.sleep(seconds)
        with self._alone:
            self.advance(seconds)

    def advance(self, seconds: float) -> None:
        """Let the time of one tick pass."""
        self._now_s += seconds
        set_scheduler(self._clock)
        self._clock.run(seconds)
        watch = self.objects.read(0x1016, 1) & 0xFFFF
        if watch and self._now_s - self._heard_s > watch / 1000.0 + 1e-9:
            self.fail(0x8130)
        moving = self.state == "OPERATION ENABLED"
        counts = self.objects.read(0x60FF, 0) if moving else 0
        missing, step = counts * VELOCITY_UNIT / GEAR - self.velocity, RAMP * seconds
        self.velocity += max(-step, min(missing, step))
        self.q += self.velocity * seconds
        readings = self.sense()
        self._show(0x6078, readings.current[0])
        self._show(0x606C, readings.motor_velocity[0])
        self._show(0x6064, readings.motor_position[0])
        self._show(0x60E4, readings.link_position[0])

    def read(self) -> Readings:
        """Read its sensors."""
        current = self._torque(self.q, self.velocity) / TORQUE_CONSTANT
        powered = self.state in ("OPERATION ENABLED", "QUICK STOP ACTIVE")
        return Readings(
            link_position=[round(self.q / LINK_COUNT)],
            motor_position=[round(self.q * GEAR / MOTOR_COUNT)],
            motor_velocity=[round(self.velocity * GEAR / VELOCITY_UNIT)],
            current=[round(1000.0 * current / RATED_CURRENT_A if powered else 0.0)],
        )

    def fail(self, code: int) -> None:
        """A fault: emergency, no torque."""
        self._heard_s = math.inf
        self.objects.write(0x603F, 0, code)
        self._node.emcy.set(code, 0x01)
        self._enter("FAULT")

    def lock(self) -> None:
        """A fault of communication that no fault reset ends, though it is said to be over."""
        self.fail(0x8130)
        self._locked = True
        self._node.emcy.set(0, 0)

    def _unlock(self, state: StateEnum) -> None:
        self._locked = self._locked and state is not StateEnum.INITIALISATION

    def switch_off(self) -> None:
        """Loss of the voltage."""
        self._enter("SWITCH ON DISABLED")

    @contextmanager
    def serving(self) -> Iterator[None]:
        """A thread that pumps for as long as the block lasts, while time stands still."""
        done = threading.Event()

        def serve() -> None:
            while not done.is_set():
                self.pump(0.02, self._alone)

        thread = threading.Thread(target=serve, name="durand drive", daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
            self.pump()

    def _furnish(self) -> None:
        objects = self.objects
        objects[0x1000].value = SERVO_DRIVE
        objects[0x1018][2].value, objects[0x1018][4].value = 7, SERIAL
        watch = Variable(Type.UNSIGNED32, "rw", 0, name="Time")
        objects[0x1016] = Array(watch, 1, name="Consumer heartbeat time")
        for index, (kind, access, value, name) in _OBJECTS.items():
            objects[index] = Variable(kind, access, value, name=name)
        for index, members in _RECORDS.items():
            record = Record(name=f"Record {index:04X}")
            for sub, (kind, access, value, name) in enumerate(members, start=1):
                record[sub] = Variable(kind, access, value, name=name)
            objects[index] = record
        objects.update_callbacks[(0x6040, 0)].add(self._obey)
        objects.update_callbacks[(0x6060, 0)].add(lambda mode: objects.write(0x6061, 0, mode))

    def _obey(self, controlword: int) -> None:
        if self._locked:
            return
        if self.state == "FAULT":
            commands = [State402.CW_SWITCH_ON_DISABLED] if controlword & 0x80 else []
        else:
            commands = [c for mask, bits, c in _COMMANDS if controlword & mask == bits]
        for (before, after), command in State402.TRANSITIONTABLE.items():
            if before == self.state and command in commands:
                self._enter(after)
                return

    def _enter(self, state: str) -> None:
        self.states.append(state)
        self.objects.write(0x6041, 0, _STATUS[state])

    def _hear_master(self, _: int, __: bytes) -> None:
        self._heard_s = self._now_s

    def _show(self, index: int, value: int) -> None:
        self.objects.write(index, 1 if index in _RECORDS else 0, value)
