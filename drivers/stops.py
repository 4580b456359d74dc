"""Stops of all drives of an arm: told, seen, and told more strongly where they are not seen.

One `StopWatch` and one `ExpeditedStop` for each drive. What a stage needs beside the setpoints
comes back as frames, what happened as events. One drive in the last stage silences the whole arm:
our heartbeat is for all of them.
"""

import math
from collections.abc import Sequence

from drivers.answers import Samples
from drivers.can.wire import Frame
from drivers.cia402 import PowerTarget
from drivers.drive import Drive
from drivers.events import BusEvent, NotSeenToStop, RunningOn, Unproved
from drivers.expedited_stop import ExpeditedStop
from drivers.ids import ENTER_PRE_OPERATIONAL, NMT, STOP_NODE
from drivers.stop_stages import (
    Seen,
    Stage,
    StopBounds,
    StopWatch,
    least_patience_s,
    stage_ticks,
    worst_travel,
)


class Stops:
    """Stops of one arm; `step` once per tick, before the setpoints of the tick go out."""

    def __init__(self, drives: Sequence[Drive], period_s: float) -> None:
        patience_s = least_patience_s(drives)
        ticks = stage_ticks(patience_s, period_s)
        self.silent = False
        """The last stage is reached: only SDO goes out, to drives that are not seen to stand."""
        self._nodes = tuple(drive.node for drive in drives)
        self._fastest = [drive.velocity for drive in drives]
        self._expedited = [ExpeditedStop(drive) for drive in drives]
        self._by_node = dict(zip(self._nodes, self._expedited, strict=True))
        # From the first command on: noticing is over by then.
        travels = worst_travel(drives, period_s, noticing_ticks=0)
        self._watches = [
            StopWatch(
                StopBounds(
                    deceleration=drive.quick_stop,
                    current=drive.wiring.max_current_A,
                    travel=travel.total,
                    patience_s=drive.profile.master_timeout_ms / 1000.0,
                    ticks=ticks,
                    period_s=period_s,
                )
            )
            for drive, travel in zip(drives, travels, strict=True)
        ]
        self._asleep: set[int] = set()  # joints whose drives were NMT stopped in the last tick
        self.busy = False
        """Some drive is told to stop; while none is, `step` has nothing to do."""

    @property
    def unproved(self) -> list[int]:
        """Joints that are to stand and were not seen to."""
        if not self.busy:
            return []
        return [i for i, watch in enumerate(self._watches) if watch.unproved]

    @property
    def confirmed(self) -> bool:
        """True when every drive has taken the command of `begin_all`, or was seen to stand."""
        both = zip(self._expedited, self._watches, strict=True)
        return all(expedited.confirmed or watch.proved for expedited, watch in both)

    def hear(self, node: int, data: bytes | bytearray) -> None:
        """Take a frame of a drive's SDO server."""
        if expedited := self._by_node.get(node):
            expedited.hear(data)

    def begin_all(self, now: float, samples: Samples) -> list[Frame]:
        """Tell every drive to stop, whatever it was told, and without a SYNC."""
        self.busy = True
        for i in range(len(self._watches)):
            self._begin(now, i, Stage.SDO, samples)
        return self._requests([PowerTarget.QUICK_STOP] * len(self._watches))

    def step(
        self,
        now: float,
        targets: Sequence[PowerTarget],
        samples: Samples,
        reached: Sequence[bool],
    ) -> tuple[list[Frame], Sequence[BusEvent]]:
        """Judge every drive that is told to stop; `reached`: whether setpoints are sent to it."""
        frames = self._wake()
        doubted, lost, running, beyond = [], [], [], []
        for i, (watch, target) in enumerate(zip(self._watches, targets, strict=True)):
            if target is PowerTarget.ON:
                watch.allow()
                continue
            seen = self._seen(i, samples)
            if watch.stage is Stage.NONE:
                told = Stage.SETPOINT if seen and reached[i] else Stage.SDO
                self._begin(now, i, told, samples)
            if self.silent:
                watch.stage = Stage.SILENCE  # whatever it was in: nobody is told anything else
            ran_on, cut = watch.runs_on, watch.cut
            begun = watch.step(now, target, seen)
            if watch.runs_on and not ran_on:
                running.append(self._nodes[i])
            if watch.cut and not cut:
                beyond.append(self._nodes[i])
                watch.stage = max(watch.stage, Stage.SDO)
                self._expedited[i].begin()
            match begun:
                case Stage.SDO:
                    self._expedited[i].begin()
                case Stage.NMT:
                    frames.append((NMT, bytes([STOP_NODE, self._nodes[i]])))
                    doubted.append(self._nodes[i])
                    self._asleep.add(i)
                case Stage.SILENCE:
                    lost.append(self._nodes[i])
                    self._expedited[i].begin()
        self.busy = any(watch.stage is not Stage.NONE for watch in self._watches)
        if lost:
            self.silent = True
            frames.clear()
        frames += self._requests(targets)
        events = [
            event
            for event in (
                NotSeenToStop(tuple(doubted)),
                NotSeenToStop(tuple(running), RunningOn.MOVES),
                NotSeenToStop(tuple(beyond), RunningOn.BEYOND),
                Unproved(tuple(lost)),
            )
            if event.nodes
        ]
        return frames, events

    def _begin(self, now: float, joint: int, stage: Stage, samples: Samples) -> None:
        velocity = float(samples.motor_velocity[joint])
        # What was never heard may be as fast as it is ever told to be.
        speed = self._fastest[joint] if math.isnan(velocity) else velocity
        self._watches[joint].begin(now, stage, speed, float(samples.link_position[joint]))
        self._expedited[joint].begin()

    def _seen(self, joint: int, samples: Samples) -> Seen | None:
        """Newest fresh reading of a drive; a sample tells more than what was asked for."""
        asked = self._expedited[joint].take()
        if not samples.fresh[joint]:
            return asked
        return Seen(
            samples.states[joint],
            float(samples.motor_velocity[joint]),
            float(samples.current[joint]),
            float(samples.link_position[joint]),
        )

    def _wake(self) -> list[Frame]:
        """NMT pre-operational for drives that have had a tick to lose their connection: stopped,
        they answer no SDO."""
        frames: list[Frame] = []
        for i in sorted(self._asleep) if not self.silent else ():
            frames.append((NMT, bytes([ENTER_PRE_OPERATIONAL, self._nodes[i]])))
            self._expedited[i].begin()
        self._asleep.clear()
        return frames

    def _requests(self, targets: Sequence[PowerTarget]) -> list[Frame]:
        """Next SDO of every drive that is to be told, or seen, without a SYNC."""
        requests = [
            self._expedited[i].request(PowerTarget.OFF if watch.cut else targets[i])
            for i, watch in enumerate(self._watches)
            if watch.unproved and watch.stage is not Stage.SETPOINT and i not in self._asleep
        ]
        return [request for request in requests if request]
