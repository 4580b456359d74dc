"""The arm from above: every tick SYNC out, samples in, setpoints out; one thread owns the bus.

No lock, no thread, no SDO, no log line. Time is an argument; the `clock` only tells `collect` how
much of its deadline is left. What happens beside the samples comes back as events; nothing that
arrives, and no failure of the bus, is an exception.
"""

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import can
import numpy as np

from drivers.bus import BUS_FAILURES
from drivers.cia402 import QUICK_STOP, DriveState, PowerTarget, controlword, drive_state
from drivers.codec import Joint, SampleDecoder, SetpointEncoder, Vector, receive_pdos
from drivers.events import (
    BadSetpoint,
    Emergency,
    Event,
    ForeignMaster,
    LateAnswer,
    NotOperational,
    bus_failure,
    error_frame,
)
from drivers.frame_ring import FrameRing, RecordedWire
from drivers.heartbeat import OPERATIONAL, PATIENCE, HeartbeatWatch
from drivers.samples import Samples
from drivers.settings import DriveProfile
from drivers.wire import ERROR, Frame, Wire, open_wire

NMT: Final = 0x000
SYNC: Final = 0x080
EMERGENCY: Final = 0x080
HEARTBEAT: Final = 0x700

#: Kind of emergency codes after which some drives take a reset only when set up again.
COMMUNICATION_ERROR: Final = 0x8100

SYNC_FRAME: Final[Frame] = (SYNC, b"")

START_NODE: Final = 1
STOP_NODE: Final = 2
ENTER_PRE_OPERATIONAL: Final = 128

#: Bounds of one tick: a flooded bus must not hold the loop, nor its memory.
FRAMES_PER_PASS: Final = 512
EVENTS_PER_TICK: Final = 32


@dataclass(slots=True)
class Counters:
    """How often what ought not to happen did."""

    unknown_frames: int = 0
    short_frames: int = 0
    late_frames: int = 0
    missing_frames: int = 0
    error_frames: int = 0
    send_errors: int = 0
    dropped_events: int = 0


@dataclass(frozen=True, slots=True)
class _Setpoint:
    """One RPDO: its data, written over and over, and which of (controlword, counts) it carries."""

    cob_id: int
    data: bytearray
    layout: struct.Struct
    picks: tuple[int, ...]


@dataclass(slots=True)
class _Drive:
    watch: HeartbeatWatch
    setpoints: tuple[_Setpoint, ...]
    controlword: int = 0
    emergency: int = 0  # code of the last one, 0 when it is over


