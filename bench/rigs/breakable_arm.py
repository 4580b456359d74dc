"""An arm in lockstep, and what can be broken about it: where faults are made to happen."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import repeat
from typing import Any

import can
import msgspec
import numpy as np

from bench.rigs.durand_arm import durand_rig
from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lines import OpenLine, virtual_line
from bench.rigs.lockstep import BEAM, DESK_ARM, OPENARM, ROMEO, Rig, lockstep_rig
from bench.rigs.speech import CANOPEN, DAMIAO_BUS, ROBSTRIDE_BUS, Speech
from daemon.config.schema import Configuration, Joint, Sinusoid, Trajectory
from daemon.modes.table import Event, Mode
from daemon.tick.telemetry import ON_TIME, Wakeup
from drivers.can.wire import EXTENDED, Frame, Wire
from drivers.canopen.ids import EMERGENCY
from programs.contactd.travels import travels
from simulator.sensors import Readings


@dataclass(frozen=True, slots=True)
class Make:
    """Drives of one make, and which of their joints are disturbed and how."""

    name: str
    rig: Callable[..., AbstractContextManager[Rig]]
    joint: int  # that is disturbed
    pushed: int  # that has narrow limits, to be pushed out of
    push_Nm: float
    hit_Nm: float
    saturated: int  # whose current is at its limit
    stuck: int  # whose current is stuck
    after_silence: str  # state in which a drive ends that has lost its master
    speech: Speech = CANOPEN
    ways: tuple[tuple[str, float], ...] = ()  # of joints with less room than the others [rad]


ROMEO_ARM = Make("romeo", partial(lockstep_rig, ROMEO), 2, 5, 1.4, 9.0, 6, 0, "QUICK_STOP_ACTIVE")
DESK = Make("desk arm", partial(lockstep_rig, DESK_ARM), 0, 1, 5.5, 9.0, 0, 1, "FAULT")
DURAND = Make("durand", durand_rig, 0, -1, 0.0, 0.0, 0, 0, "FAULT")
DAMIAO = Make(
    "damiao",
    partial(lockstep_rig, OPENARM),
    2,
    5,
    3.7,
    40.0,
    0,
    0,
    "ENABLED",
    DAMIAO_BUS,
    (("joint2", 0.04),),
)
ROBSTRIDE = Make(
    "robstride", partial(lockstep_rig, BEAM), 3, 5, 3.0, 0.0, 0, 0, "RUN", ROBSTRIDE_BUS
)
MAKES = (ROMEO_ARM, DESK, DURAND, DAMIAO, ROBSTRIDE)

#: Of a joint that is to be fast: as slow as its range allows, so that it is fast for longer.
FAST_HZ = 0.4

Fault = Callable[["BreakableArm"], Iterator[None]]
"""Cause, tick by tick: what is between two `yield`s happens before a tick; when it is
    closed, the cause is gone."""


def for_ever() -> Iterator[None]:
    """Endless yields: the fault lasts until it is closed."""
    while True:
        yield


def lasting(do: Callable[["BreakableArm"], object]) -> Fault:
    """Fault that is done once, and lasts."""

    def fault(on: "BreakableArm") -> Iterator[None]:
        do(on)
        yield from for_ever()

    return fault


def once(do: Callable[["BreakableArm"], object]) -> Fault:
    """Fault that is done once, and is over after a tick."""

    def fault(on: "BreakableArm") -> Iterator[None]:
        do(on)
        yield

    return fault


def throughout(
    block: Callable[["BreakableArm"], AbstractContextManager[None]], ticks: int | None = None
) -> Fault:
    """Fault that is there inside a block, for so many ticks, or until it is closed."""

    def fault(on: "BreakableArm") -> Iterator[None]:
        with block(on):
            yield from for_ever() if ticks is None else repeat(None, ticks)

    return fault


@dataclass(slots=True)
class BreakableArm:
    """The rig, and what can be broken about it."""

    make: Make
    rig: Rig
    wire: FaultyWire
    first_pose: np.ndarray
    before: list[Frame] = field(default_factory=list)  # sent in the tick before
    late_s: float = 0.0  # How late the next ticks begin.
    left_out: int = 0  # Deadlines that this costs, each time.
    changes: list[Callable[[Readings], Readings]] = field(default_factory=list)
    """Changes of the readings of the drives' sensors, one after the other."""

    @property
    def period_s(self) -> float:
        """T."""
        return self.rig.robot.configuration.period_s

    @property
    def joint(self) -> int:
        """The joint that is disturbed."""
        return self.make.joint

    @property
    def drives(self) -> tuple[Any, ...]:
        """Drives of the arm, as the daemon knows them."""
        return self.rig.robot.configuration.joint_drives

    @property
    def drive(self) -> Any:
        """That of the disturbed joint."""
        return self.drives[self.joint]

    @property
    def simulated(self) -> Any:
        """The same at the other end of the bus."""
        return self.make.speech.simulated(self.rig.arm, self.joint)

    @property
    def states(self) -> set[str]:
        """States of all simulated drives."""
        return self.make.speech.states(self.rig.arm)

    def answers(self, drive: Any) -> list[int]:
        """Identifiers of a drive's samples."""
        return self.make.speech.answers(drive)

    def say(self, cob_id: int, data: bytes = b"", *, error: bool = False) -> None:
        """Let another node's frame arrive before the next SYNC."""
        self.rig.line.far.send(
            can.Message(
                arbitration_id=cob_id & ~EXTENDED,
                data=data,
                is_extended_id=bool(cob_id & EXTENDED),
                is_error_frame=error,
            )
        )

    def tick(self) -> None:
        """One tick of the daemon, on time or late."""
        rig, self.before = self.rig, list(self.wire.sent)
        self.wire.sent[:] = []
        if self.late_s:
            rig.arm.advance(rig.arm.now + self.left_out * self.period_s)
            rig.ticks += self.left_out
        wakeup = Wakeup(lateness_s=self.late_s, left_out=self.left_out) if self.late_s else ON_TIME
        rig.tick.begin(rig.time_s)
        speech = self.make.speech
        if speech.request not in {speech.kin(can_id) for can_id, _ in self.wire.sent}:
            rig.arm.advance(rig.arm.now + self.period_s)  # nothing else moves it then
        self.wire.pass_tick()
        rig.lockstep.pump()
        rig.guard()
        rig.tick.finish(0.0, wakeup)
        rig.ticks += 1

    def silence(self) -> None:
        """The time of a tick after the program has ended: the drives hear no master."""
        self.wire.sent[:] = []
        self.rig.arm.advance(self.rig.arm.now + self.period_s)
        self.rig.guard()
        self.rig.lockstep.pump()

    def alone(self, seconds: float) -> None:
        """Time without the daemon."""
        for _ in range(round(seconds / self.period_s)):
            self.silence()

    def run(self, seconds: float) -> None:
        """Undisturbed, if nothing was left broken."""
        for _ in range(round(seconds / self.period_s)):
            self.tick()

    def until(self, mode: Mode, event: Event) -> None:
        """Ask for `event`, and wait for `mode` and for drives without a fault."""
        self.rig.request(event)
        for _ in range(100):
            self.tick()
            faulty = any(drive.condition.in_fault for drive in self.rig.drives.samples.drives)
            if self.rig.mode is mode and not faulty:
                return
        raise AssertionError(f"{self.rig.mode}: {self.rig.tick.controller.machine.cause}")

    def setpoints(self) -> dict[int, tuple[int, int]]:
        """Whether the last tick commanded a drive to follow (0 if not), and its target velocity
        [counts], by node."""
        return self.make.speech.setpoints(self.drives, self.wire.sent)

    @property
    def stops(self) -> bool:
        """True if the last tick commanded each drive that is set up to stop, and none to move
        (others get SDOs); or if nothing but silence is left."""
        if self.rig.drives.silenced:
            return True
        setpoints, drives = self.setpoints(), self.rig.drives
        by_sdo: tuple[str, ...] = getattr(drives, "restarted", tuple)()
        others = {drive.node for drive in self.drives if drive.name not in by_sdo}
        before = self.make.speech.setpoints(self.drives, self.before)

        def brakes(node: int, counts: int) -> bool:
            return node in before and abs(counts) < abs(before[node][1])

        ramps = self.make.speech.stops_by_ramp
        moving = [
            node
            for node, (follows, counts) in setpoints.items()
            if (follows or counts) and not (ramps and brakes(node, counts))
        ]
        return not moving and others <= setpoints.keys()

    @property
    def mute(self) -> bool:
        """True while the bus takes no frame of ours."""
        return self.wire.sending is not None or self.wire.queue is not None

    @property
    def joints(self) -> np.ndarray:
        """True positions of motors and links, one row each (2, n) [rad at the link]."""
        return np.array((self.rig.arm.plant.theta, self.rig.arm.plant.q))

    @property
    def travel(self) -> np.ndarray:
        """Way that each joint may go after a fault, as `contactd check` prints it (n,) [rad]."""
        return np.array([travel.total for travel in travels(self.rig.robot.configuration)])

    @property
    def own_travel(self) -> np.ndarray:
        """The same, where a drive goes its own way (n,) [rad]."""
        return np.array([travel.own for travel in travels(self.rig.robot.configuration)])

    @property
    def speed(self) -> float:
        """Speed of the fastest motor, at the link [rad/s]; links may swing on in their gaps."""
        return float(np.abs(self.rig.arm.plant.theta_dot).max())

    @contextmanager
    def sensing(self, change: Callable[[Readings], Readings]) -> Iterator[None]:
        """The sensors report something else inside the block."""
        self.changes.append(change)
        try:
            yield
        finally:
            self.changes.remove(change)

    def sense(self, readings: Readings) -> Readings:
        """Readings as the sensors report them."""
        for change in self.changes:
            readings = change(readings)
        return readings

    @contextmanager
    def saying(self, change: Callable[[int, bytes], bytes]) -> Iterator[None]:
        """Frames of the drives reach the daemon changed inside the block."""
        self.wire.changes.append(change)
        try:
            yield
        finally:
            self.wire.changes.remove(change)

    @contextmanager
    def at(self, joint: int) -> Iterator[None]:
        """Another joint is the disturbed one inside the block."""
        make, self.make = self.make, replace(self.make, joint=joint)
        try:
            yield
        finally:
            self.make = make

    def losing(self, *cob_ids: int) -> AbstractContextManager[None]:
        """These frames do not reach the daemon inside the block."""
        return _among(self.wire.lost, cob_ids)

    def delaying(self, *cob_ids: int) -> AbstractContextManager[None]:
        """These frames reach the daemon a tick later inside the block."""
        return _among(self.wire.late, cob_ids)

    def doubling(self, *cob_ids: int) -> AbstractContextManager[None]:
        """These frames come twice inside the block."""
        return _among(self.wire.twice, cob_ids)

    def not_sending(self, *cob_ids: int) -> AbstractContextManager[None]:
        """These frames of ours reach no node inside the block."""
        return _among(self.wire.unsent, cob_ids)

    @contextmanager
    def off_the_bus(self) -> Iterator[None]:
        """Frames of ours wait inside the block, as many as an interface queues, and go out then."""
        self.wire.queue = []
        try:
            yield
        finally:
            self.wire.flush()

    @contextmanager
    def raising(
        self, sending: Exception | None = None, receiving: Exception | None = None
    ) -> Iterator[None]:
        """The bus fails inside the block."""
        self.wire.sending, self.wire.receiving = sending, receiving
        try:
            yield
        finally:
            self.wire.sending = self.wire.receiving = None

    @contextmanager
    def late(self, seconds: float) -> Iterator[None]:
        """Ticks begin so late inside the block."""
        self.late_s, self.left_out = seconds, int(seconds / self.period_s)
        try:
            yield
        finally:
            self.late_s, self.left_out = 0.0, 0


