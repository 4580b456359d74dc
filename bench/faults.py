"""Every condition of the supervisor's table, made to happen in lockstep.

A fault is a generator: what is between two `yield`s happens before a tick, and when it is closed,
the cause is gone. Faults of processes (SIGSTOP, SIGKILL, a second daemon) are no part of it.
"""

import errno
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, cast

import can
import msgspec
import numpy as np

from bench.contact_free import MOTION
from bench.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration, Joint, Sinusoid, Trajectory
from daemon.cycle import ON_TIME, Wakeup
from daemon.modes import Event, Mode
from daemon.observation import FAULT_STATES
from daemon.supervisor import Condition
from daemon.trajectory import Follower, Reference
from drivers.cia402 import QUICK_STOP
from simulator.sensors import Readings
from simulator.state_machine import Event as DriveEvent

ELBOW, YAW, PITCH = 2, 5, 6  # joints that are disturbed; nodes are one more
OVER_CURRENT, UNDER_VOLTAGE, OVER_TEMPERATURE = 0x2310, 0x3220, 0x4310
ERROR = {"is_extended_id": False, "is_error_frame": True}


class FaultyBus:
    """Stands between the daemon and its bus: loses frames, adds frames, and raises what python-can
    raises."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.lost: set[int] = set()
        self.added: list[can.Message] = []
        self.sending: Exception | None = None
        self.receiving: Exception | None = None
        self.sent: list[tuple[int, bytes]] = []
        """Since the last tick began."""

    @property
    def channel_info(self) -> str:
        """For error messages."""
        return f"faulty {self._bus.channel_info}"

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As BusABC.recv."""
        if self.receiving:
            raise self.receiving
        if self.added:
            return self.added.pop(0)
        while (message := self._bus.recv(timeout)) is not None:
            if message.arbitration_id not in self.lost:
                return message
        return None

    def send(self, message: can.Message) -> None:
        """As BusABC.send."""
        if self.sending:
            raise self.sending
        self.sent.append((message.arbitration_id, bytes(message.data)))
        self._bus.send(message)

    def add(self, cob_id: int, data: bytes = b"", **kind: bool) -> None:
        """Let a frame of somebody else arrive before the next SYNC."""
        message = can.Message(
            arbitration_id=cob_id, data=data, **({"is_extended_id": False} | kind)
        )
        self.added.append(message)