class Arm:
    """All drives of an arm on one bus.

    A tick is `sync(now)`, `collect(deadline)`, `command(...)`. Before the first come `boot_up`
    (SDO) and `start(now)`; `end()` comes after the last.
    """

    def __init__(
        self,
        bus: can.BusABC,
        joints: Sequence[Joint],
        profiles: Mapping[str, DriveProfile],
        period_s: float,
        clock: Callable[[], float],
        master_node: int = 127,
        ring: FrameRing | None = None,
    ) -> None:
        """`ring` keeps the frames of both directions. Raises ConfigurationError if a PDO layout
        does not fit."""
        self.names = tuple(name for name, _ in joints)
        self.nodes = tuple(wiring.node for _, wiring in joints)
        self.counters = Counters()
        wire = open_wire(bus)
        self._wire: Wire = RecordedWire(wire, ring) if ring else wire
        self._clock = clock
        self._decoder = SampleDecoder(joints, profiles)
        self._encoder = SetpointEncoder(joints, profiles)
        self._drives = [_drive(wiring.node, profiles[wiring.profile]) for _, wiring in joints]
        self._watches = {drive.watch.node: drive.watch for drive in self._drives}
        self._by_node = {drive.watch.node: drive for drive in self._drives}
        # Which TPDOs are still awaited is one integer, a bit for each of them.
        self._tpdos = {
            cob_id: (1 << bit, start, stop, layout)
            for bit, (cob_id, (_, start, stop, layout)) in enumerate(self._decoder.slots.items())
        }
        self._joint_bits = [0] * len(joints)
        for bit, (joint, *_) in enumerate(self._decoder.slots.values()):
            self._joint_bits[joint] |= 1 << bit
        self._all = (1 << len(self._tpdos)) - 1
        self._missing = 0
        # TPDOs that had come when the tick before this one ended: another before the next SYNC
        # says that the first was old.
        self._answered = 0
        self._backlog = False
        self._all_fresh = False
        self._heartbeat: Frame = (HEARTBEAT + master_node, bytes([OPERATIONAL]))
        # All setpoints of a tick; their data is written anew by every command.
        self._setpoints = [
            (setpoint.cob_id, setpoint.data)
            for drive in self._drives
            for setpoint in drive.setpoints
        ]
        # Ready beforehand, so that nothing that breaks can be in their way.
        self._quick_stops = [
            *_quick_stops(self._drives, self._encoder.standstill),
            SYNC_FRAME,
        ]
        setpoint_ids = {cob_id for cob_id, _ in self._setpoints}
        self._masters_own = {NMT, SYNC, HEARTBEAT + master_node} | setpoint_ids
        timeout_ms = min(profiles[wiring.profile].master_timeout_ms for _, wiring in joints)
        # Sent when the tick after this one would be too late for a third of the drives' patience.
        self._heartbeat_every_s = max(timeout_ms / 3000.0 - period_s, 0.0)
        self._heartbeat_at = -np.inf
        self._now = 0.0
        self._events: list[Event] = []
        n = len(joints)
        self.samples = Samples(
            current=self._decoder.current,
            link_position=self._decoder.link_position,
            motor_velocity=self._decoder.motor_velocity,
            motor_position=self._decoder.motor_position,
            fresh=np.zeros(n, dtype=np.bool_),
            age_ticks=np.zeros(n, dtype=np.int64),
            states=[DriveState.UNKNOWN] * n,
            statuswords=self._decoder.statuswords,
        )

    def start(self, now: float) -> None:
        """NMT operational for every drive: PDOs flow, heartbeats are watched from `now` on.

        Also after drives were set up again: what was queued or known of before is forgotten.
        """
        self._now = now
        self._receive_queued()
        self._events.clear()
        self._heartbeat_at = now
        self.samples.age_ticks.fill(0)
        for drive in self._drives:
            drive.watch.begin(now)
            drive.emergency = 0
        self._send([self._heartbeat, *self._nmt(START_NODE)])

    def unfit(self) -> list[int]:
        """Joints whose drives must be set up again before a reset can help: silent, restarted, no
        longer operational, or in fault with an error of communication (0x81xx, CiA 301)."""
        return [
            i
            for i, (drive, state) in enumerate(zip(self._drives, self.samples.states, strict=True))
            if drive.watch.forgot
            or drive.watch.lost
            or (state is DriveState.FAULT and drive.emergency & 0xFF00 == COMMUNICATION_ERROR)
        ]

    def sync(self, now: float) -> None:
        """Begin a tick: read what came since the last, beat if it is time, then send SYNC."""
        self._now = now
        # A TPDO that is here before its SYNC is a late answer to the one before.
        self._missing = 0
        self._backlog = not self._receive_queued()
        self._answered = 0
        for watch in self._watches.values():
            self._tell(watch.check(now))
        self._missing = self._all
        if now - self._heartbeat_at >= self._heartbeat_every_s:
            self._heartbeat_at = now
            self._send([self._heartbeat, SYNC_FRAME])
        else:
            self._send([SYNC_FRAME])

    def collect(self, deadline: float) -> Samples:
        """Read until every TPDO of this SYNC is in, or `deadline` on the arm's clock has passed.

        Frames that are queued already are read even when it has. After a SYNC before which not
        all could be read (the bus has come back, somebody floods it), nothing counts as its answer.
        """
        frames_left = FRAMES_PER_PASS
        if self._backlog:
            self._missing = 0
            self._receive_queued()
            self._missing, frames_left = self._all, 0
        try:
            while self._missing and frames_left:
                frame = self._wire.receive(max(deadline - self._clock(), 0.0))
                if frame is None:
                    break
                self._take(*frame)
                frames_left -= 1
        except BUS_FAILURES as error:
            self._tell(bus_failure("receiving", error))
        self._answered = self._all & ~self._missing
        self.counters.missing_frames += self._missing.bit_count()
        return self._publish()

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
    ) -> None:
        """Send every drive its next controlword towards `power` and its target velocity.

        velocity: (n,) rad/s at the link. A drive that is not in operation, or not wanted there,
        gets zero. A velocity that is not finite stops all drives and is an event.
        """
        standstill = self._encoder.standstill
        try:
            counts = self._encoder.encode(velocity)
        except ValueError as error:
            self._tell(BadSetpoint(str(error)))
            counts, power = standstill, PowerTarget.QUICK_STOP
        targets = [power] * len(self._drives) if isinstance(power, PowerTarget) else power
        states = self.samples.states
        for i, drive in enumerate(self._drives):
            target = targets[i]
            moves = target is PowerTarget.ON and states[i] is DriveState.OPERATION_ENABLED
            drive.controlword = controlword(states[i], target, drive.controlword, reset)
            values = (drive.controlword, counts[i] if moves else standstill[i])
            for setpoint in drive.setpoints:
                chosen = [values[pick] for pick in setpoint.picks]
                setpoint.layout.pack_into(setpoint.data, 0, *chosen)
        self._send(self._setpoints)

    def quick_stop(self) -> None:
        """Tell all drives to quick-stop and hold, now, whatever else is broken or unknown."""
        self._send(self._quick_stops)

    def end(self) -> None:
        """Take leave: drives pre-operational, so that no late setpoint acts; heartbeat last.

        The drives notice the silence after that and stop by themselves (0x6007), which asks
        nothing more of one that is off or holds in quick stop.
        """
        self._send([*self._nmt(ENTER_PRE_OPERATIONAL), self._heartbeat])

    def forgetful(self) -> tuple[str, ...]:
        """Joints whose drives restarted and have not been set up again since."""
        return tuple(
            name for name, drive in zip(self.names, self._drives, strict=True) if drive.watch.forgot
        )

    def unheard(self) -> tuple[str, ...]:
        """Joints whose drive sends no heartbeat, or one that says it is not operational."""
        return tuple(
            name
            for name, drive in zip(self.names, self._drives, strict=True)
            if drive.watch.lost or not drive.watch.operational
        )

    def _nmt(self, command: int) -> list[Frame]:
        return [(NMT, bytes([command, node])) for node in self.nodes]

    def _send(self, frames: Sequence[Frame]) -> None:
        try:
            self._wire.send(frames)
        except BUS_FAILURES as error:
            self.counters.send_errors += 1
            self._tell(bus_failure("sending", error))

    def _receive_queued(self) -> bool:
        """Read what is there; False if there was more than a pass reads."""
        try:
            for _ in range(FRAMES_PER_PASS):
                frame = self._wire.receive(0.0)
                if frame is None:
                    return True
                self._take(*frame)
        except BUS_FAILURES as error:
            self._tell(bus_failure("receiving", error))
            return True
        return False

    def _take(self, can_id: int, data: bytes | bytearray) -> None:
        slot = self._tpdos.get(can_id)
        if slot is None:
            self._take_other(can_id, data)
            return
        bit, start, stop, layout = slot
        if len(data) < layout.size:
            self.counters.short_frames += 1
            return
        self._decoder.raw[start:stop] = layout.unpack_from(data)
        if self._missing & bit:
            self._missing ^= bit
        else:
            self.counters.late_frames += 1
            if self._answered & bit:
                self._tell(LateAnswer(can_id & 0x7F))

    def _take_other(self, can_id: int, data: bytes | bytearray) -> None:
        watch = self._watches.get(can_id & 0x7F)
        service = can_id & ~0x7F  # 11-bit identifiers only: a flag makes it another number
        if can_id & ERROR:
            self.counters.error_frames += 1
            self._tell(error_frame(can_id & ~ERROR, data))
        elif can_id in self._masters_own:
            self._tell(ForeignMaster(can_id))
        elif watch is None or service not in (HEARTBEAT, EMERGENCY):
            self.counters.unknown_frames += 1
        elif len(data) < (1 if service == HEARTBEAT else 3):
            self.counters.short_frames += 1
        elif service == HEARTBEAT:
            event = watch.hear(data[0], self._now)
            if isinstance(event, NotOperational):
                # It hears no setpoint any more, not even that of a quick stop, and may go on for
                # ever at its last velocity, as our heartbeat tells it that all is well. NMT stop
                # counts as a loss of the connection, at which it stops by itself (0x6007).
                self._send([(NMT, bytes([STOP_NODE, watch.node]))])
            self._tell(event)
        else:
            code = data[0] | data[1] << 8
            self._by_node[watch.node].emergency = code
            self._tell(Emergency(watch.node, code, data[2]))

    def _publish(self) -> Samples:
        samples, missing = self.samples, self._missing
        self._decoder.decode()
        if missing:
            for i, bits in enumerate(self._joint_bits):
                samples.fresh[i] = not missing & bits
            np.add(samples.age_ticks, 1, out=samples.age_ticks)
            samples.age_ticks[samples.fresh] = 0
        elif not self._all_fresh:
            samples.fresh.fill(True)
            samples.age_ticks.fill(0)
        self._all_fresh = not missing
        samples.states[:] = map(drive_state, samples.statuswords)
        samples.events = tuple(self._events)
        self._events.clear()
        return samples

    def _tell(self, event: Event | None) -> None:
        """Keep an event for the next samples, once, within bounds."""
        if event is None or event in self._events:
            return
        if len(self._events) < EVENTS_PER_TICK:
            self._events.append(event)
        else:
            self.counters.dropped_events += 1


def _drive(node: int, profile: DriveProfile) -> _Drive:
    setpoints = []
    for pdo in receive_pdos(profile, node):
        picks = tuple(0 if part.entry == "controlword" else 1 for part in pdo.fields)
        setpoints.append(_Setpoint(pdo.cob_id, bytearray(pdo.layout.size), pdo.layout, picks))
    watch = HeartbeatWatch(node, PATIENCE * profile.heartbeat_ms / 1000.0)
    return _Drive(watch, tuple(setpoints))


def _quick_stops(drives: Sequence[_Drive], standstill: Sequence[int]) -> list[Frame]:
    """The setpoints that stop each drive in any state: quick stop, target velocity zero."""
    return [
        (rpdo.cob_id, rpdo.layout.pack(*((QUICK_STOP, counts)[pick] for pick in rpdo.picks)))
        for drive, counts in zip(drives, standstill, strict=True)
        for rpdo in drive.setpoints
    ]