@contextmanager
def _among(frames: set[int], cob_ids: tuple[int, ...]) -> Iterator[None]:
    """These are among the frames inside the block."""
    frames.update(cob_ids)
    try:
        yield
    finally:
        frames.difference_update(cob_ids)


def _configured(c: Configuration, make: Make, speed: float) -> Configuration:
    """All joints move at once, to and fro; one has narrow limits to be pushed out of, and a
    residual is implausible that the simulated hand can make. speed: of the disturbed joint, of its
    velocity limit; 0 is that of the others."""

    def narrowed(index: int, joint: Joint) -> Joint:
        limits = joint.limits
        if index == make.pushed:
            limits = msgspec.structs.replace(limits, lower=-0.3, upper=0.3)
        return msgspec.structs.replace(joint, limits=limits)

    ways = dict.fromkeys(c.joint_names, 0.15) | dict(make.ways)
    waves = {name: Sinusoid(amplitude=way, frequency_Hz=0.4) for name, way in ways.items()}
    if speed:
        joint = c.joints[make.joint]
        amplitude = speed * joint.limits.velocity / (2.0 * np.pi * FAST_HZ)
        waves[joint.name] = Sinusoid(amplitude=amplitude, frequency_Hz=FAST_HZ)
    return msgspec.structs.replace(
        c,
        joints=[narrowed(i, joint) for i, joint in enumerate(c.joints)],
        trajectory=Trajectory(sinusoids=waves, ramp_s=0.2),
        estimator=msgspec.structs.replace(c.estimator, beside=()),
        supervisor=msgspec.structs.replace(c.supervisor, residual_margin=2.0),
    )


