"""Assembly of the arm's drives: the one module that says which bus they are on."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Final

from common.errors import ConfigurationError
from daemon.config.load import Robot
from daemon.config.schema import Configuration, frames_of
from drivers.api import BootableDrives
from drivers.can.bus import open_bus
from drivers.can.frame_ring import FrameRing, RecordedWire
from drivers.can.load import bus_load
from drivers.can.wire import Wire
from drivers.canopen.arm import CanopenArm
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.boot.required_objects import DriveSetup
from drivers.canopen.settings import CanopenProfile
from drivers.damiao.settings import DamiaoProfile
from drivers.damiao.setup import DamiaoSetup
from drivers.drive import Drive
from drivers.makes import LANGUAGES, make_of
from drivers.motors.arm import LISTEN_S, MotorArm, MotorMake, Setup
from drivers.robstride.settings import RobStrideProfile
from drivers.robstride.setup import RobStrideSetup

Setups = Sequence[Any]
MOTORS: Final[Mapping[type, Callable[[Wire, Callable[[], None]], Setup]]] = {
    DamiaoProfile: DamiaoSetup, RobStrideProfile: RobStrideSetup,
}  # fmt: skip
"""Set-up of motors by the profile of their make."""


def open_wire(robot: Robot, opened: ExitStack) -> Wire:
    """Wire of the robot's bus, which `opened` closes. Raises BusError."""
    bus = open_bus(robot.configuration.bus)
    opened.callback(bus.python_can.shutdown)
    return bus.wire


def load_of(c: Configuration) -> float:
    """Share of the bus capacity that the arm's frames take."""
    return bus_load(frames_of(c), c.bus.bitrate)


def frames_per_second(c: Configuration) -> float:
    """Rate of the arm's frames [1/s]."""
    return sum(frame.rate_hz for frame in frames_of(c))


def build_setups(robot: Robot) -> Setups:
    """Set-up that each drive needs for operation, of CANopen drives with their EDS; other makes
    need no file, and only the drives are returned. Raises ConfigurationError."""
    c = robot.configuration
    if not frames_of(c):
        raise ConfigurationError(f"{robot.path}: `make: log` has no drives: it is for logs only")
    if not _canopen(c):
        return c.joint_drives
    sheets = {
        name: load_data_sheet(robot.folder / profile.eds)
        for name, profile in c.drives.items()
        if isinstance(profile, CanopenProfile)
    }
    return [DriveSetup(drive, sheets[drive.wiring.profile]) for drive in c.joint_drives]


def build_boot(
    robot: Robot, wire: Wire, ring: FrameRing | None = None, setups: Setups | None = None
) -> DriveBoot:
    """Boot-up of CANopen drives over the wire of an open bus. `ring` records its frames; `setups`
    are built from the robot's files unless given. Raises ConfigurationError."""
    c = robot.configuration
    setups = build_setups(robot) if setups is None else setups
    return DriveBoot(wire, setups, c.period_ms, c.bus.master_node, ring)


def build_canopen(
    robot: Robot, boot: DriveBoot, wire: Wire, clock: Callable[[], float]
) -> CanopenArm:
    """CANopen drives with their boot-up, over a wire whose frames are recorded in the ring of the
    boot-up, if any."""
    c = robot.configuration
    recorded = RecordedWire(wire, boot.ring) if boot.ring else wire
    return CanopenArm(recorded, boot, c.period_s, clock, c.bus.bitrate)


def build_motors(
    wire: Wire,
    drives: Sequence[Drive[Any]],
    period_s: float,
    clock: Callable[[], float],
    bitrate: int,
    listen_s: float = LISTEN_S,
) -> MotorArm:
    """Motors of an arm, all of one make; listen_s: time to listen for another master first [s]."""
    profile = drives[0].profile
    of = type(profile)
    make = MotorMake(make_of(profile).frames, LANGUAGES[of], MOTORS[of])
    return MotorArm(make, wire, drives, period_s, clock, bitrate, listen_s)


def build_drives(
    robot: Robot, wire: Wire, clock: Callable[[], float], ring: FrameRing | None, setups: Setups
) -> BootableDrives:
    """Drives of any make over the wire of an open bus; `ring` records their frames. Raises
    ConfigurationError."""
    c = robot.configuration
    if _canopen(c):
        return build_canopen(robot, build_boot(robot, wire, ring, setups), wire, clock)
    recorded = RecordedWire(wire, ring) if ring else wire
    return build_motors(recorded, setups, c.period_s, clock, c.bus.bitrate)


def _canopen(c: Configuration) -> bool:
    return isinstance(next(iter(c.drives.values())), CanopenProfile)
