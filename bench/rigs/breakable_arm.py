"""An arm in lockstep, and what can be broken about it: where faults are made to happen."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import msgspec
import numpy as np

from bench.contact_free import MOTION
from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration, Joint, Sinusoid, Trajectory
from daemon.modes.table import Event, Mode
from daemon.tick.tick import ON_TIME, Wakeup
from drivers.can.wire import Wire
from drivers.cia402 import FAULT_STATES, QUICK_STOP
from simulator.sensors import Readings

ELBOW, YAW, PITCH = 2, 5, 6  # joints that are disturbed; nodes are one more

Fault = Callable[["BreakableArm"], Iterator[None]]
"""What is between two `yield`s happens before a tick; when it is closed, the cause is gone."""


def for_ever() -> Iterator[None]:
    """As long as anybody asks."""
    while True:
        yield


@dataclass(slots=True)
class BreakableArm:
    """The rig, and what can be broken about it."""

    rig: Rig
    wire: FaultyWire
    first_pose: np.ndarray
    late_s: float = 0.0
    """How late the next ticks begin."""
    left_out: int = 0
    """Deadlines that this costs, each time."""
    sense: Callable[[Readings], Readings] = field(default=lambda readings: readings)
    """What becomes of the readings of the drives' sensors."""

    @property
    def period_s(self) -> float:
        """T."""
        return self.rig.robot.configuration.period_s

    def tick(self) -> None:
        """One tick of the daemon, on time or late."""
        rig, self.wire.sent[:] = self.rig, []
        if self.late_s:
            rig.arm.advance(rig.arm.now + self.left_out * self.period_s)
            rig.ticks += self.left_out
        wakeup = Wakeup(lateness_s=self.late_s, left_out=self.left_out) if self.late_s else ON_TIME
        rig.tick.begin(rig.time_s)
        if not self.wire.sent:
            rig.arm.advance(rig.arm.now + self.period_s)  # without a SYNC nobody else moves it
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
            faulty = [
                state for state in self.rig.tick.drives.samples.states if state in FAULT_STATES
            ]
            if self.rig.mode is mode and not faulty:
                return
        raise AssertionError(f"{self.rig.mode}: {self.rig.tick.controller.machine.cause}")

    def setpoints(self) -> dict[int, tuple[int, int]]:
        """By node: the controlword and the target velocity [counts] that the last tick sent."""
        return {
            cob_id - 0x200: (
                data[0] | data[1] << 8,
                int.from_bytes(data[2:6], "little", signed=True),
            )
            for cob_id, data in self.wire.sent
            if 0x200 < cob_id < 0x280
        }

    @property
    def stops(self) -> bool:
        """Whether the last tick told every drive to quick-stop that can."""
        words = [word for word, _ in self.setpoints().values()]
        return len(words) == len(self.rig.arm.drives) and all(
            word & 0x0F in (0, QUICK_STOP) for word in words
        )

    @property
    def speed(self) -> float:
        """Of the plant's fastest motor, at the link [rad/s]; links may swing on in their gaps."""
        return float(np.abs(self.rig.arm.plant.theta_dot).max())

    @contextmanager
    def sensing(self, change: Callable[[Readings], Readings]) -> Iterator[None]:
        """The sensors report something else inside the block."""
        self.sense = change
        try:
            yield
        finally:
            self.sense = lambda readings: readings

    @contextmanager
    def losing(self, *cob_ids: int) -> Iterator[None]:
        """These frames do not reach the daemon inside the block."""
        self.wire.lost.update(cob_ids)
        try:
            yield
        finally:
            self.wire.lost.difference_update(cob_ids)

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


def _configured(c: Configuration) -> Configuration:
    """All joints move at once, to and fro; a wrist has narrow limits to be pushed out of, and a
    residual is implausible that the simulated hand can make."""

    def narrowed(index: int, joint: Joint) -> Joint:
        limits = joint.limits
        if index == YAW:
            limits = msgspec.structs.replace(limits, lower=-0.3, upper=0.3)
        return msgspec.structs.replace(joint, limits=limits)

    waves = {name: Sinusoid(amplitude=0.15, frequency_Hz=0.4) for name in MOTION}
    return msgspec.structs.replace(
        c,
        joints=[narrowed(i, joint) for i, joint in enumerate(c.joints)],
        trajectory=Trajectory(sinusoids=waves, ramp_s=0.2),
        estimator=msgspec.structs.replace(c.estimator, beside=()),
        supervisor=msgspec.structs.replace(c.supervisor, residual_margin=2.0),
    )


@contextmanager
def stage() -> Iterator[BreakableArm]:
    """A booted arm, off, on a bus that can be broken."""
    wires: list[FaultyWire] = []

    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire))
        return wires[0]

    with lockstep_rig(configure=_configured, between=between) as rig:
        made = BreakableArm(rig, wires[0], rig.arm.plant.q.copy())
        read = rig.arm.sensors.read
        rig.arm.sensors.read = lambda *state: made.sense(read(*state))  # type: ignore[method-assign]
        made.run(0.1)
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
    on.until(Mode.OFF, Event.RESET if on.rig.mode is Mode.FAULTED else Event.DISABLE)
    on.rig.arm.plant.place(on.first_pose)
    on.run(0.05)
