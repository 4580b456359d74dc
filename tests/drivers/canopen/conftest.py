"""The arm of configs/romeo_left_arm, on both ends of a virtual bus."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from typing import Any

import can
import msgspec
import pytest

from bench.rigs.sync_clock import Lockstep
from drivers.can.frame_ring import FrameRing
from drivers.can.virtual import QueueWire
from drivers.can.wire import Wire
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.boot.identity import DriveIdentity
from drivers.canopen.boot.required_objects import DriveSetup
from drivers.canopen.drives import CanopenDrives
from drivers.canopen.settings import CanopenProfile
from drivers.drive import Drive
from drivers.wiring import JointWiring
from simulator.arm import SimulatedArm
from simulator.description import ArmDescription, JointDescription, SimulationSettings
from tests.drivers.canopen.scripted_wire import CONFIG, ROBOT, ScriptedWire

PERIOD_S = 0.010
_channels = count()


@pytest.fixture(scope="session")
def profile() -> CanopenProfile:
    return msgspec.convert(CONFIG["drives"]["two_encoder_drive"], CanopenProfile)


@pytest.fixture(scope="session")
def joint_drives(profile: CanopenProfile) -> list[Drive]:
    return [
        Drive(
            j["name"],
            msgspec.convert(j["wiring"], JointWiring),
            profile,
            velocity=j["limits"]["velocity"],
            quick_stop=j["limits"]["quick_stop"],
        )
        for j in CONFIG["joints"]
    ]


@pytest.fixture(scope="session")
def setups(joint_drives: list[Drive]) -> list[DriveSetup]:
    sheet = load_data_sheet(ROBOT / "drive.eds")
    return [DriveSetup(drive, sheet) for drive in joint_drives]


@dataclass
class Bench:
    """Master and simulated arm at the two ends of a bus of their own."""

    bus: can.BusABC
    other_end: can.BusABC
    simulated: SimulatedArm
    lockstep: Lockstep
    ticks: int = 0

    @property
    def now(self) -> float:
        return self.ticks * PERIOD_S

    def boot(self, setups: Sequence[DriveSetup], ring: FrameRing | None = None) -> DriveBoot:
        """From this end of the bus."""
        return DriveBoot(QueueWire(self.bus), setups, period_ms=10, ring=ring, listen_s=0.005)

    def boot_up(
        self,
        setups: Sequence[DriveSetup],
        progress: Callable[[str], None] = lambda line: None,
        ring: FrameRing | None = None,
    ) -> tuple[DriveIdentity, ...]:
        """With the simulated drives answering from a thread."""
        boot = self.boot(setups, ring)
        with self.lockstep.serving():
            boot.boot_up(progress)
        return boot.identities

    def number(self, drive: int, index: int, subindex: int = 0) -> int:
        """Value of an object of a drive."""
        return self.simulated.drives[drive].objects.number(index, subindex)

    def tick(self, drives: CanopenDrives) -> Any:
        """SYNC and samples; the command is the caller's."""
        self.ticks += 1
        drives.sync(self.now)
        self.lockstep.pump()
        return drives.collect(self.now)


def describe() -> ArmDescription:
    """The simulated arm, from the same file; torques and friction are of no account here."""
    simulated = []
    for joint in CONFIG["joints"]:
        wiring, limits = joint["wiring"], joint["limits"]
        lower, upper = limits["lower"], limits["upper"]
        simulated.append(
            JointDescription(
                name=joint["name"],
                node=wiring["node"],
                gear=wiring["gear"],
                rated_current_A=wiring["rated_current_A"],
                max_current_A=wiring["max_current_A"],
                torque_constant=joint["torque_constant"],
                rotor_inertia=joint["rotor_inertia"],
                half_gap=joint["half_gap"],
                **joint["friction"],
                lower=lower,
                upper=upper,
                initial_position=min(max(0.2, lower + 0.2), upper - 0.1),
            )
        )
    return ArmDescription(
        urdf=ROBOT / "arm.urdf", eds=ROBOT / "drive.eds", joints=tuple(simulated), period_s=PERIOD_S
    )


@pytest.fixture
def bench(wire: tuple[can.BusABC, can.BusABC]) -> Bench:
    bus, other_end = wire
    simulated = SimulatedArm(describe(), SimulationSettings(), other_end.send)
    lockstep = Lockstep(simulated, other_end)
    simulated.power_on()
    return Bench(bus, other_end, simulated, lockstep)


@pytest.fixture(scope="module")
def make_bench() -> Iterator[Callable[[], Bench]]:
    """Makes any number of benches, for examples that need one each."""
    with ExitStack() as stack:

        def make() -> Bench:
            channel = f"benches-{next(_channels)}"
            near, far = (
                stack.enter_context(can.Bus(interface="virtual", channel=channel)) for _ in "nf"
            )
            simulated = SimulatedArm(describe(), SimulationSettings(), far.send)
            simulated.power_on()
            return Bench(near, far, simulated, Lockstep(simulated, far))

        yield make


@pytest.fixture
def make_drives(joint_drives: list[Drive]) -> Callable[[Wire], CanopenDrives]:
    """An arm whose clock stands still: `collect` reads what is queued."""
    return lambda wire: CanopenDrives(wire, joint_drives, PERIOD_S, lambda: 0.0)


@pytest.fixture
def scripted() -> ScriptedWire:
    return ScriptedWire()


@pytest.fixture
def drives(scripted: ScriptedWire, make_drives: Callable[[Any], CanopenDrives]) -> CanopenDrives:
    """On the scripted bus; started, at time 0."""
    drives = make_drives(scripted)
    drives.start(0.0)
    scripted.sent.clear()
    return drives