@dataclass(slots=True)
class Stage:
    """The rig, and what can be broken about it."""

    rig: Rig
    bus: FaultyBus
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
        rig, self.bus.sent[:] = self.rig, []
        if self.late_s:
            rig.arm.advance(rig.arm.now + self.left_out * self.period_s)
            rig.ticks += self.left_out
        wakeup = Wakeup(lateness_s=self.late_s, left_out=self.left_out) if self.late_s else ON_TIME
        rig.cycle.begin(rig.time_s)
        if not self.bus.sent:
            rig.arm.advance(rig.arm.now + self.period_s)  # without a SYNC nobody else moves it
        rig.lockstep.pump()
        rig.cycle.finish(0.0, wakeup)
        rig.ticks += 1

    def run(self, seconds: float) -> None:
        """Undisturbed, if nothing was left broken."""
        for _ in range(round(seconds / self.period_s)):
            self.tick()

    def until(self, mode: Mode, event: Event) -> None:
        """Ask for `event`, and wait for `mode` and for drives without a fault."""
        self.rig.request(event)
        for _ in range(100):
            self.tick()
            faulty = [state for state in self.rig.cycle.arm.samples.states if state in FAULT_STATES]
            if self.rig.mode is mode and not faulty:
                return
        raise AssertionError(f"{self.rig.mode}: {self.rig.cycle.controller.machine.cause}")

    def setpoints(self) -> dict[int, tuple[int, int]]:
        """By node: the controlword and the target velocity [counts] that the last tick sent."""
        return {
            cob_id - 0x200: (
                data[0] | data[1] << 8,
                int.from_bytes(data[2:6], "little", signed=True),
            )
            for cob_id, data in self.bus.sent
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
        self.bus.lost.update(cob_ids)
        try:
            yield
        finally:
            self.bus.lost.difference_update(cob_ids)

    @contextmanager
    def raising(
        self, sending: Exception | None = None, receiving: Exception | None = None
    ) -> Iterator[None]:
        """The bus fails inside the block."""
        self.bus.sending, self.bus.receiving = sending, receiving
        try:
            yield
        finally:
            self.bus.sending = self.bus.receiving = None

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
def stage() -> Iterator[Stage]:
    """A booted arm, off, on a bus that can be broken."""
    buses: list[FaultyBus] = []

    def between(near: can.BusABC) -> Any:
        buses.append(FaultyBus(near))
        return buses[0]

    with lockstep_rig(configure=_configured, bus=between) as rig:
        made = Stage(rig, buses[0], rig.arm.plant.q.copy())
        read = rig.arm.sensors.read
        rig.arm.sensors.read = lambda *state: made.sense(read(*state))  # type: ignore[method-assign]
        made.run(0.1)
        yield made


def start(on: Stage, *, armed: bool) -> None:
    """From off: enable, move all joints, and arm if asked."""
    on.until(Mode.HOLDING, Event.ENABLE)
    on.rig.request(Event.START)
    on.run(0.25)
    assert on.rig.mode is Mode.TRACKING, on.rig.cycle.controller.machine.cause
    if armed:
        # Whether it would be allowed so soon after the fault before is not what is asked here.
        on.rig.cycle.controller.machine.arm("the bench")


def restore(on: Stage) -> None:
    """Off, with the arm where it was at first, and no fault latched."""
    on.run(0.05)
    on.until(Mode.OFF, Event.RESET if on.rig.mode is Mode.FAULTED else Event.DISABLE)
    on.rig.arm.plant.place(on.first_pose)
    on.run(0.05)


# --- the faults ---------------------------------------------------------------------------------

Fault = Callable[[Stage], Iterator[None]]


def _for_ever() -> Iterator[None]:
    while True:
        yield


def one_pdo_missing(on: Stage) -> Iterator[None]:
    with on.losing(0x281 + ELBOW):
        yield


def pdos_stale(on: Stage) -> Iterator[None]:
    with on.losing(0x181 + ELBOW, 0x281 + ELBOW):
        yield from _for_ever()


def pdos_stale_on_a_late_machine(on: Stage) -> Iterator[None]:
    with on.losing(0x181 + ELBOW, 0x281 + ELBOW), on.late(0.012):
        for _ in range(4):
            yield


def heartbeat_lost(on: Stage) -> Iterator[None]:
    with on.losing(0x701 + ELBOW):
        yield from _for_ever()


def _emergency(code: int) -> Fault:
    def fault(on: Stage) -> Iterator[None]:
        on.bus.add(0x081 + ELBOW, code.to_bytes(2, "little") + bytes([1, 0, 0, 0, 0, 0]))
        yield
        on.bus.add(0x081 + ELBOW, bytes(8))  # it is over

    return fault


def fault_bit(on: Stage) -> Iterator[None]:
    with on.losing(0x081 + ELBOW):  # no emergency message: the statusword alone
        on.rig.arm.drives[ELBOW].fault(OVER_CURRENT, "over-current")
        yield from _for_ever()


def emergency_stop(on: Stage) -> Iterator[None]:
    on.rig.arm.drives[ELBOW].axis.happen(DriveEvent.DISABLE_VOLTAGE)
    yield


def left_operational(on: Stage) -> Iterator[None]:
    on.rig.arm.drives[ELBOW].on_nmt(128)
    yield from _for_ever()


def reboot(on: Stage) -> Iterator[None]:
    on.rig.arm.drives[ELBOW].boot()
    yield from _for_ever()


def _foreign(cob_id: int, data: bytes = b"") -> Fault:
    def fault(on: Stage) -> Iterator[None]:
        on.bus.add(cob_id, data)
        yield

    return fault


def _full_queue() -> Exception:
    return can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)


def one_enobufs(on: Stage) -> Iterator[None]:
    with on.raising(_full_queue()):
        yield


def enobufs(on: Stage) -> Iterator[None]:
    with on.raising(_full_queue()):
        for _ in range(5):
            yield


def bus_down(on: Stage) -> Iterator[None]:
    down = can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN)
    with on.raising(down, down):
        for _ in range(20):
            yield


