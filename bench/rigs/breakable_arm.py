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
from bench.rigs.lockstep import DESK_ARM, ROMEO, Rig, lockstep_rig
from daemon.config.schema import Configuration, Joint, Sinusoid, Trajectory
from daemon.config.travels import travels
from daemon.modes.table import Event, Mode
from daemon.tick.telemetry import ON_TIME, Wakeup
from drivers.can.wire import Wire
from drivers.canopen.cia402 import QUICK_STOP
from drivers.canopen.codec import receive_pdos
from drivers.canopen.ids import EMERGENCY, SYNC
from drivers.canopen.settings import CanopenDrive
from simulator.drive import Drive as SimulatedDrive
from simulator.sensors import Readings
from simulator.state_machine import State


@dataclass(frozen=True, slots=True)
class Make:
    """Drives of one make, and which of their joints are disturbed and how."""

    name: str
    rig: Callable[..., AbstractContextManager[Rig]]
    joint: int  # that is disturbed
    pushed: int  # that has narrow limits, to be pushed out of
    push_Nm: float
    saturated: int  # whose current is at its limit
    stuck: int  # whose current is stuck
    after_silence: State  # Where a drive ends that has lost its master.


ROMEO_ARM = Make("romeo", partial(lockstep_rig, ROMEO), 2, 5, 1.4, 6, 0, State.QUICK_STOP_ACTIVE)
DESK = Make("desk arm", partial(lockstep_rig, DESK_ARM), 0, 1, 5.5, 0, 1, State.FAULT)
DURAND = Make("durand", durand_rig, 0, -1, 0.0, 0, 0, State.FAULT)
MAKES = (ROMEO_ARM, DESK, DURAND)

#: Of a joint that is to be fast: as slow as its range allows, so that it is fast for longer.
FAST_HZ = 0.4

Fault = Callable[["BreakableArm"], Iterator[None]]
"""What is between two `yield`s happens before a tick; when it is closed, the cause is gone."""


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
    late_s: float = 0.0  # How late the next ticks begin.
    left_out: int = 0  # Deadlines that this costs, each time.
    changes: list[Callable[[Readings], Readings]] = field(default_factory=list)
    """What becomes of the readings of the drives' sensors, one after the other."""

    @property
    def period_s(self) -> float:
        """T."""
        return self.rig.robot.configuration.period_s

    @property
    def joint(self) -> int:
        """The joint that is disturbed."""
        return self.make.joint

    @property
    def drives(self) -> tuple[CanopenDrive, ...]:
        """Drives of the arm, as the daemon knows them."""
        return self.rig.robot.configuration.joint_drives

    @property
    def drive(self) -> CanopenDrive:
        """That of the disturbed joint."""
        return self.drives[self.joint]

    @property
    def simulated(self) -> SimulatedDrive:
        """The same at the other end of the bus."""
        return self.rig.arm.drives[self.joint]

    def say(self, cob_id: int, data: bytes = b"", *, error: bool = False) -> None:
        """Let a frame of somebody else arrive before the next SYNC."""
        self.rig.line.far.send(
            can.Message(
                arbitration_id=cob_id, data=data, is_extended_id=False, is_error_frame=error
            )
        )

    def tick(self) -> None:
        """One tick of the daemon, on time or late."""
        rig, self.wire.sent[:] = self.rig, []
        if self.late_s:
            rig.arm.advance(rig.arm.now + self.left_out * self.period_s)
            rig.ticks += self.left_out
        wakeup = Wakeup(lateness_s=self.late_s, left_out=self.left_out) if self.late_s else ON_TIME
        rig.tick.begin(rig.time_s)
        if all(cob_id != SYNC for cob_id, _ in self.wire.sent):
            rig.arm.advance(rig.arm.now + self.period_s)  # without a SYNC nobody else moves it
        self.wire.pass_tick()
        rig.lockstep.pump()
        rig.tick.finish(0.0, wakeup)
        rig.ticks += 1

    def silence(self) -> None:
        """The time of a tick after the program has ended: the drives hear no master."""
        self.wire.sent[:] = []
        self.rig.arm.advance(self.rig.arm.now + self.period_s)
        self.rig.lockstep.pump()

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
        """Controlword and target velocity [counts] that the last tick sent, by node."""
        sent, found = dict(self.wire.sent), {}
        for drive in self.drives:
            told: dict[str, int] = {}
            for pdo in receive_pdos(drive):
                if pdo.cob_id in sent:
                    counts = pdo.layout.unpack(sent[pdo.cob_id])
                    told |= zip((field.entry for field in pdo.fields), counts, strict=True)
            if told:
                found[drive.node] = told["controlword"], told["target_velocity"]
        return found

    @property
    def stops(self) -> bool:
        """True if the last tick told every drive to stop that is set up, and none to move (others
        are told by SDO); or if nothing but silence is left."""
        if self.rig.drives.silenced:
            return True
        setpoints, drives = self.setpoints(), self.rig.drives
        by_sdo = {
            node
            for name, node in zip(drives.names, drives.nodes, strict=True)
            if name in drives.restarted()
        }
        halted = {
            node
            for node, (word, counts) in setpoints.items()
            if word & 0x0F in (0, QUICK_STOP) and not counts
        }
        return setpoints.keys() == halted and halted | by_sdo == set(drives.nodes)

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
        """How far each joint may go after a fault, as `contactd check` prints it (n,) [rad]."""
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
        """These frames of ours reach nobody inside the block."""
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

    waves = {name: Sinusoid(amplitude=0.15, frequency_Hz=0.4) for name in c.joint_names}
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
        wires.append(FaultyWire(wire))
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
