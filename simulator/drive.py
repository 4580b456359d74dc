"""One drive as a CANopen node: NMT, SDO, PDOs, heartbeats, EMCY, and the loss of its master."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace

from simulator.axis import CONTROLWORD, MODE, STATUSWORD, TARGET_VELOCITY, Axis
from simulator.emergency import COMMUNICATION_ERROR, HEARTBEAT_LOST, HISTORY, Emergencies
from simulator.factory_settings import factory_settings
from simulator.nmt import Nmt
from simulator.objects import key
from simulator.pdo import Pdos, pdo_number
from simulator.sdo import sdo_server
from simulator.state_machine import State, Trigger
from simulator.surroundings import Surroundings

SYNC, SYNC_ID = 0x080, key(0x1005)


class Drive:
    """One drive: frames in, frames out. Time is an argument [s]; call `tick` from `due` on."""

    def __init__(self, joint: int, wired: Surroundings) -> None:
        about = wired.description.joints[joint]
        self.node, self._wired = about.node, wired
        self.make, eds = wired.drives[joint].make, wired.drives[joint].eds
        assert eds is not None
        serial = wired.description.serial_number + joint
        self.objects = factory_settings(eds, about, serial)
        self.objects.written = self._on_write
        self._sdo = sdo_server(self.node, self.objects, wired.send)
        self.axis = Axis(joint, wired, self.objects, self._report)
        self._emergencies = Emergencies(self.objects, self._send_emergency)
        self.pdos = Pdos(self.objects, self._emergencies, self._apply, wired.send)
        self.nmt = Nmt.BOOT
        self.due = 0.0
        """Time of the next action of its own [s]."""
        self.why = ""
        """Reason for the last stop or fault, as text."""
        self._locked = self._said_over = False
        self._booting = False
        self._booted_at: float | None = None
        self._heard_at: float | None = None
        self._next_heartbeat = 0.0
        self._asked: deque[tuple[float, bytes]] = deque()
        self._unsent: deque[tuple[float, bytes]] = deque()  # delayed emergencies

    @property
    def state(self) -> State:
        """State of the power state machine."""
        return self.axis.state

    # -- network management ----------------------------------------------------------------------

    def boot(self) -> None:
        """Power up or NMT reset node: restore all defaults, go limp, send the boot-up message."""
        self.objects.restore(0x1000, 0x9FFF)
        self._emergencies.forget()
        self.axis.start()
        self._boot_up()

    def _boot_up(self) -> None:
        self.pdos.reload()
        self._heard_at, self.due, self._locked = None, 0.0, False
        self._asked.clear()
        self._unsent.clear()
        self.nmt, self._booting, self._booted_at = Nmt.BOOT, True, None
        if not self.make.boot_s:
            self._boot_end()

    def _boot_end(self) -> None:
        self.nmt, self._booting = Nmt.PRE_OPERATIONAL, False
        self._wired.send(0x700 + self.node, bytes([Nmt.BOOT]))

    def on_nmt(self, command: int) -> None:
        """Execute an NMT command for this node or for all nodes."""
        if self._booting:
            return
        self.due = 0.0
        if command == 1:
            self.nmt = Nmt.OPERATIONAL
            for pdo in self.pdos.sent:
                pdo.reload()
        elif command == 2:
            self.axis.lose_connection("NMT stop")
            self.nmt = Nmt.STOPPED
        elif command == 128:
            self.nmt = Nmt.PRE_OPERATIONAL
        elif command == 129:
            self.boot()
        elif command == 130:
            self.axis.lose_connection("NMT reset communication")
            self.objects.restore(0x1000, 0x1FFF)
            self._emergencies.show_history()
            self._boot_up()

    def on_heartbeat(self, node: int, now: float) -> None:
        """Take a node's heartbeat: monitoring starts with the first one of the node in 1016."""
        watched = self.objects.number(0x1016, 1) if self.make.hears_master else 0
        if watched >> 16 != node or not watched & 0xFFFF:
            return
        if self._heard_at is None:
            self.due = 0.0
        self._heard_at = now  # `tick` computes the new deadline when the old one is due
        if self._locked:
            if self.make.says_over and not self._said_over:
                self._said_over = True
                self._emergencies.say_over()
        elif self._emergencies.present == HEARTBEAT_LOST and self.state is not State.FAULT:
            self._emergencies.clear_error()

    def lock(self) -> None:
        """Lock as after the loss of the master; report the error over once the master is heard."""
        self.make = replace(self.make, locks=True, says_over=True)
        self._lose_master()

    def tick(self, now: float) -> None:
        """Perform due actions (ends of ramps, heartbeats, event-driven TPDOs), and update `due`."""
        if self._booting:
            if self._booted_at is None:
                self._booted_at = now + self.make.boot_s
            if now >= self._booted_at:
                self._boot_end()
            return
        if self.axis.stopping:
            self.axis.stop_further()
        self.due = min(
            _served(self._asked, now, self._answer), _served(self._unsent, now, self._put_emergency)
        )
        period = self.objects.number(0x1017)
        if period:
            if now >= self._next_heartbeat:
                self._next_heartbeat = max(self._next_heartbeat + 1e-3 * period, now)
                self._wired.send(0x700 + self.node, bytes([self.nmt]))
            self.due = min(self.due, self._next_heartbeat)
        limit_ms = self.objects.number(0x1016, 1) & 0xFFFF
        if self._heard_at is not None and limit_ms:
            if now - self._heard_at > 1e-3 * limit_ms:
                self._heard_at = None
                self._lose_master()
            else:
                self.due = min(self.due, self._heard_at + 1e-3 * limit_ms)
        if self.nmt is Nmt.OPERATIONAL and any(pdo.by_event for pdo in self.pdos.sent):
            self._wired.sample()
            self._show_state()
            self.pdos.transmit_due(now)
            self.due = now
        if self.axis.stopping:
            self.due = now

    # -- SDO and PDO -----------------------------------------------------------------------------

    def on_sdo(self, data: bytes) -> None:
        """Take a request to this node's SDO server; it is answered before this returns, unless the
        make has an SDO delay."""
        if self.nmt is Nmt.STOPPED or self._booting or len(data) != 8:
            return
        if self.make.sdo_delay_s:
            self._asked.append((self._wired.now() + self.make.sdo_delay_s, data))
            self.due = 0.0
        else:
            self._answer(data)

    @property
    def answers_at(self) -> float | None:
        """Time of the next delayed SDO answer [s]; None if there is none."""
        return self._asked[0][0] if self._asked else None

    def _answer(self, data: bytes) -> None:
        self._wired.sample()
        self._show_state()
        self._sdo.on_request(self._sdo.rx_cobid, data, 0.0)

    def on_pdo(self, cob_id: int, data: bytes) -> None:
        """Take a frame that may be one of this drive's RPDOs."""
        if self.nmt is Nmt.OPERATIONAL:
            self.pdos.receive(cob_id, data, minds_longer=self.make.minds_longer)

    @property
    def hears_sync(self) -> bool:
        """True while PDOs are enabled and the SYNC COB-ID (1005) is that of this bus."""
        return self.nmt is Nmt.OPERATIONAL and self.objects.values.get(SYNC_ID, SYNC) == SYNC

    def transmit(self) -> None:
        """First half of a SYNC: send the sampled values."""
        if self.hears_sync:
            self._show_state()
            self.pdos.transmit()

    def latch(self) -> None:
        """Second half of a SYNC: apply the RPDOs received since the last one."""
        if self.hears_sync:
            self.pdos.latch()

    # -- objects ---------------------------------------------------------------------------------

    def measure(self, link: int, motor: int, velocity: int, current: int) -> None:
        """Store the counts sampled by the sensors. Values are saturated at the range of their
        object: a joint may turn faster than a drive can report."""
        hold, profile = self.objects.hold, self.make
        hold(profile.link_position, link)
        hold(profile.motor_velocity, velocity)
        if profile.motor_position is not None:
            hold(profile.motor_position, motor)
        for effort in profile.efforts:
            hold(effort, current)

    def put(self, index: int, subindex: int, value: int) -> None:
        """Set an object from inside the drive, regardless of its guards."""
        self.objects.show(key(index, subindex), value)

    def _show_state(self) -> None:
        self.objects.values[STATUSWORD] = self.axis.statusword(self.nmt is Nmt.OPERATIONAL)

    def _on_write(self, where: int) -> None:
        """React to an object written by SDO or RPDO."""
        if where == CONTROLWORD:
            faulty = self.state is State.FAULT
            if faulty and self._locked:
                return
            self.axis.on_controlword()
            if faulty and self.state is not State.FAULT:
                self._emergencies.clear_error()
            if self.axis.stopping:
                self.due = 0.0
            return
        if where == TARGET_VELOCITY:
            self.axis.on_target()
            return
        self.due = 0.0
        number = pdo_number(where)
        if number is not None:
            self.pdos.reload(number)
        elif where == key(0x1016, 1):
            self._heard_at = None
        elif where == HISTORY:
            self._emergencies.forget()
        elif where == MODE:
            self.axis.on_mode()
        else:
            self.axis.configure()

    def _apply(self, keys: tuple[int, ...], values: tuple[int, ...]) -> None:
        """Write the values of an RPDO; values out of range are ignored, as PDOs have no answer."""
        for where, value in zip(keys, values, strict=True):
            if self.objects.accepts(where, value):
                self.objects.values[where] = value
                self._on_write(where)

    # -- errors ----------------------------------------------------------------------------------

    def fault(self, code: int, reason: str) -> None:
        """Raise a fault: EMCY with `code`, fault reaction by 605E."""
        self._report(reason)
        self._emergencies.raise_error(code)
        self.axis.happen(Trigger.FAULT_DETECTED)
        self.due = 0.0

    def _lose_master(self) -> None:
        reason = "heartbeat of the master lost"
        self._emergencies.raise_error(HEARTBEAT_LOST, COMMUNICATION_ERROR)
        if self.make.locks:
            self._report(f"{reason}, fault, locked")
            self._locked, self._said_over = True, False
            self.axis.happen(Trigger.FAULT_DETECTED)
        else:
            self.axis.lose_connection(reason)
        behaviour = self.objects.number(0x1029, 1)
        if behaviour == 2:
            self.nmt = Nmt.STOPPED
        elif behaviour == 0 and self.nmt is Nmt.OPERATIONAL:
            self.nmt = Nmt.PRE_OPERATIONAL

    def _send_emergency(self, data: bytes) -> None:
        if self.make.emergency_delay_s:
            self._unsent.append((self._wired.now() + self.make.emergency_delay_s, data))
            self.due = 0.0
        else:
            self._put_emergency(data)

    def _put_emergency(self, data: bytes) -> None:
        if self.nmt is not Nmt.STOPPED and not self._booting:
            self._wired.send(0x80 + self.node, data)

    def _report(self, reason: str) -> None:
        self.why = reason
        self._wired.report(f"node {self.node}: {reason}")


def _served(queue: deque[tuple[float, bytes]], now: float, serve: Callable[[bytes], None]) -> float:
    """Serve the entries due by `now`; returns the time of the next one [s]."""
    while queue and queue[0][0] <= now:
        serve(queue.popleft()[1])
    return queue[0][0] if queue else float("inf")