def old_frames(on: Stage) -> Iterator[None]:
    """The bus returns, and every drive's answers of the last half second come at once."""
    drives = on.rig.arm.drives
    for _ in range(4):
        for _ in range(50):
            for drive in drives:
                on.bus.add(0x180 + drive.node, bytes(8))
                on.bus.add(0x280 + drive.node, bytes(8))
        yield


def error_passive(on: Stage) -> Iterator[None]:
    on.bus.add(0x004, b"\0\x20\0\0\0\0\0\0", **ERROR)
    yield


def bus_off(on: Stage) -> Iterator[None]:
    on.bus.add(0x040, bytes(8), **ERROR)
    with on.raising(_full_queue()):
        yield


def adapter_gone(on: Stage) -> Iterator[None]:
    with on.raising(
        OSError(errno.ENODEV, "No such device"), OSError(errno.ENODEV, "No such device")
    ):
        yield from _for_ever()


def not_a_number(on: Stage) -> Iterator[None]:
    on.rig.cycle.estimator.residual.values[0][ELBOW] = np.nan
    yield


class _Infinite:
    """A follower whose reference is beyond all bounds."""

    def __init__(self, follower: Follower) -> None:
        self._follower = follower

    def __getattr__(self, name: str) -> Any:
        return getattr(self._follower, name)

    def step(self, dt: float) -> Reference:
        """As Follower.step."""
        return replace(self._follower.step(dt), q=np.full(7, np.inf))


def infinite_reference(on: Stage) -> Iterator[None]:
    motion = on.rig.cycle.controller.motion
    follower = motion.follower
    motion.follower = cast(Follower, _Infinite(follower))
    try:
        for _ in range(3):
            yield
    finally:
        motion.follower = follower


def _counts(on: Stage, rad: float) -> int:
    profile = on.rig.robot.configuration.drives["two_encoder_drive"]
    return round(rad / profile.link_position.scale)


def _at(values: list[int], joint: int, value: int) -> list[int]:
    return [*values[:joint], value, *values[joint + 1 :]]


def encoder_jump(on: Stage) -> Iterator[None]:
    jump = _counts(on, 0.2)

    def jumped(r: Readings) -> Readings:
        return replace(r, link_position=_at(r.link_position, ELBOW, r.link_position[ELBOW] + jump))

    with on.sensing(jumped):
        yield from _for_ever()


def encoder_frozen(on: Stage) -> Iterator[None]:
    held: list[int] = []

    def frozen(r: Readings) -> Readings:
        held[:] = held or [r.link_position[ELBOW]]
        return replace(r, link_position=_at(r.link_position, ELBOW, held[0]))

    with on.sensing(frozen):
        yield from _for_ever()


def gear_slips(on: Stage) -> Iterator[None]:
    slipped = 0.0

    def slipping(r: Readings) -> Readings:
        where = r.link_position[ELBOW] + _counts(on, slipped)
        return replace(r, link_position=_at(r.link_position, ELBOW, where))

    with on.sensing(slipping):
        while True:
            slipped += 0.008  # a tick
            yield


def torque_stuck(on: Stage) -> Iterator[None]:
    held: list[int] = []

    def stuck(r: Readings) -> Readings:
        held[:] = held or [r.current[0]]
        return replace(r, current=_at(r.current, 0, held[0]))

    with on.sensing(stuck):
        yield from _for_ever()


def torque_saturated(on: Stage) -> Iterator[None]:
    joint = on.rig.robot.configuration.joints[PITCH].wiring
    full = round(1000 * joint.max_current_A / joint.rated_current_A)

    def saturated(r: Readings) -> Readings:
        return replace(r, current=_at(r.current, PITCH, full))

    with on.sensing(saturated):
        for _ in range(25):
            yield


def hit_hard(on: Stage) -> Iterator[None]:
    on.rig.arm.external_torque[ELBOW] = 9.0
    try:
        for _ in range(15):
            yield
    finally:
        on.rig.arm.external_torque[ELBOW] = 0.0


def runaway(on: Stage) -> Iterator[None]:
    """A drive that does what it likes, but still knows the quick stop."""
    servo, axis = on.rig.arm.servo, on.rig.arm.drives[ELBOW].axis
    while axis.state.name == "OPERATION_ENABLED":
        servo.ramp(ELBOW, 3.2, 60.0)
        yield
    yield from _for_ever()


