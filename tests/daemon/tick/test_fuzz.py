"""Whatever comes from the bus: nothing is raised in a tick, and no setpoint leaves its limits."""

from collections import deque
from collections.abc import Iterator, Sequence

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.rigs.lockstep import DESK_ARM, TRUSTED
from daemon.assembly import build_arming_checks, build_tick
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration, JointLimits, Levels
from daemon.drives import build_boot, build_canopen
from daemon.modes.table import Event, Mode
from daemon.tick.telemetry import state_of
from drivers.can.wire import Frame
from drivers.canopen.cia402 import ENABLE_OPERATION
from drivers.canopen.codec import link_side, receive_pdos, transmit_pdos
from drivers.drive import Drive
from tests.examples import scaled

TICKS = 90
SYNC = 0x080
# Where a plain drive goes by a controlword.
STATUS = {0x00: 0x40, 0x06: 0x21, 0x07: 0x23, 0x0F: 0x27, 0x02: 0x07, 0x80: 0x40}
COMMANDS = (
    Event.ENABLE, Event.START, Event.PAUSE, Event.ABANDON, Event.STOP, Event.DISARM, Event.DISABLE,
    Event.RESET,
)  # fmt: skip


class FarDrive:
    """Goes as commanded at once; knows its objects by the codec's own tables."""

    def __init__(self, limits: JointLimits, drive: Drive) -> None:
        self.limits, self.drive = limits, drive
        self.q, self.velocity, self.controlword = 0.0, 0.0, 0

    def answer(self) -> Iterator[tuple[int, bytes]]:
        truth = {"link_position": self.q, "motor_velocity": self.velocity, "torque": 0.0}
        for pdo in transmit_pdos(self.drive):
            counts = []
            for field in pdo.fields:
                if field.entry == "statusword":
                    counts.append(STATUS.get(self.controlword, 0x40))
                else:
                    gain, bias = link_side(self.drive, field.entry)
                    counts.append(round((truth[field.entry] - bias) / gain))
            yield pdo.cob_id, pdo.layout.pack(*counts)


class FuzzedWire:
    """Answers each SYNC as the drives of an arm would, but for what is done to the frames."""

    def __init__(self, c: Configuration, harm) -> None:
        self.drives = {
            drive.node: FarDrive(joint.limits, drive)
            for joint, drive in zip(c.joints, c.joint_drives, strict=True)
        }
        self.period_s, self.harm = c.period_s, harm
        self.queue: deque[Frame] = deque()
        self.syncs = 0
        self.fastest = 0.0

    def receive(self, timeout: float) -> Frame | None:
        return self.queue.popleft() if self.queue else None

    def send(self, frames: Sequence[Frame]) -> None:
        for cob_id, data in frames:
            node = cob_id & 0x7F
            if cob_id == SYNC:
                self._sync()
            elif node in self.drives and cob_id & ~0x7F in (0x200, 0x300):
                self._setpoint(self.drives[node], cob_id, bytes(data))

    def _setpoint(self, drive: FarDrive, cob_id: int, data: bytes) -> None:
        for pdo in receive_pdos(drive.drive):
            if pdo.cob_id != cob_id:
                continue
            for field, counts in zip(pdo.fields, pdo.layout.unpack(data), strict=True):
                if field.entry == "controlword":
                    drive.controlword = counts
                    continue
                gain, bias = link_side(drive.drive, "target_velocity")
                self._judge(drive, gain * counts + bias, abs(gain))
                drive.velocity = gain * counts + bias

    def _judge(self, drive: FarDrive, velocity: float, count: float) -> None:
        limits = drive.limits
        assert abs(velocity) <= limits.velocity + count
        if drive.controlword != ENABLE_OPERATION:
            assert velocity == 0.0, "no motion without operation enabled"
        self.fastest = max(self.fastest, abs(velocity))

    def _sync(self) -> None:
        self.syncs += 1
        frames = []
        for drive in self.drives.values():
            drive.q += drive.velocity * self.period_s
            frames += drive.answer()
            frames.append((0x700 + drive.drive.node, b"\x05"))
        for kind, place, cob_id, data in self.harm.get(self.syncs, ()):
            if kind == "add":
                frames.insert(place % (len(frames) + 1), (cob_id, data))
            elif frames:
                at = place % len(frames)
                frames[at : at + 1] = [] if kind == "drop" else [(frames[at][0], data)]
        self.queue += frames


