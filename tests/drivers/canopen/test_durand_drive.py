"""The whole program with a drive that others have made, from its EDS to its faults."""

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import can
import pytest
from can.interfaces.virtual import VirtualBus

from bench.rigs.durand_arm import load_of, stiff_robot
from bench.rigs.durand_drive import SERIAL, DurandDrive
from bench.rigs.lockstep import TRUSTED
from common.errors import DriveError
from daemon.assembly import build_tick
from daemon.drives import build_canopen, build_setups
from daemon.modes.table import Event, Mode
from daemon.tick.tick import Tick
from drivers.can.virtual import QueueWire
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.boot.required_objects import problems

T = 0.01
_channels = itertools.count()


@dataclass
class Rig:
    """The daemon's tick on one drive."""

    tick: Tick
    boot: DriveBoot
    drive: DurandDrive
    reported: list[str]
    ticks: int = 0

    @property
    def mode(self) -> Mode:
        return self.tick.controller.machine.mode

    def boot_up(self) -> None:
        with self.drive.serving():
            self.boot.boot_up(self.reported.append)
        self.tick.drives.start(self.ticks * T)
        self.drive.pump()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / T)):
            self.tick.begin(self.ticks * T)
            self.drive.pump()
            self.tick.finish(0.0)
            self.drive.pump()
            self.drive.advance(T)
            self.reported += [event.text for event in self.tick.last.notices]
            self.ticks += 1

    def request(self, event: Event) -> list[str]:
        return list(self.tick.controller.request(event, "a test", self.ticks * T))

    def enable(self) -> None:
        self.run(0.1)
        assert not self.request(Event.ENABLE)
        self.run(0.5)
        assert self.mode is Mode.HOLDING, self.reported


@pytest.fixture
def rig(tmp_path) -> Iterator[Rig]:
    robot = stiff_robot()
    c = robot.configuration
    channel = f"durand-{next(_channels)}"
    with VirtualBus(channel) as near, can.Bus(interface="virtual", channel=channel) as far:
        drive = DurandDrive(far, 1, load_of(robot))
        (tmp_path / "drive.eds").write_text(drive.eds)
        sheet = load_data_sheet(tmp_path / "drive.eds")
        setups = [dataclasses.replace(each, data_sheet=sheet) for each in build_setups(robot)]
        wire = QueueWire(near)
        boot = DriveBoot(wire, setups, c.period_ms, c.bus.master_node)
        tick = build_tick(robot, build_canopen(robot, boot, wire, lambda: 0.0), TRUSTED)
        yield Rig(tick, boot, drive, [])


def test_its_eds_has_what_is_counted_on(rig):
    assert not list(problems(rig.boot.setups[0], 10, 127))


def test_it_comes_up_and_holds_what_was_written(rig):
    rig.boot_up()
    assert rig.boot.identities[0].serial == SERIAL
    assert any("without object 0x1029:01" in line for line in rig.reported), "it has no such object"
    wanted = {
        **{(0x6007, 0): 3, (0x605A, 0): 6, (0x6060, 0): 9, (0x60C2, 1): 10, (0x1017, 0): 50},
        **{(0x1016, 1): 127 << 16 | 100, (0x1A00, 0): 3, (0x1600, 2): 0x60FF0020},
    }
    assert {where: rig.drive.objects.read(*where) for where in wanted} == wanted


def test_it_holds_follows_a_trajectory_and_feels_nothing(rig):
    rig.boot_up()
    rig.enable()
    start = rig.drive.q
    rig.run(0.2)
    assert rig.drive.q == pytest.approx(start, abs=1e-4), "holding"
    assert not rig.request(Event.START)
    rig.run(4.0)
    assert rig.mode is Mode.TRACKING, rig.reported
    reference = rig.tick.last.decision.reference[0]
    assert abs(reference - start) > 0.05
    assert rig.drive.q == pytest.approx(reference, abs=0.03)
    assert not [line for line in rig.reported if "Nm" in line], "untouched"
    assert not rig.request(Event.STOP)
    rig.run(1.0)
    assert not rig.request(Event.DISABLE)
    rig.run(0.5)
    assert rig.mode is Mode.OFF
    assert rig.drive.states == [
        *("SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"),
        "QUICK STOP ACTIVE",
    ]


def test_its_fault_is_latched_until_a_reset(rig):
    rig.boot_up()
    rig.enable()
    rig.drive.fail(0x3220)
    rig.run(0.1)
    assert rig.tick.controller.faulted
    assert any("0x3220" in line and "voltage" in line for line in rig.reported), rig.reported
    assert rig.drive.state == "FAULT", "nothing resets it by itself"
    assert not rig.request(Event.RESET)
    rig.run(0.2)
    assert rig.drive.state == "SWITCH ON DISABLED"
    rig.enable()


def test_it_stops_when_the_daemon_falls_silent_and_comes_back(rig):
    rig.boot_up()
    rig.enable()
    for _ in range(12):
        rig.drive.advance(T)
    assert rig.drive.state == "FAULT", "its own watch over the master's heartbeat"
    rig.run(0.1)
    assert rig.tick.controller.faulted
    assert any("0x8130" in line for line in rig.reported), rig.reported
    assert not rig.request(Event.RESET)
    rig.run(0.2)
    rig.enable()


def test_after_its_power_was_off_it_must_be_set_up_again(rig):
    rig.boot_up()
    rig.enable()
    rig.drive.power_on()
    rig.run(0.3)
    assert rig.tick.controller.faulted
    assert rig.tick.drives.unfit() == [0]
    with rig.drive.serving():
        rig.boot.renew([0], lambda: None)
    rig.tick.drives.start(rig.ticks * T)
    rig.run(0.1)
    assert not rig.request(Event.RESET)
    rig.run(0.2)
    rig.enable()
    assert rig.drive.objects.read(0x6007, 0) == 3


def test_a_value_that_it_refuses_is_named(rig):
    def refuse(_: int) -> None:
        raise ValueError("not on this drive")

    rig.drive.objects.validate_callbacks[(0x605A, 0)].add(refuse)
    with pytest.raises(DriveError, match=r"0x605A:00: writing 6 was refused: .*; step `stopping`"):
        rig.boot_up()
