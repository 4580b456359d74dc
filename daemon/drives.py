"""Assembly of the arm's drives: the one module that says which bus they are on."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack

from daemon.config.load import Robot
from daemon.config.schema import Configuration, frames_of
from drivers.can.bus import open_bus
from drivers.can.frame_ring import FrameRing, RecordedWire
from drivers.can.load import bus_load
from drivers.can.wire import Wire
from drivers.canopen.arm import CanopenArm
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.boot.required_objects import DriveSetup

Setups = Sequence[DriveSetup]


def open_wire(robot: Robot, opened: ExitStack) -> Wire:
    """Wire of the robot's bus, which `opened` closes. Raises BusError."""
    bus = open_bus(robot.configuration.bus)
    opened.callback(bus.python_can.shutdown)
    return bus.wire


def load_of(c: Configuration) -> float:
    """Share of the bus that the arm takes."""
    return bus_load(frames_of(c), c.bus.bitrate)


def frames_per_second(c: Configuration) -> float:
    """Number of the arm's frames."""
    return sum(frame.rate_hz for frame in frames_of(c))


def build_setups(robot: Robot) -> Setups:
    """Set-up that each drive must have before it may be operational. Raises ConfigurationError."""
    c = robot.configuration
    sheets = {
        name: load_data_sheet(robot.folder / profile.eds) for name, profile in c.drives.items()
    }
    return [DriveSetup(drive, sheets[drive.wiring.profile]) for drive in c.joint_drives]


def build_boot(
    robot: Robot, wire: Wire, ring: FrameRing | None = None, setups: Setups | None = None
) -> DriveBoot:
    """Boot-up of the drives over the wire of an open bus. `ring` keeps its frames; `setups` are
    built from the robot's files unless given. Raises ConfigurationError."""
    c = robot.configuration
    setups = build_setups(robot) if setups is None else setups
    return DriveBoot(wire, setups, c.period_ms, c.bus.master_node, ring)


def build_drives(
    robot: Robot, boot: DriveBoot, wire: Wire, clock: Callable[[], float]
) -> CanopenArm:
    """Drives with their boot-up, and the wire of their tick, whose frames are kept as its own."""
    c = robot.configuration
    kept = RecordedWire(wire, boot.ring) if boot.ring else wire
    return CanopenArm(kept, boot, c.period_s, clock, c.bus.bitrate)
