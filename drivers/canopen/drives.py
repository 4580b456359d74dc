"""CANopen drives of one arm on their bus: each tick sends SYNC, reads samples, sends setpoints.

One thread owns the bus: no locks, no further threads, no blocking SDO, no logging. Time is an
argument; `clock` only measures the remaining time of a deadline and the duration of reading.
Everything except samples is reported as events; no received frame and no bus failure raises an
exception.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from common.arrays import Vector
from drivers.api import Event, Kind, Objection, PowerTarget, Samples
from drivers.can.wire import Frame, Wire
from drivers.canopen.emergencies import Emergencies
from drivers.canopen.events import BusEvent, Fact, crossing
from drivers.canopen.ids import EMERGENCY, HEARTBEAT
from drivers.canopen.inbox import FRAMES_PER_PASS, Inbox
from drivers.canopen.objections import objections_of
from drivers.canopen.outbox import SYNC_FRAME, Outbox
from drivers.canopen.sdo_watch import SdoWatch
from drivers.canopen.settings import CanopenDrive
from drivers.canopen.stops import Stops
from drivers.event_queue import EventQueue
from drivers.presence import Presence
from drivers.stopping.travel import least_master_timeout_s

_OFF, _ON, _STOP = PowerTarget


class CanopenDrives:
    """Drives of an arm on one bus, without their set-up: `drivers.api.Drives`, start and end."""

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[CanopenDrive],
        period_s: float,
        clock: Callable[[], float],
        master_node: int = 127,
        bitrate: int = 1_000_000,
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self.names = tuple(drive.name for drive in drives)
        self.nodes = tuple(drive.node for drive in drives)
        self._clock, self._now = clock, 0.0
        self._joints = dict(zip(self.nodes, self.names, strict=True))
        self._events: EventQueue[BusEvent] = EventQueue()
        self._report = self._events.report
        self._presence = Presence(least_master_timeout_s(drives), period_s)
        self._outbox = Outbox(wire, drives, master_node, self._report)
        self._setpoints = self._outbox.setpoints
        self._inbox = Inbox(
            *(wire, drives, period_s, bitrate, self._outbox.master_ids),
            self._report,
            on_sdo=self._hear_sdo,
            on_node=self._address,
            on_bus_off=self._presence.lost,
        )
        self._answers, self._nodes = self._inbox.answers, self._inbox.nodes
        self._emergencies = Emergencies(self._joints)
        self._new_stops = partial(Stops, drives, period_s)
        self._stops = self._new_stops()
        self._sdo_watch = SdoWatch(drives)
        self._all_on = [_ON] * len(drives)
        self._backlog = False

    @property
    def samples(self) -> Samples:
        """Samples of the last tick."""
        return self._answers.samples

    def start(
        self, now: float, renewed: Sequence[int] | None = None, received: Sequence[Frame] = ()
    ) -> None:
        """Set all drives that are set up to NMT operational: PDOs flow, and heartbeats are
        monitored from `now` on.

        renewed: joints whose drives were just set up. None means all, at the first start: queued
        frames and all history are discarded. Otherwise only messages of these drives about their
        lost set-up are dropped; all other frames `received` between ticks (oldest first) are
        reported with the next samples, and the history of the other drives is kept.
        """
        self._now = now
        if renewed is None or len(renewed) == len(self.names) or not self._stops.silent:
            self._presence.begin(now)
            before, self._stops = self._stops, self._new_stops()
            if renewed is not None:
                self._stops.take_over(before)
        self._answers.awaited.start_anew()
        self._inbox.traffic.begin(now, self._inbox.answers.late_frames)
        self._sdo_watch.forget()
        if renewed is None:
            self._inbox.read_queued(now)
            self._events.take()
        queued = self._inbox.queued()
        self._nodes.start(now, renewed)
        self._emergencies.renewed(renewed)
        # `queued` arrived after the set-up: a boot-up message among them must be reported.
        self._inbox.take_after_set_up(received, (HEARTBEAT, EMERGENCY), renewed or (), now)
        self._inbox.take_after_set_up(queued, (EMERGENCY,), renewed or (), now)
        self._address()
        if not self._stops.silent:  # silence ends when all drives are set up again
            self._outbox.start(self._nodes.fit)

    def _address(self) -> None:
        """Send setpoints only to drives that are set up."""
        self._setpoints.address(self._nodes.fit)

    def distrust(self, joints: Sequence[int]) -> None:
        """Count the drives of these joints as not set up, until they are set up again."""
        self._nodes.distrust(joints)
        self._address()

    def unfit(self) -> list[int]:
        """Joints whose drives must be set up again before a reset can succeed: all of them after
        silence, else those that `NodeWatches` finds unfit."""
        every = list(range(len(self.names)))
        return every if self._stops.silent else self._nodes.unfit(self._answers.states)

    def sync(self, now: float) -> None:
        """Begin a tick: read the frames since the last one, send a heartbeat if due, then SYNC.

        After a gap in the master's presence every drive is commanded to stop, and no SYNC is sent
        before all have confirmed: they may have stopped by themselves meanwhile, and a SYNC would
        make them execute an old setpoint. In the last stage of a stop nothing is sent.
        """
        entered_s = self._clock()
        self._now = now
        # Reported before the drives' own reports of it, as it is their cause.
        self._notice_absence(now)
        # A TPDO that arrives before its SYNC is a late answer to the previous one.
        self._answers.awaited.expect_none()
        self._backlog = not self._inbox.read_queued(now)
        self._report(*self._nodes.check(now))
        if self._stops.silent:
            self._backlog = True  # no frame counts as an answer
            return
        # Reading may have taken long, or the process may have been suspended meanwhile.
        self._notice_absence(now + self._clock() - entered_s)
        presence = self._presence
        frames = self._frames_after_absence() if presence.absent else []
        beats = presence.beats(now)
        if beats:
            frames.append(self._outbox.heartbeat)
        # A tick without SYNC reveals drives that answer a period late; never during a stop.
        looks = not self._stops.busy and self._answers.punctuality.leaves_out(now)
        if presence.absent or looks:
            self._backlog = True
        else:
            self._answers.awaited.expect_all(now, entered_s)
            frames.append(SYNC_FRAME)
        if self._outbox.send(frames) and beats:
            presence.beaten(now)

    def _notice_absence(self, now: float) -> None:
        gap_s = self._presence.gap_s(now)
        if gap_s is not None and not self._stops.silent:
            text = f"the drives received nothing from it for {1000 * gap_s:.0f} ms"
            self._report(Fact(Kind.ABSENT, text=text))
            self._presence.lost()

    def _frames_after_absence(self) -> list[Frame]:
        """Stop commands until they are confirmed: in place of pending setpoints, and by SDO."""
        if self._presence.news:
            self._presence.news = False
            return [*self._setpoints.quick_stops, *self._stops.begin_all(self._now, self.samples)]
        self._presence.absent = not self._stops.confirmed
        return []

    def collect(self, deadline: float) -> Samples:
        """Read until all TPDOs of this SYNC have arrived, or until `deadline` on `clock`.

        Frames already queued are read even after the deadline. Without a SYNC, or if not all frames
        could be read before it (a bus that recovered or is flooded), no frame counts as its answer.
        """
        answers, inbox, frames_left = self._answers, self._inbox, FRAMES_PER_PASS
        awaited, clock = answers.awaited, self._clock
        if self._backlog:
            awaited.expect_none()
            inbox.read_queued(self._now)
            awaited.miss_all()
            frames_left = 0
        while frames_left and (left_s := awaited.left_s(deadline, clock())) is not None:
            frame = inbox.receive(left_s)
            if frame is None:
                break
            inbox.take(*frame, self._now)
            frames_left -= 1
        answers.judge()
        self._inbox.traffic.step(self._now, self._inbox.answers.late_frames)
        if loaded := self._inbox.traffic.loaded:
            self._report(Event(Kind.LOADED, loaded.text))
        events = self._events.take()
        crossed = [event for each in events if (event := crossing(each, self._joints))]
        samples = answers.finish(tuple(crossed))
        self._emergencies.watch(events, samples.drives)
        return samples

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        ask: bool = False,
    ) -> None:
        """Send each drive that is set up its next controlword towards `power` and its target
        velocity; `ask` permits a query whether drives still answer SDO.

        velocity: (n,) rad/s at the link; zero is sent to a drive that is not in operation or has
        another target. A velocity that is not finite stops all drives and is reported as an event.
        """
        targets = [power] * len(self.names) if isinstance(power, PowerTarget) else list(power)
        if self._presence.absent:
            targets = [_STOP if target is _ON else target for target in targets]
        self._report(*self._stops.follow(self._now, self.samples, targets, velocity))
        if self._stops.busy or targets != self._all_on:
            frames, events = self._stops.step(self._now, targets, self.samples, self._nodes.set_up)
            if frames:
                self._outbox.send(frames)
            self._report(*events)
            # Power is removed only at standstill: a moving drive is ramped down first.
            targets = [
                _STOP if target is _OFF and not self._stops.may_be_off(i) else target
                for i, target in enumerate(targets)
            ]
        if self._stops.silent:
            return
        try:
            self._setpoints.write(self._answers.states, targets, velocity, reset)
        except ValueError as error:
            self._report(Fact(Kind.BAD_SETPOINT, text=str(error)))
        self._outbox.send(self._setpoints.frames)
        if not ask or self._stops.busy:
            self._sdo_watch.rest()
        elif question := self._sdo_watch.ask(self._now):
            self._outbox.send(question)

    def unproved(self) -> tuple[str, ...]:
        """Joints commanded to stop and not confirmed at standstill since."""
        return self._named(self._stops.unproved)

    def stop_failed(self, joint: int) -> bool:
        """True if a quick stop was observed not to stop a joint: its power may be cut in motion."""
        return self._stops.stop_failed(joint)

    @property
    def master_timeout_passed(self) -> bool:
        """True in the last stage of a stop, once every drive has had the time to miss the master
        and to stop by itself."""
        return self._stops.master_timeout_passed(self._now)

    @property
    def silenced(self) -> bool:
        """True in the last stage of a stop: nothing but SDO is sent to the drives until `start`."""
        return self._stops.silent

    def quick_stop(self) -> None:
        """Command all drives to quick-stop and hold immediately, whatever has failed or is unknown:
        those that are set up by RPDO and SYNC, all by SDO."""
        if not self._stops.silent:
            self._outbox.quick_stop()

    def end(self) -> None:
        """End the session."""
        self._outbox.end()

    def restarted(self) -> tuple[str, ...]:
        """Joints whose drives have lost their set-up and are not set up again yet."""
        return self._named(self._nodes.unset)

    def silent(self) -> tuple[str, ...]:
        """Joints whose drives send no heartbeat, or one that does not report operational."""
        return self._named(self._nodes.unheard)

    def objections(self) -> tuple[Objection, ...]:
        """Reasons against arming that are not visible in the samples."""
        doubted = self._answers.punctuality.doubted(self._now)
        found = objections_of(
            no_sdo=self._named(self._sdo_watch.silent),
            doubted=self._named(self._answers.awaited.joints_of(doubted)),
            silent=self.silent(),
            emergencies=self._emergencies.objections(),
            unset=self.restarted(),
        )
        return tuple(found)

    def acknowledge(self) -> None:
        """Acknowledge a fault on the operator's reset: clear emergencies of drives not in fault."""
        self._emergencies.acknowledge()

    def _named(self, joints: Iterable[int]) -> tuple[str, ...]:
        return tuple(self.names[i] for i in joints)

    def _hear_sdo(self, node: int, data: bytes | bytearray) -> None:
        self._stops.on_sdo(node, data)
        self._sdo_watch.on_sdo(node, data)
