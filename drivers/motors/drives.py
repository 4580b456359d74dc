"""Motors of one arm on their bus: each tick sends requests, reads samples, sends setpoints.

A tick requests the answers of each motor, then sends its setpoint, which is acknowledged by a
feedback of its own. Where the setpoint is the request, it is that of the tick before. One thread
owns the bus. Time is an argument; `clock` only measures the remaining time of a deadline. Bus
failures are reported as events, not raised.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from common.arrays import Vector
from drivers.api import Event, Kind, Objection, PowerTarget, Samples
from drivers.can.traffic import Traffic
from drivers.can.wire import Frame, Wire
from drivers.motors.language import UNREPORTED, Language, State, Status
from drivers.motors.language import MotorDrives as Motors
from drivers.motors.port import FRAMES_PER_PASS, Port
from drivers.motors.replies import Replies, news_of
from drivers.motors.setpoints import Setpoints
from drivers.motors.stops import Stops
from drivers.presence import Presence
from drivers.stopping.travel import least_master_timeout_s

NO_GUARDIAN: Final = (
    "no guardian is heard on the bus, to hold the arm if this process dies: run `contactd guard`"
)
_OFF, _ON, _STOP = PowerTarget


class MotorTick:
    """Motors of an arm on one bus, without their set-up: `drivers.api.Drives`, start and end."""

    #: Frames are sent at all times: without them the motors would go limp.
    silenced = False

    def __init__(
        self,
        wire: Wire,
        drives: Motors,
        language: Language,
        traffic: Traffic,
        period_s: float,
        clock: Callable[[], float],
    ) -> None:
        n = len(drives)
        self.names = tuple(drive.name for drive in drives)
        self.replies = Replies(drives, language, period_s)
        self._clock, self._now = clock, 0.0
        self._stops = Stops(drives, period_s)
        self._presence = Presence(least_master_timeout_s(drives), period_s)
        self._language = language
        self._setpoints = Setpoints(drives, language, period_s)
        adopt = self._setpoints.adopt
        self._port = Port(wire, self.replies, traffic, language, self._presence.lost, adopt)
        self._last = [0.0] * n  # last target velocities sent [rad/s at the link]
        self._measured = [math.nan] * n  # plausible positions of the motors
        self._stopping = [True] * n
        self._reported = [UNREPORTED] * n  # last reported statuses
        self._released = [True] * n  # motors without power by our command
        self._unset: set[int] = set()
        self._behind: dict[int, Frame] = {}  # frame to send after the joint's first setpoint
        self._backlog = False
        self.samples = self.replies.samples(self.replies.awaited.freshness, self._stopping, ())
        """Samples of the last tick."""

    def start(self, now: float, renewed: Sequence[int] | None = None) -> None:
        """Start cyclic operation. renewed: joints whose motors were just set up (None: all)."""
        self._now = now
        self._presence.begin(now)
        fresh = range(len(self.names)) if renewed is None else renewed
        self._unset -= set(fresh)
        self._setpoints.forget(fresh)
        jumped = self.replies.plausibility.jumped
        self.replies.plausibility.forget([i for i in fresh if jumped[i]])
        self._port.begin(now)
        self.replies.awaited.start_anew()
        self._port.read_queued()
        if renewed is None:
            self._port.events()
        self.replies.pending = [0] * len(self.names)

    def distrust(self, joints: Iterable[int]) -> None:
        """Count the motors of these joints as not set up, until they are set up again."""
        self._unset |= set(joints)

    def unfit(self) -> list[int]:
        """Joints whose motors must be set up again before a reset can succeed."""
        silent = (i for i, status in enumerate(self._reported) if status.state is State.UNKNOWN)
        return sorted({*self._unset, *silent})

    def sync(self, now: float) -> None:
        """Begin a tick: read the frames since the last one, then send requests to all motors."""
        asked_s, self._now, self._port.now = self._clock(), now, now
        gap_s = self._presence.gap_s(now)
        if gap_s is not None:
            text = f"the motors received nothing from it for {1000 * gap_s:.0f} ms"
            self._port.report(Event(Kind.ABSENT, text))
            self._presence.lost()
        awaited = self.replies.awaited
        awaited.expect_none()
        self._backlog = not self._port.read_queued()
        if self._backlog or awaited.punctuality.leaves_out(now):
            self._backlog = True
            return
        self.replies.begin_tick(now, asked_s)
        if not self._language.asks_by_setpoint:
            self._port.send(self._language.requests)
        elif self._port.send(self._setpoint_requests()):
            self._presence.beaten(now)

    def _setpoint_requests(self) -> list[Frame]:
        """Setpoints to the motors that have one, requests to the others."""
        known = [self._setpoints.known(i) for i in range(len(self.names))]
        self.replies.by_setpoint = known
        pairs = zip(known, self._language.setpoints, self._language.requests, strict=True)
        return [setpoint if has else request for has, setpoint, request in pairs]

    def collect(self, deadline: float) -> Samples:
        """Read until all motors have answered, or until `deadline` on `clock`. If not all queued
        frames could be read before the requests, no frame counts as an answer."""
        awaited, frames_left = self.replies.awaited, FRAMES_PER_PASS
        if self._backlog:
            awaited.expect_none()
            self._port.read_queued()
            awaited.miss_all()
            frames_left = 0
        while frames_left and (left_s := awaited.left_s(deadline, self._clock())) is not None:
            if not self._port.take_next(left_s):
                break
            frames_left -= 1
        self._judge()
        self._port.end_tick()
        self.samples = self.replies.samples(awaited.finish(), self._held(), self._port.events())
        return self.samples

    def _held(self) -> list[bool]:
        """Joints commanded to stop whose motors have acknowledged it."""
        pairs = zip(self._stopping, self.replies.acknowledged, strict=True)
        return [stopping and answered > 0 for stopping, answered in pairs]

    def _judge(self) -> None:
        """Report events from the motors' statuses and the counts of their answers."""
        punctuality = self.replies.awaited.punctuality
        for kind, answers, text in (
            (Kind.TWO_DRIVES, punctuality.twice, "two motors answer under this ID"),
            (Kind.OLD_SAMPLES, punctuality.old, "it answers when no request is sent"),
        ):
            if answers:
                joints = self._named(self.replies.awaited.joints_of(answers))
                self._port.report(Event(kind, f"{joints}: {text}"))
        self._unset |= self._port.zeroed
        if not self._language.outputs:
            # Its only encoder is no longer trusted; its holding position has to be found anew.
            for i, jumped in enumerate(self.replies.plausibility.jumped):
                if jumped and i not in self._unset:
                    self._unset.add(i)
                    text = f"{self.names[i]}: its position contradicts its velocity"
                    self._port.report(Event(Kind.ERROR, text))
        for i, status in enumerate(self.replies.statuses):
            before, self._reported[i] = self._reported[i], status
            news, text = news_of(before, status, released=self._released[i])
            if news is Kind.RESTARTED:
                self._unset.add(i)
            if news is not None:
                self._port.report(Event(news, f"{self.names[i]}: {text}"))

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        ask: bool = False,
    ) -> None:
        """Send every motor its next command towards `power` and its target velocity.

        velocity: (n,) rad/s at the link. A motor that is not enabled, or has another target, gets
        zero. A velocity that is not finite stops all motors and is reported as an event.
        """
        n = len(self.names)
        targets = [power] * n if isinstance(power, PowerTarget) else list(power)
        wanted = velocity.tolist()
        if not all(map(math.isfinite, wanted)):
            self._port.report(
                Event(Kind.BAD_SETPOINT, f"target velocity is not finite: {velocity}")
            )
            targets, wanted = [_STOP] * n, [0.0] * n
        if self._presence.absent:
            targets = [_STOP if target is _ON else target for target in targets]
            self._presence.begin(self._now)
        self._port.report(
            *self._stops.step(self._now, targets, self.samples, velocity, self._released)
        )
        self._measured = self.replies.witnessed.tolist()
        frames: list[Frame] = []
        for i, next_velocity in enumerate(self._stops.setpoints(targets, wanted, self._last)):
            self._command_one(i, targets[i], next_velocity, reset, frames)
        if (frames or not self._language.asks_by_setpoint) and self._port.send(frames):
            self._presence.beaten(self._now)

    def _command_one(
        self, i: int, target: PowerTarget, velocity: float, reset: bool, frames: list[Frame]
    ) -> None:
        """Append the frames of one motor: its setpoint, then a command if its power state differs
        from its target. A motor that is enabled follows its last setpoint, so that comes first."""
        status = self.replies.statuses[i]
        state = status.state
        runs = state is State.ON and i not in self._unset
        self._last[i] = velocity if runs else 0.0
        if (target is not _ON) is not self._stopping[i]:
            self._stopping[i], self.replies.acknowledged[i] = target is not _ON, 0
        if self._port.taken_over and not self._setpoints.known(i):
            return  # the guardian continues until its setpoint is heard and adopted
        # A motor that lost its power, or reports so, without our command keeps its setpoint until
        # a reset.
        powered = state in (State.ON, State.UNKNOWN) or target is _STOP
        here, current = self._measured[i], float(self.samples.current[i])
        asks = self._language.asks_by_setpoint
        at = self._setpoints.at(i, here)  # with the setpoint that it has
        if not self._setpoints.write(i, self._last[i], here, current, powered=powered):
            return
        if not asks:
            at = self._setpoints.at(i, here)
            frames.append(self._language.setpoints[i])
        if (behind := self._behind.pop(i, None)) is not None:
            frames.append(behind)
        self.replies.pending[i] = int(not asks)  # a lost feedback is not awaited any longer
        commands, releases = self._power_commands(i, target, status, reset, at=at)
        self._released[i] = releases or (self._released[i] and state is not State.ON)
        frames += commands
        self.replies.pending[i] += len(commands)

    def _power_commands(
        self, i: int, target: PowerTarget, status: Status, reset: bool, *, at: bool
    ) -> tuple[Sequence[Frame], bool]:
        """Commands of a motor in addition to its setpoint, and whether they disable it; at: the
        setpoint is at its position."""
        watches, state = self._stops.watches, status.state
        if target is _OFF or watches.each[i].cut:
            # A moving motor is ramped down first; one that runs on is disabled in any state.
            on = state is State.ON or watches.each[i].cut
            off = on and watches.may_be_off(i)
            return ((self._language.disabling(i),) if off else ()), off
        if state is State.FAILED:
            return ((self._language.clearing(i),) if reset else ()), False
        enables = target is _ON and state is State.OFF and i not in self._unset
        # An unheard motor may have moved meanwhile, and would jump back.
        here = at and bool(self.samples.fresh[i])
        return (self._language.enabling(i) if enables and here else ()), False

    def unproved(self) -> tuple[str, ...]:
        """Joints commanded to stop and not confirmed at standstill since."""
        return tuple(self.names[i] for i in self._stops.watches.unproved)

    def objections(self) -> tuple[Objection, ...]:
        """Reasons against arming that are not visible in the samples."""
        awaited, found = self.replies.awaited, []
        if not self._port.guarded:
            found.append(Objection("heartbeats", NO_GUARDIAN))
        if self._unset:
            found.append(Objection("set-up", f"{self._named(sorted(self._unset))}: not set up"))
        if doubted := awaited.joints_of(awaited.punctuality.doubted(self._now)):
            text = f"still checking whether {self._named(doubted)} answers late: ask again"
            found.append(Objection("samples", text))
        return tuple(found)

    def acknowledge(self) -> None:
        """Do nothing: every feedback contains the present errors."""

    def quick_stop(self) -> None:
        """Command all motors to hold immediately."""
        self._port.send(self._setpoints.stop())

    @property
    def master_timeout_passed(self) -> bool:
        """False: the daemon never falls silent for these motors."""
        return False

    def end(self) -> None:
        """Do nothing: these motors have no pending setpoints."""

    def _named(self, joints: Iterable[int]) -> str:
        return ", ".join(self.names[i] for i in joints)
