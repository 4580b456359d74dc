"""Drives of one arm on their bus: every tick SYNC out, samples in, setpoints out.

One thread owns the bus: no lock, no thread, no SDO that is waited for, no log line. Time is an
argument; the `clock` only measures how much of a deadline is left, and how long reading took.
Everything beside the samples is reported as events; nothing that arrives, and no failure of the
bus, is an exception.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Final

from common.arrays import Vector
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import ERROR, Frame, Wire
from drivers.canopen.answers import Answers, Counters, Samples
from drivers.canopen.cia402 import PowerTarget
from drivers.canopen.drive import Drive
from drivers.canopen.events import (
    OF_COMMUNICATION,
    Absent,
    BadSetpoint,
    BusEvent,
    BusOff,
    Emergency,
    ForeignMaster,
    bus_failure,
    error_frame,
)
from drivers.canopen.expedited_stop import expedited_quick_stops
from drivers.canopen.ids import (
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
from drivers.canopen.node_watches import NodeWatches
from drivers.canopen.presence import Presence
from drivers.canopen.sdo_watch import SdoWatch
from drivers.canopen.setpoints import Setpoints
from drivers.canopen.stop_stages import least_patience_s
from drivers.canopen.stops import Stops
from drivers.canopen.traffic import Traffic

SYNC_FRAME: Final[Frame] = (SYNC, b"")

#: Bounds of one tick: a flooded bus must not hold the loop, nor its memory.
FRAMES_PER_PASS: Final = 512
EVENTS_PER_TICK: Final = 32


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
        bitrate: int = 1_000_000,
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self.names = tuple(drive.name for drive in drives)
        self.nodes = tuple(drive.node for drive in drives)
        self.counters = Counters()
        self._wire, self._clock = wire, clock
        self._answers = Answers(drives, self.counters, self._report, period_s)
        self._traffic = Traffic(drives, period_s, bitrate)
        self._setpoints = Setpoints(drives)
        self._new_stops = partial(Stops, drives, period_s)
        self._stops = self._new_stops()
        self._stops_by_sdo = expedited_quick_stops(drives)
        self._all_on = [PowerTarget.ON] * len(drives)
        self._now = 0.0
        self._nodes = NodeWatches(drives, self.counters)
        self._sdo_watch = SdoWatch(drives)
        self._presence = Presence(least_patience_s(drives), period_s)
        self._to_be_stopped = False  # all drives: absence has just begun
        self._backlog = False
        self._heartbeat: Frame = (HEARTBEAT + master_node, bytes([OPERATIONAL]))
        setpoint_ids = {cob_id for cob_id, _ in self._setpoints.frames}
        self._masters_own = {NMT, SYNC, HEARTBEAT + master_node} | setpoint_ids
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

        renewed: joints whose drives were just set up; None is all, at the first start, when queued
        frames and earlier knowledge are forgotten. Otherwise only the reports of these drives about
        their lost set-up are dropped. All else that was `heard` between ticks, oldest first, is
        reported with the next samples; what is known of the other drives is kept.
        """
        self._now = now
        if renewed is None or len(renewed) == len(self.names) or not self._stops.silent:
            self._presence.begin(now)
            before, self._stops = self._stops, self._new_stops()
            if renewed is not None:
                self._stops.take_over(before)
        self._answers.start_anew()
        self._traffic.begin(now, self.counters.late_frames)
        self._sdo_watch.forget()
        if renewed is None:
            self._receive_queued()
            self._events.clear()
        queued = self._queued()
        self._nodes.start(now, renewed)
        self._hear(heard, queued, renewed or ())
        self._address()
        if self._stops.silent:
            return  # until all drives are set up again
        fit = [node for node, fit in zip(self.nodes, self._nodes.set_up, strict=True) if fit]
        self._send([self._heartbeat, *_nmt(START_NODE, fit)])

    def _hear(
        self, heard: Sequence[Frame], queued: Sequence[Frame], renewed: Sequence[int]
    ) -> None:
        """Take the frames that came while drives were set up again, except those that belong to
        that set-up: boot-up, earlier heartbeats and emergencies of communication of these drives.
        `queued` came after it: a boot-up message among them is news."""
        for frames, over in ((heard, (HEARTBEAT, EMERGENCY)), (queued, (EMERGENCY,))):
            for can_id, data in frames:
                service, joint = can_id & ~NODE, self._nodes.joint_of.get(can_id & NODE)
                kind = data[1] << 8 if len(data) > 1 else 0
                of_set_up = service == HEARTBEAT or kind in OF_COMMUNICATION
                if joint in renewed and service in over and of_set_up:
                    continue
                if not self._answers.take(can_id, data):
                    self._take_other(can_id, data)

    def _queued(self) -> list[Frame]:
        """Frames that wait in the wire, at most those of one pass."""
        frames: list[Frame] = []
        try:
            while len(frames) < FRAMES_PER_PASS and (frame := self._wire.receive(0.0)):
                frames.append(frame)
        except BUS_FAILURES as error:
            self._report(bus_failure("receiving", error))
        return frames

    def _address(self) -> None:
        """Let setpoints go to the drives that are set up, and to no others."""
        self._setpoints.address(i for i, fit in enumerate(self._nodes.set_up) if fit)

    def distrust(self, joints: Sequence[int]) -> None:
        """Take the drives of these joints for not set up, until they are."""
        self._nodes.distrust(joints)
        self._address()

    def unfit(self) -> list[int]:
        """Joints whose drives must be set up again before a reset can help: all, once they were
        left to themselves; else those that their `NodeWatches` find unfit."""
        if self._stops.silent:
            return list(range(len(self.names)))
        return self._nodes.unfit(self.samples.states)

    def sync(self, now: float) -> None:
        """Begin a tick: read what came since the last, beat if it is time, then send SYNC.

        After a gap in our own presence every drive is commanded to stop, and no SYNC goes out
        before all have confirmed: they may have stopped by themselves meanwhile, and a SYNC would
        have them execute an old setpoint. In the last stage of a stop nothing goes out.
        """
        entered_s = self._clock()
        self._now = now
        # Before the drives' own reports of it: it is the cause.
        self._notice_absence(now)
        # A TPDO that is here before its SYNC is a late answer to the one before.
        self._answers.expect_none()
        self._backlog = not self._receive_queued()
        for event in self._nodes.check(now):
            self._report(event)
        if self._stops.silent:
            self._backlog = True  # no frame counts as an answer
            return
        # Reading may have taken long, or the process have been held up in it.
        self._notice_absence(now + self._clock() - entered_s)
        presence = self._presence
        frames = self._frames_after_absence() if presence.absent else []
        beats = presence.beats(now)
        if beats:
            frames.append(self._heartbeat)
        # A tick without SYNC shows drives that answer a period late; not in the middle of a stop.
        looks = not self._stops.busy and self._answers.punctuality.leaves_out(now)
        if presence.absent or looks:
            self._backlog = True
        else:
            self._answers.expect_all(now)
            frames.append(SYNC_FRAME)
        if self._send(frames) and beats:
            presence.beaten(now)

    def _notice_absence(self, now: float) -> None:
        gap_s = self._presence.gap_s(now)
        if gap_s is not None and not self._stops.silent:
            self._report(Absent(gap_s))
            self._presence.absent = self._to_be_stopped = True

    def _frames_after_absence(self) -> list[Frame]:
        """Stop commands until they are confirmed: over what the drives have pending, and by SDO."""
        if self._to_be_stopped:
            self._to_be_stopped = False
            return [*self._setpoints.quick_stops, *self._stops.begin_all(self._now, self.samples)]
        self._presence.absent = not self._stops.confirmed
        return []

    def collect(self, deadline: float) -> Samples:
        """Read until every TPDO of this SYNC is in, or `deadline` on the caller's clock has passed.

        Frames that are queued already are read even when it has. Without a SYNC, or after one
        before which not all could be read (the bus has come back, or is flooded), nothing counts
        as its answer.
        """
        answers, frames_left = self._answers, FRAMES_PER_PASS
        if self._backlog:
            answers.expect_none()
            self._receive_queued()
            answers.miss_all()
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
            self._report(bus_failure("receiving", error))
        answers.judge()
        self._traffic.step(self._now, self.counters.late_frames)
        self._report(self._traffic.loaded)
        events = tuple(self._events)
        self._events.clear()
        return answers.finish(events)

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        ask: bool = False,
    ) -> None:
        """Send every drive that is set up its next controlword towards `power` and its target
        velocity; `ask` lets drives be asked whether they answer SDO.

        velocity: (n,) rad/s at the link. A drive that is not in operation, or not wanted there,
        gets zero. A velocity that is not finite stops all drives and is an event.
        """
        targets = [power] * len(self.names) if isinstance(power, PowerTarget) else list(power)
        if self._presence.absent:
            on, stop = PowerTarget.ON, PowerTarget.QUICK_STOP
            targets = [stop if target is on else target for target in targets]
        for event in self._stops.follow(self._now, self.samples, targets, velocity):
            self._report(event)
        if self._stops.busy or targets != self._all_on:
            self._stop(targets)
            # Power is taken from drives that stand. A moving one gets a ramp first.
            targets = [
                PowerTarget.QUICK_STOP
                if target is PowerTarget.OFF and not self._stops.may_be_off(i)
                else target
                for i, target in enumerate(targets)
            ]
        if self._stops.silent:
            return
        try:
            self._setpoints.write(self.samples.states, targets, velocity, reset)
        except ValueError as error:
            self._report(BadSetpoint(str(error)))
        self._send(self._setpoints.frames)
        if not ask or self._stops.busy:
            self._sdo_watch.rest()
        elif question := self._sdo_watch.ask(self._now):
            self._send(question)

    def _stop(self, targets: Sequence[PowerTarget]) -> None:
        """Ensure that every drive commanded to stop does."""
        frames, events = self._stops.step(self._now, targets, self.samples, self._nodes.set_up)
        if frames:
            self._send(frames)
        for event in events:
            self._report(event)

    def unproved(self) -> tuple[str, ...]:
        """Joints commanded to stop and not confirmed at standstill since."""
        return tuple(self.names[i] for i in self._stops.unproved)

    def stopped_in_vain(self, joint: int) -> bool:
        """True where a quick stop was seen not to stop a joint: it may lose its power in motion."""
        return self._stops.stopped_in_vain(joint)

    @property
    def left_alone(self) -> bool:
        """True in the last stage of a stop, when every drive has had the time to miss us and to
        stop by itself."""
        return self._stops.left_alone(self._now)

    @property
    def silenced(self) -> bool:
        """True in the last stage of a stop: the drives hear nothing of us until `start`."""
        return self._stops.silent

    def quick_stop(self) -> None:
        """Command all drives to quick-stop and hold, now, whatever else is broken or unknown: those
        that are set up with a SYNC, all without."""
        if not self._stops.silent:
            self._send([*self._setpoints.quick_stops, *self._stops_by_sdo, SYNC_FRAME])

    def end(self) -> None:
        """End the session: drives pre-operational, so that no late setpoint acts; heartbeat last.

        The drives notice the silence after that and stop by themselves (0x6007), which asks
        nothing more of one that is off or holds in quick stop.
        """
        self._send([*_nmt(ENTER_PRE_OPERATIONAL, self.nodes), self._heartbeat])

    def restarted(self) -> tuple[str, ...]:
        """Joints whose drives restarted and have not been set up again since."""
        fit = zip(self.names, self._nodes.set_up, strict=True)
        return tuple(name for name, set_up in fit if not set_up)

    def silent(self) -> tuple[str, ...]:
        """Joints whose drive sends no heartbeat, or reports that it is not operational."""
        beats = zip(self.names, self._nodes.heard, strict=True)
        return tuple(name for name, heard in beats if not heard)

    def doubted(self) -> tuple[str, ...]:
        """Joints whose samples may be a period old, which is about to be seen."""
        doubted = self._answers.punctuality.doubted(self._now)
        return tuple(self.names[i] for i in self._answers.joints_of(doubted))

    def no_sdo(self) -> tuple[str, ...]:
        """Joints whose drives answered no SDO when they were asked last."""
        return tuple(self.names[i] for i in self._sdo_watch.silent)

    def _send(self, frames: Sequence[Frame]) -> bool:
        """Send; False, and an event, if the bus does not take them all."""
        try:
            self._wire.send(frames)
        except BUS_FAILURES as error:
            self.counters.send_errors += 1
            self._report(bus_failure("sending", error))
            return False
        return True

    def _receive_queued(self) -> bool:
        """Read the queued frames; False if there were more than a pass reads."""
        try:
            for _ in range(FRAMES_PER_PASS):
                frame = self._wire.receive(0.0)
                if frame is None:
                    return True
                if not self._answers.take(*frame):
                    self._take_other(*frame)
        except BUS_FAILURES as error:
            self._report(bus_failure("receiving", error))
            return True
        return False

    def _take_other(self, can_id: int, data: bytes | bytearray) -> None:
        if can_id & ERROR:
            self.counters.error_frames += 1
            self._take_error(error_frame(can_id & ~ERROR, data))
            return
        unknown = self.counters.unknown_frames
        if can_id & ~NODE == SDO_ANSWER:  # 11-bit identifiers: a flag makes it another number
            self._stops.hear(can_id & NODE, data)
            self._sdo_watch.hear(can_id & NODE, data)
        elif can_id in self._masters_own:
            self._report(ForeignMaster(can_id))
        elif event := self._nodes.hear(can_id, data, self._now):
            if not isinstance(event, Emergency):
                self._address()
            self._report(event)
        self._traffic.take(can_id, len(data), unknown=self.counters.unknown_frames > unknown)

    def _take_error(self, event: BusEvent) -> None:
        if isinstance(event, BusOff) and not self._presence.absent:
            # The frames sent last may have got stuck, and go out when the bus is back.
            self._presence.absent = self._to_be_stopped = True
        self._report(event)

    def _report(self, event: BusEvent | None) -> None:
        """Keep an event for the next samples, once, within bounds."""
        if event is None or event in self._events:
            return
        if len(self._events) < EVENTS_PER_TICK:
            self._events.append(event)
        else:
            self.counters.dropped_events += 1


def _nmt(command: int, nodes: Iterable[int]) -> list[Frame]:
    return [(NMT, bytes([command, node])) for node in nodes]