@pytest.fixture(scope="module")
def robot() -> Robot:
    robot = load_robot(DESK_ARM)
    c = robot.configuration
    # These drives weigh nothing; only what is done to their torque is to be felt.
    joints = [
        msgspec.structs.replace(joint, thresholds=Levels(contact=15.0, collision=40.0))
        for joint in c.joints
    ]
    c = msgspec.structs.replace(c, joints=joints)
    return Robot(robot.path, c, robot.text, robot.urdf, robot.model)


def run(robot: Robot, harm, commands) -> tuple[FuzzedWire, list[Mode]]:
    """All ticks; the modes that there were."""
    bus = FuzzedWire(robot.configuration, harm)
    drives = build_canopen(robot, build_boot(robot, bus), bus, lambda: 0.0)
    tick = build_tick(robot, drives, TRUSTED)
    arming = build_arming_checks(robot, tick, TRUSTED)
    drives.start(0.0)
    modes = []
    for number in range(TICKS):
        time_s = number * bus.period_s
        for command in commands.get(number, ()):
            if command == "arm":
                if not arming.run(time_s).reasons:
                    tick.controller.arm("fuzz")
            else:
                tick.controller.request(command, "fuzz", time_s)
        tick.begin(time_s)
        tick.finish(0.0)
        if tick.last.decision is not None:
            state_of(tick.last)
        modes.append(tick.controller.machine.mode)
    return bus, modes


USUAL = {3: [Event.ENABLE], 34: ["arm"], 36: [Event.START]}


def test_without_harm_it_moves(robot):
    bus, modes = run(robot, {}, USUAL)
    assert modes[-1] is Mode.TRACKING
    assert bus.fastest > 0.05


def test_a_false_torque_makes_it_yield(robot):
    """The harm that the examples below do reaches every part of the daemon."""
    harm = {
        k: [("change", 0, 0, b"\x27\x00" + (8000).to_bytes(2, "little"))] for k in range(40, 60)
    }
    bus, modes = run(robot, harm, USUAL)
    assert Mode.ADMITTANCE in modes
    assert bus.fastest > 0.2


NODES = (11, 12)
IDENTIFIERS = st.sampled_from(
    [0x000, 0x080, 0x77F, 0x7E4, 0x7E5, 0x100]
    + [base + node for node in NODES for base in range(0x080, 0x800, 0x80)]
)
HARM = st.tuples(
    st.sampled_from(["drop", "change", "change", "add", "add"]),
    st.integers(0, 7),
    st.one_of(IDENTIFIERS, st.integers(0, 0x7FF)),
    st.one_of(
        st.binary(max_size=8),
        # As long as a TPDO, in operation enabled, and whatever else.
        st.binary(min_size=2, max_size=2).map(lambda tail: b"\x27\x00" + tail),
        st.binary(min_size=6, max_size=6),
    ),
)
WHEN = st.integers(1, TICKS)


@settings(max_examples=scaled(15))
@given(
    harm=st.dictionaries(WHEN, st.lists(HARM, min_size=1, max_size=4), max_size=25),
    lasting=st.lists(HARM, max_size=1),
    since=st.integers(30, TICKS),
    commands=st.dictionaries(
        WHEN, st.lists(st.sampled_from([*COMMANDS, "arm"]), max_size=2), max_size=6
    ),
)
def test_no_setpoint_leaves_its_limits_for_any_frames(robot, harm, lasting, since, commands):
    for tick in range(since, TICKS + 1):
        harm = harm | {tick: [*harm.get(tick, []), *lasting]}
    run(robot, harm, {**commands, **USUAL})