@contextmanager
def stage(
    make: Make = ROMEO_ARM, line: OpenLine = virtual_line, speed: float = 0.0
) -> Iterator[BreakableArm]:
    """A booted arm, off, on a bus that can be broken. speed: of the disturbed joint as it tracks,
    of its velocity limit; 0: as slow as the others."""
    with breakable(make, configure=lambda c: _configured(c, make, speed), line=line) as made:
        made.run(0.1)
        yield made


@contextmanager
def breakable(make: Make, **both_ends: Any) -> Iterator[BreakableArm]:
    """Arm of a make's rig, to which `both_ends` go; its bus and its sensors can be broken."""
    wires: list[FaultyWire] = []

    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire, make.speech.kin))
        return wires[0]

    with make.rig(between=between, **both_ends) as rig:
        made = BreakableArm(make, rig, wires[0], rig.arm.plant.q.copy())
        read = rig.arm.sense
        rig.arm.sense = lambda *state: made.sense(read(*state))
        yield made


def start(on: BreakableArm, *, armed: bool) -> None:
    """From off: enable, move all joints, and arm if asked."""
    on.until(Mode.HOLDING, Event.ENABLE)
    on.rig.request(Event.START)
    on.run(0.25)
    assert on.rig.mode is Mode.TRACKING, on.rig.tick.controller.machine.cause
    if armed:
        # Whether it would be allowed so soon after the fault before is not what is asked here.
        on.rig.tick.controller.machine.arm("the bench")


def restore(on: BreakableArm) -> None:
    """Off, with the arm where it was at first, and no fault latched."""
    on.run(0.05)
    if on.rig.mode is not Mode.FAULTED:
        on.until(Mode.OFF, Event.DISABLE)
    on.rig.arm.plant.place(on.first_pose)
    if on.rig.samples.motor_position is None and on.rig.mode is not Mode.FAULTED:
        # Motors without encoders, that were moved unseen, are apart from their links until a reset.
        on.say(EMERGENCY + on.drive.node, b"\x10\x43\1\0\0\0\0\0")
        on.tick()
        on.say(EMERGENCY + on.drive.node, bytes(8))
    on.run(0.3)
    if on.rig.mode is Mode.FAULTED:
        on.rig.reset()
