"""The whole program with a drive that others have made, from its EDS to its faults."""

from collections.abc import Iterator

import pytest

from bench.rigs.durand_arm import durand_rig
from bench.rigs.durand_drive import SERIAL, DurandDrive
from bench.rigs.lockstep import Rig
from common.errors import DriveError
from daemon.modes.table import Event, Mode
from drivers.canopen.boot.required_objects import problems


@pytest.fixture
def rig() -> Iterator[Rig]:
    with durand_rig() as made:
        yield made


def drive_of(rig: Rig) -> DurandDrive:
    return rig.arm.drives[0]._drive


def test_its_eds_has_what_is_counted_on(rig):
    assert not list(problems(rig.boot.setups[0], 10, 127))


def test_it_comes_up_and_holds_what_was_written(rig):
    lines = []
    with rig.by_sdo():
        rig.boot.boot_up(lines.append)
    assert rig.boot.identities[0].serial == SERIAL
    assert any("without object 0x1029:01" in line for line in lines), "it has no such object"
    wanted = {
        **{(0x6007, 0): 3, (0x605A, 0): 6, (0x6060, 0): 9, (0x60C2, 1): 10, (0x1017, 0): 50},
        **{(0x1016, 1): 127 << 16 | 100, (0x1A00, 0): 3, (0x1600, 2): 0x60FF0020},
    }
    assert {where: drive_of(rig).objects.read(*where) for where in wanted} == wanted


def test_it_holds_follows_a_trajectory_and_feels_nothing(rig):
    drive, reported = drive_of(rig), []
    rig.enable()
    start = drive.q
    rig.run(0.2)
    assert drive.q == pytest.approx(start, abs=1e-4), "holding"
    rig.request(Event.START)
    rig.run(4.0, lambda: reported.extend(notice.text for notice in rig.last.notices))
    assert rig.mode is Mode.TRACKING, reported
    reference = rig.decision.reference[0]
    assert abs(reference - start) > 0.05
    assert drive.q == pytest.approx(reference, abs=0.03)
    assert not [line for line in reported if "Nm" in line], "untouched"
    rig.request(Event.STOP)
    rig.run(1.0)
    rig.request(Event.DISABLE)
    rig.run(0.5)
    assert rig.mode is Mode.OFF
    assert drive.states == [
        *("SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED"),
        "QUICK STOP ACTIVE",
    ]


def cause(rig: Rig) -> str:
    assert rig.mode is Mode.FAULTED
    return rig.tick.controller.machine.cause


def test_its_fault_is_latched_until_a_reset(rig):
    rig.enable()
    drive_of(rig).fail(0x3220)
    rig.run(0.1)
    assert "0x3220" in cause(rig)
    assert "voltage" in cause(rig)
    assert drive_of(rig).state == "FAULT", "nothing resets it by itself"
    rig.request(Event.RESET)
    rig.run(0.2)
    assert drive_of(rig).state == "SWITCH ON DISABLED"
    rig.enable()


def test_it_stops_when_the_daemon_falls_silent_and_comes_back(rig):
    rig.enable()
    rig.arm.advance(rig.arm.now + 0.12)
    assert drive_of(rig).state == "FAULT", "its own watch over the master's heartbeat"
    rig.run(0.1)
    assert "0x8130" in cause(rig)
    rig.reset()
    rig.enable()


def test_after_its_power_was_off_it_must_be_set_up_again(rig):
    rig.enable()
    drive_of(rig).power_on()
    rig.run(0.3)
    assert cause(rig)
    assert rig.drives.unfit() == [0]
    rig.reset()
    rig.enable()
    assert drive_of(rig).objects.read(0x6007, 0) == 3


def test_a_value_that_it_refuses_is_named(rig):
    def refuse(_: int) -> None:
        raise ValueError("not on this drive")

    drive_of(rig).objects.validate_callbacks[(0x605A, 0)].add(refuse)
    says = r"0x605A:00: writing 6 was refused: .*; step `stopping`"
    with pytest.raises(DriveError, match=says), rig.by_sdo():
        rig.boot.boot_up()
