"""The arm from above: every tick SYNC out, samples in, setpoints out; one thread owns the bus.

No lock, no thread, no SDO, no log line. Time is an argument; the `clock` only tells `collect` how
much of its deadline is left. What happens beside the samples comes back as events; nothing that
arrives, and no failure of the bus, is an exception.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from arrays import Vector
from drivers.answers import Answers, Counters, Samples
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import ERROR, Frame, Wire
from drivers.cia402 import DriveState, PowerTarget
from drivers.drive import Drive
from drivers.events import (
    COMMUNICATION_ERROR,
    PROTOCOL_ERROR,
    UNKNOWN_CODE,
    Absent,
    BadSetpoint,
    BusEvent,
    BusOff,
    Emergency,
    ForeignMaster,
    bus_failure,
    error_frame,
)
from drivers.expedited_stop import expedited_quick_stops
from drivers.heartbeat_watch import HEARTBEATS_MISSED, HeartbeatWatch
from drivers.ids import (
    EMERGENCY,
    ENTER_PRE_OPERATIONAL,
    HEARTBEAT,
    NMT,
    NODE,
    OPERATIONAL,
    SDO_ANSWER,
    START_NODE,
    SYNC,
)
from drivers.setpoints import Setpoints
from drivers.stop_stages import least_patience_s
from drivers.stops import Stops

SYNC_FRAME: Final[Frame] = (SYNC, b"")

#: Bounds of one tick: a flooded bus must not hold the loop, nor its memory.
FRAMES_PER_PASS: Final = 512
EVENTS_PER_TICK: Final = 32


@dataclass(slots=True)
class _WatchedDrive:
    watch: HeartbeatWatch
    complained: bool = False  # of communication (0x81xx), since it was set up


class Drives:
    """All drives of an arm on one bus.

    A tick is `sync(now)`, `collect(deadline)`, `command(...)`. Before the first come `boot_up`
    (SDO) and `start(now)`; `end()` comes after the last.
    """

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[Drive],
        period_s: float,
        clock: Callable[[], float],
        master_node: int = 127,
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self.names = tuple(drive.name for drive in drives)
        self.nodes = tuple(drive.node for drive in drives)
        self.counters = Counters()
        self._wire, self._clock = wire, clock
        self._answers = Answers(drives, self.counters, self._tell)
        self._setpoints = Setpoints(drives)
        self._new_stops = partial(Stops, drives, period_s)
        self._stops = self._new_stops()
        self._stops_by_sdo = expedited_quick_stops(drives)
        self._all_on = [PowerTarget.ON] * len(drives)
        self._heartbeat_timeouts_s = [
            HEARTBEATS_MISSED * (drive.profile.heartbeat_ms / 1e3) for drive in drives
        ]
        self._now = 0.0
        self._drives = [self._watched(joint) for joint in range(len(drives))]
        self._joint_of = {node: joint for joint, node in enumerate(self.nodes)}
        self._backlog = False
        self._heartbeat: Frame = (HEARTBEAT + master_node, bytes([OPERATIONAL]))
        setpoint_ids = {cob_id for cob_id, _ in self._setpoints.frames}
        self._masters_own = {NMT, SYNC, HEARTBEAT + master_node} | setpoint_ids
        patience_s = least_patience_s(drives)
        # Sent when the tick after this one would be too late for a third of the drives' patience.
        self._heartbeat_every_s = max(patience_s / 3.0 - period_s, 0.0)
        self._heartbeat_at = -np.inf
        # After as long a drive may have stopped by itself, and would run on at the next SYNC.
        self._absence_s = patience_s - 0.5 * period_s
        self._absent = self._to_be_stopped = False
        self._events: list[BusEvent] = []

    @property
    def samples(self) -> Samples:
        """Samples of the last tick."""
        return self._answers.samples

    def start(
        self, now: float, renewed: Sequence[int] | None = None, heard: Sequence[Frame] = ()
    ) -> None:
        """NMT operational for every drive that is set up: PDOs flow, and heartbeats are watched
        from `now` on.

        renewed: joints whose drives were just set up; None is all, at the first start, when what
        was queued or known of before is forgotten. Otherwise only what these drives said of their
        lost set-up is over. What else was `heard` while nobody ticked, oldest first, is told with
        the next samples; of the other drives all is known that was known before.
        """
        self._now = now
        if renewed is None or len(renewed) == len(self._drives) or not self._stops.silent:
            self._heartbeat_at = now
            self._stops, self._absent = self._new_stops(), False
        self._answers.start_anew()
        if renewed is None:
            self._receive_queued()
            self._events.clear()
        for i, drive in enumerate(self._drives):
            drive.watch.excuse(now)
            if renewed is None or i in renewed:
                self._drives[i] = self._watched(i)
        self._hear(heard, renewed or ())
        self._receive_queued()
        self._address()
        if self._stops.silent:
            return  # until all drives are set up again
        fit = [drive.watch.node for drive in self._drives if not drive.watch.forgot]
        self._send([self._heartbeat, *((NMT, bytes([START_NODE, node])) for node in fit)])

    def _hear(self, heard: Sequence[Frame], renewed: Sequence[int]) -> None:
        """Take what came while drives were set up again, but for what these said of that: their
        boot-up, their heartbeats of before, their emergencies of communication."""
        for can_id, data in heard:
            service, joint = can_id & ~NODE, self._joint_of.get(can_id & NODE)
            kind = data[1] << 8 if len(data) > 1 else 0
            over = service == HEARTBEAT or (
                service == EMERGENCY and kind in (COMMUNICATION_ERROR, PROTOCOL_ERROR)
            )
            if not (joint in renewed and over):
                self._take_other(can_id, data)

    def _watched(self, joint: int) -> _WatchedDrive:
        """A drive that has just been set up."""
        node, timeout_s = self.nodes[joint], self._heartbeat_timeouts_s[joint]
        return _WatchedDrive(HeartbeatWatch(node, timeout_s, self._now))

    def _address(self) -> None:
        self._setpoints.address(i for i, d in enumerate(self._drives) if not d.watch.forgot)

    def distrust(self, joints: Sequence[int]) -> None:
        """Take the drives of these joints for not set up, until they are."""
        for i in joints:
            self._drives[i].watch.forgot = True
        self._address()

    def unfit(self) -> list[int]:
        """Joints whose drives must be set up again before a reset can help: silent, restarted, no
        longer operational, or in fault after an error of communication (0x81xx, CiA 301): another
        error may hide that one, which only a reset of its communication ends."""
        return [
            i
            for i, (drive, state) in enumerate(zip(self._drives, self.samples.states, strict=True))
            if drive.watch.forgot
            or drive.watch.lost
            or self._stops.silent
            or (state is DriveState.FAULT and drive.complained)
        ]

    def sync(self, now: float) -> None:
        """Begin a tick: read what came since the last, beat if it is time, then send SYNC.

        After a gap in our own presence every drive is told to stop, and no SYNC goes out before all
        have taken that: they may have stopped by themselves meanwhile, and a SYNC would have them
        execute a setpoint of before. In the last stage of a stop nothing goes out.
        """
        self._now = now
        unheard_s = now - self._heartbeat_at
        if unheard_s >= self._absence_s and not (self._absent or self._stops.silent):
            # Before what the drives have to say of it: it is the cause.
            self._tell(Absent(unheard_s))
            self._absent = self._to_be_stopped = True
        # A TPDO that is here before its SYNC is a late answer to the one before.
        self._answers.expect_none()
        self._backlog = not self._receive_queued()
        for drive in self._drives:
            self._tell(drive.watch.check(now))
        if self._stops.silent:
            self._backlog = True  # what comes is no answer
            return
        frames = self._frames_after_absence() if self._absent else []
        beats = unheard_s >= self._heartbeat_every_s
        if beats:
            frames.append(self._heartbeat)
        if self._absent:
            self._backlog = True
        else:
            self._answers.expect_all()
            frames.append(SYNC_FRAME)
        if self._send(frames) and beats:
            self._heartbeat_at = now

    def _frames_after_absence(self) -> list[Frame]:
        """Stop commands until they are confirmed: over what the drives have pending, and by SDO."""
        if self._to_be_stopped:
            self._to_be_stopped = False
            return [*self._setpoints.quick_stops, *self._stops.begin_all(self._now, self.samples)]
        self._absent = not self._stops.confirmed
        return []

    def collect(self, deadline: float) -> Samples:
        """Read until every TPDO of this SYNC is in, or `deadline` on the caller's clock has passed.

        Frames that are queued already are read even when it has. Without a SYNC, or after one
        before which not all could be read (the bus has come back, somebody floods it), nothing
        counts as its answer.
        """
        answers, frames_left = self._answers, FRAMES_PER_PASS
        if self._backlog:
            answers.expect_none()
            self._receive_queued()
            answers.expect_all()
            frames_left = 0
        try:
            while answers.missing and frames_left:
                frame = self._wire.receive(max(deadline - self._clock(), 0.0))
                if frame is None:
                    break
                if not answers.take(*frame):
                    self._take_other(*frame)
                frames_left -= 1
        except BUS_FAILURES as error:
            self._tell(bus_failure("receiving", error))
        events = tuple(self._events)
        self._events.clear()
        return answers.finish(events)

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
    ) -> None:
        """Send every drive that is set up its next controlword towards `power` and its target
        velocity.

        velocity: (n,) rad/s at the link. A drive that is not in operation, or not wanted there,
        gets zero. A velocity that is not finite stops all drives and is an event.
        """
        targets = [power] * len(self._drives) if isinstance(power, PowerTarget) else list(power)
        if self._absent:
            on, stop = PowerTarget.ON, PowerTarget.QUICK_STOP
            targets = [stop if target is on else target for target in targets]
        if self._stops.busy or targets != self._all_on:
            self._stop(targets)
        if self._stops.silent:
            return
        try:
            self._setpoints.write(self.samples.states, targets, velocity, reset)
        except ValueError as error:
            self._tell(BadSetpoint(str(error)))
        self._send(self._setpoints.frames)

    def _stop(self, targets: Sequence[PowerTarget]) -> None:
        """See that every drive that is told to stop does."""
        reached = [not drive.watch.forgot for drive in self._drives]
        frames, events = self._stops.step(self._now, targets, self.samples, reached)
        if frames:
            self._send(frames)
        for event in events:
            self._tell(event)

    def unproved(self) -> tuple[str, ...]:
        """Joints whose drives were told to stop and have not been seen to stand since."""
        return tuple(self.names[i] for i in self._stops.unproved)

    @property
    def silenced(self) -> bool:
        """True in the last stage of a stop: the drives hear nothing of us until `start`."""
        return self._stops.silent

    def quick_stop(self) -> None:
        """Tell all drives to quick-stop and hold, now, whatever else is broken or unknown: those
        that are set up with a SYNC, all without."""
        if not self._stops.silent:
            self._send([*self._setpoints.quick_stops, *self._stops_by_sdo, SYNC_FRAME])

    def end(self) -> None:
        """Take leave: drives pre-operational, so that no late setpoint acts; heartbeat last.

        The drives notice the silence after that and stop by themselves (0x6007), which asks
        nothing more of one that is off or holds in quick stop.
        """
        self._send([*self._nmt(ENTER_PRE_OPERATIONAL), self._heartbeat])

    def restarted(self) -> tuple[str, ...]:
        """Joints whose drives restarted and have not been set up again since."""
        return tuple(
            name for name, drive in zip(self.names, self._drives, strict=True) if drive.watch.forgot
        )

    def silent(self) -> tuple[str, ...]:
        """Joints whose drive sends no heartbeat, or one that says it is not operational."""
        return tuple(
            name
            for name, drive in zip(self.names, self._drives, strict=True)
            if drive.watch.lost or not drive.watch.operational
        )

    def _nmt(self, command: int) -> list[Frame]:
        return [(NMT, bytes([command, node])) for node in self.nodes]

    def _send(self, frames: Sequence[Frame]) -> bool:
        """Send; False, and an event, if the bus does not take them all."""
        try:
            self._wire.send(frames)
        except BUS_FAILURES as error:
            self.counters.send_errors += 1
            self._tell(bus_failure("sending", error))
            return False
        return True

    def _receive_queued(self) -> bool:
        """Read what is there; False if there was more than a pass reads."""
        try:
            for _ in range(FRAMES_PER_PASS):
                frame = self._wire.receive(0.0)
                if frame is None:
                    return True
                if not self._answers.take(*frame):
                    self._take_other(*frame)
        except BUS_FAILURES as error:
            self._tell(bus_failure("receiving", error))
            return True
        return False

    def _take_other(self, can_id: int, data: bytes | bytearray) -> None:
        joint = self._joint_of.get(can_id & NODE)
        drive = None if joint is None else self._drives[joint]
        service = can_id & ~NODE  # 11-bit identifiers only: a flag makes it another number
        if can_id & ERROR:
            self.counters.error_frames += 1
            self._take_error(error_frame(can_id & ~ERROR, data))
        elif service == SDO_ANSWER:
            self._stops.hear(can_id & NODE, data)
        elif can_id in self._masters_own:
            self._tell(ForeignMaster(can_id))
        elif drive is None or service not in (HEARTBEAT, EMERGENCY):
            self.counters.unknown_frames += 1
        elif service == HEARTBEAT and not data:
            self.counters.short_frames += 1
        elif service == HEARTBEAT:
            event = drive.watch.hear(data[0], self._now)
            if event is not None:
                self._address()
            self._tell(event)
        else:
            if len(data) < 3:
                self.counters.short_frames += 1
            code = data[0] | data[1] << 8 if len(data) > 1 else UNKNOWN_CODE
            drive.complained |= code & 0xFF00 == COMMUNICATION_ERROR
            self._tell(Emergency(drive.watch.node, code, data[2] if len(data) > 2 else 0))

    def _take_error(self, event: BusEvent) -> None:
        if isinstance(event, BusOff) and not self._absent:
            # What was sent last may have got stuck, and goes out when the bus is back.
            self._absent = self._to_be_stopped = True
        self._tell(event)

    def _tell(self, event: BusEvent | None) -> None:
        """Keep an event for the next samples, once, within bounds."""
        if event is None or event in self._events:
            return
        if len(self._events) < EVENTS_PER_TICK:
            self._events.append(event)
        else:
            self.counters.dropped_events += 1