def pushed_beyond_a_limit(on: Stage) -> Iterator[None]:
    on.rig.arm.external_torque[YAW] = 1.4
    try:
        for _ in range(100):
            yield
    finally:
        on.rig.arm.external_torque[YAW] = 0.0


def _late(seconds: float) -> Fault:
    def fault(on: Stage) -> Iterator[None]:
        with on.late(seconds):
            yield

    return fault


def late_ticks(on: Stage) -> Iterator[None]:
    with on.late(0.012):
        for _ in range(8):
            yield


@dataclass(frozen=True, slots=True)
class Case:
    """A fault, the condition that it must be found as, and after how many ticks at most (the tick
    in which it happens counts as the first)."""

    name: str
    condition: Condition
    fault: Fault
    ticks: int
    armed: bool = True
    recovers: bool = True
    """Whether `reset` and `enable` are enough once its cause is gone."""


_C = Condition
CASES = (
    Case("one PDO missing", _C.SAMPLE_MISSING, one_pdo_missing, 1),
    Case("a drive's PDOs missing", _C.STALE, pdos_stale, 3),
    Case("... on a late machine", _C.STARVED, pdos_stale_on_a_late_machine, 3),
    Case("heartbeat of a drive lost", _C.HEARTBEAT_LOST, heartbeat_lost, 21),
    Case("over-temperature", _C.EMERGENCY, _emergency(OVER_TEMPERATURE), 1),
    Case("under-voltage", _C.EMERGENCY, _emergency(UNDER_VOLTAGE), 1),
    Case("fault bit", _C.DRIVE_FAULT, fault_bit, 1),
    Case("emergency stop of a drive", _C.DRIVE_DROPPED, emergency_stop, 1),
    Case("drive leaves operational", _C.STALE, left_operational, 3, recovers=False),
    Case("drive restarts", _C.REBOOTED, reboot, 1, recovers=False),
    Case("foreign SYNC", _C.FOREIGN_MASTER, _foreign(0x080), 1),
    Case("foreign NMT command", _C.FOREIGN_MASTER, _foreign(0x000, b"\x80\x03"), 1),
    Case("foreign setpoint", _C.FOREIGN_MASTER, _foreign(0x203, bytes(6)), 1),
    Case("ENOBUFS once", _C.BUS_DISTURBED, one_enobufs, 1),
    Case("ENOBUFS for 3 ticks", _C.BUS_TROUBLE, enobufs, 4),
    Case("network down", _C.BUS_TROUBLE, bus_down, 4),
    Case("old frames come back", _C.STALE, old_frames, 3),
    Case("error-passive", _C.ERROR_PASSIVE, error_passive, 1),
    Case("bus-off", _C.BUS_OFF, bus_off, 1),
    Case("NaN in the estimate", _C.NOT_FINITE, not_a_number, 1),
    Case("infinite reference", _C.NOT_FINITE, infinite_reference, 2),
    Case("encoder jump of 0.2 rad", _C.JUMP, encoder_jump, 1),
    Case("encoder frozen", _C.FROZEN, encoder_frozen, 60),
    Case("gear slips at 0.8 rad/s", _C.APART, gear_slips, 9),
    Case("current stuck", _C.TORQUE_STUCK, torque_stuck, 150, armed=False),
    Case("current at its limit", _C.TORQUE_SATURATED, torque_saturated, 20, armed=False),
    Case("hit of 9 Nm", _C.RESIDUAL_LIMIT, hit_hard, 15),
    Case("drive runs away", _C.OVERSPEED, runaway, 15),
    Case("pushed beyond a limit", _C.JOINT_LIMIT, pushed_beyond_a_limit, 100),
    Case("one late tick", _C.LATE, _late(0.012), 1),
    Case("8 late ticks", _C.OVERRUN, late_ticks, 5),
    Case("60 ms late", _C.OVERRUN, _late(0.060), 1),
    Case("stood still for 150 ms", _C.SUSPENDED, _late(0.150), 1),
    Case("adapter gone", _C.ADAPTER_GONE, adapter_gone, 1, recovers=False),
)
