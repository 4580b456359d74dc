"""Stops of all drives of an arm: commanded, supervised, and escalated if no standstill is observed.

One `StopWatch` and one `ExpeditedStop` per drive. `step` returns the frames that a stage needs in
addition to the setpoints, and events. One drive in the last stage silences the whole arm, because
all drives share one heartbeat.
"""

import math
from collections.abc import Sequence
from typing import Final

from common.arrays import Vector
from drivers.api import Kind, PowerTarget, Samples
from drivers.can.wire import Frame
from drivers.canopen.events import Fact
from drivers.canopen.expedited_stop import ExpeditedStop
from drivers.canopen.ids import ENTER_PRE_OPERATIONAL, NMT, STOP_NODE
from drivers.canopen.settings import CanopenDrive
from drivers.stopping.stop_watch import OBEYING, RAMP_SHARE, Stage, StopReading
from drivers.stopping.watches import REPEATS, Watches, stop_reading

MOVES_ON: Final = "it reports that it stops, but keeps moving"
BEYOND: Final = "beyond its travel: power cut"


class Stops:
    """Stops of one arm; call `step` once per tick, before its setpoints are sent."""

    def __init__(self, drives: Sequence[CanopenDrive], period_s: float) -> None:
        self.silent = False
        """The last stage is reached: only SDO is sent, to drives not observed at standstill."""
        self._all_stopped_s = math.inf  # time by which all have then stopped by themselves
        self._drives = tuple(drives)
        self._nodes = tuple(drive.node for drive in drives)
        self._fastest = [drive.velocity for drive in drives]
        self._expedited = [ExpeditedStop(drive) for drive in drives]
        self._by_node = dict(zip(self._nodes, self._expedited, strict=True))
        self._all = Watches(drives, period_s)
        self._watches = self._all.each
        self._heard = [True] * len(drives)  # by genuine samples in this tick
        self._nmt_stopped: set[int] = set()  # joints whose drives were NMT-stopped in the last tick
        self.busy = False
        """True while any drive is commanded to stop; otherwise `step` has nothing to do."""

    @property
    def unproved(self) -> list[int]:
        """Joints commanded to stop and not confirmed at standstill, or moving since."""
        return self._all.unproved if self.busy else []

    def may_be_off(self, joint: int) -> bool:
        """True if a drive may lose its power, as `Watches.may_be_off`."""
        return self._all.may_be_off(joint)

    def stop_failed(self, joint: int) -> bool:
        """True if a drive reports that it stops, but was observed beyond its travel."""
        return self._watches[joint].cut

    def master_timeout_passed(self, now: float) -> bool:
        """True once every drive has had the time to miss the master and to stop by itself."""
        return self.silent and now >= self._all_stopped_s

    @property
    def confirmed(self) -> bool:
        """True once every drive has acknowledged the command of `begin_all` or stands."""
        both = zip(self._expedited, self._watches, strict=True)
        return all(expedited.confirmed or watch.proved for expedited, watch in both)

    def follow(
        self, now: float, samples: Samples, targets: Sequence[PowerTarget], velocity: Vector
    ) -> tuple[Fact, ...]:
        """Record motion and commands as `Watches.follow`. Returns an event for drives whose samples
        begin to repeat."""
        begun = self._all.follow(now, samples, targets, velocity)
        nodes = tuple(self._nodes[i] for i in begun)
        return (Fact(Kind.REPEATED_SAMPLES, nodes, REPEATS),) if begun else ()

    def take_over(self, before: "Stops") -> None:
        """Take over the motion history of the drives until now."""
        self._all.take_over(before._all)

    def on_sdo(self, node: int, data: bytes | bytearray) -> None:
        """Take a frame of a drive's SDO server."""
        if expedited := self._by_node.get(node):
            expedited.on_sdo(data)

    def begin_all(self, now: float, samples: Samples) -> list[Frame]:
        """Command every drive to stop by SDO, which needs no SYNC, whatever its setpoint was."""
        self.busy = True
        for i in range(len(self._watches)):
            self._begin(now, i, Stage.DIRECT, samples)
        return self._requests([PowerTarget.QUICK_STOP] * len(self._watches))

    def step(
        self, now: float, targets: Sequence[PowerTarget], samples: Samples, reached: Sequence[bool]
    ) -> tuple[list[Frame], Sequence[Fact]]:
        """Supervise every drive commanded to stop, by its samples and status; `reached`: True if
        setpoints are sent to it."""
        frames = self._leave_nmt_stopped()
        doubted, lost, running, beyond = [], [], [], []
        for i, (watch, target) in enumerate(zip(self._watches, targets, strict=True)):
            if target is PowerTarget.ON:
                watch.allow()
                continue
            seen = self._seen(i, samples)
            if watch.stage is Stage.NONE:
                first = Stage.SETPOINT if seen and reached[i] else Stage.DIRECT
                self._begin(now, i, first, samples)
            if self.silent:
                watch.stage = Stage.SILENCE  # from any stage: no drive gets a further command
            if self._all.repeat[i] and watch.stage is Stage.SETPOINT:
                # Its samples prove nothing: read its state by SDO.
                watch.stage = Stage.DIRECT
                self._expedited[i].begin()
            ran_on, cut = watch.runs_on, watch.cut
            proved = watch.proved
            begun = watch.step(now, seen)
            if watch.proved and not proved:
                self._expedited[i].begin()  # to switch off a drive that no setpoint reaches
            if watch.runs_on and not ran_on:
                running.append(self._nodes[i])
            if watch.cut and not cut:
                beyond.append(self._nodes[i])
                watch.stage = max(watch.stage, Stage.DIRECT)
                self._expedited[i].begin()
            match begun:
                case Stage.DIRECT:
                    self._expedited[i].begin()
                case Stage.LAST:
                    frames.append((NMT, bytes([STOP_NODE, self._nodes[i]])))
                    doubted.append(self._nodes[i])
                    self._nmt_stopped.add(i)
                case Stage.SILENCE:
                    lost.append(self._nodes[i])
                    self._expedited[i].begin()
        self.busy = any(watch.stage is not Stage.NONE for watch in self._watches)
        if lost:
            self._fall_silent(now)
            frames.clear()
        frames += self._requests(targets)
        events = [
            event
            for event in (
                Fact(Kind.NOT_SEEN_TO_STOP, tuple(doubted), "NMT stop sent"),
                Fact(Kind.NOT_SEEN_TO_STOP, tuple(running), MOVES_ON),
                Fact(Kind.NOT_SEEN_TO_STOP, tuple(beyond), f"{MOVES_ON} {BEYOND}"),
                Fact(Kind.UNPROVED, tuple(lost), "our heartbeat is ended"),
            )
            if event.nodes
        ]
        return frames, events

    def _begin(self, now: float, joint: int, stage: Stage, samples: Samples) -> None:
        velocity = float(samples.motor_velocity[joint])
        # A drive that was never heard may be running at its highest commanded speed.
        speed = self._fastest[joint] if math.isnan(velocity) else velocity
        self._watches[joint].begin(now, stage, speed)
        self._expedited[joint].begin()

    def _seen(self, joint: int, samples: Samples) -> StopReading | None:
        """Latest fresh reading of a drive; a sample, which holds more, precedes an SDO reading."""
        asked = self._expedited[joint].take()
        condition = samples.drives[joint].condition
        arrived = bool(samples.arrived[joint])
        self._heard[joint] = arrived and not self._all.repeat[joint]
        if not arrived:
            return asked
        if self._all.repeat[joint]:
            # Of repeated samples, at most the statusword is still informative.
            return asked or (StopReading(condition, math.nan) if condition in OBEYING else None)
        return stop_reading(samples, joint)

    def _fall_silent(self, now: float) -> None:
        """Begin the last stage. It ends when every drive has missed our heartbeat and stopped from
        its highest commanded or last measured speed, on a ramp slowed by the load."""
        if self.silent:
            return
        self.silent = True
        self._all_stopped_s = now + max(
            drive.profile.master_timeout_s
            + max(drive.velocity, watch.speed) / (RAMP_SHARE * drive.quick_stop)
            for drive, watch in zip(self._drives, self._watches, strict=True)
        )

    def _leave_nmt_stopped(self) -> list[Frame]:
        """Frames that set drives to pre-operational a tick after NMT stop, which has aborted their
        connection (0x6007): in NMT stopped they would answer no SDO."""
        frames: list[Frame] = []
        for i in sorted(self._nmt_stopped) if not self.silent else ():
            frames.append((NMT, bytes([ENTER_PRE_OPERATIONAL, self._nodes[i]])))
            self._expedited[i].begin()
        self._nmt_stopped.clear()
        return frames

    def _requests(self, targets: Sequence[PowerTarget]) -> list[Frame]:
        """Next SDO of every drive that is commanded or read by SDO."""
        wanted = (self._by_sdo(i, target) for i, target in enumerate(targets))
        requests = [
            expedited.request(target)
            for expedited, target in zip(self._expedited, wanted, strict=True)
            if target is not None
        ]
        return [request for request in requests if request]

    def _by_sdo(self, joint: int, target: PowerTarget) -> PowerTarget | None:
        """Target commanded to a drive by SDO, OFF only if it may lose its power; None if no SDO is
        sent."""
        watch = self._watches[joint]
        if watch.stage <= Stage.SETPOINT or joint in self._nmt_stopped:
            return None
        unheard = not self._heard[joint]
        if watch.unproved:
            return PowerTarget.OFF if watch.cut else PowerTarget.QUICK_STOP
        if target is PowerTarget.OFF and not self.silent:
            return target if unheard or not self._expedited[joint].confirmed else None
        # Without samples, its proof has to be kept up by SDO readings.
        return PowerTarget.QUICK_STOP if unheard else None
