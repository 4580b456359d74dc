"""Drives of another make, by configuration alone: other objects, widths, signs, units, zero, and a
lock after the loss of their master."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.lockstep import DESK_ARM, Rig, lockstep_rig
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import bare
from daemon.protocol.socket_path import Peer
from daemon.service.notify import Notifier
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process
from daemon.tick.loop import Loop
from drivers.canopen.boot.boot_up import DriveBoot
from simulator.state_machine import State

A_PERSON = Peer(uid=1000, pid=1)


@dataclass
class ServedDeskArm:
    """The daemon without its process."""

    rig: Rig
    service: Service

    def ask(self, command: str):
        return self.service.commands.handle(bare(command), A_PERSON)

    def silence(self, seconds: float) -> None:
        """The daemon stands still; the drives do not."""
        self.rig.arm.advance(self.rig.arm.now + seconds)
        self.rig.run(0.1)


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(DESK_ARM) as rig:
        yield rig


@pytest.fixture
def served(rig: Rig, tmp_path: Path) -> Iterator[ServedDeskArm]:
    c = rig.robot.configuration
    loop = Loop(rig.tick, rig.clock(), c.period_s)
    with ControlSocket(tmp_path / "control") as control, closing(Notifier()) as notifier:
        service = Service(
            Process(rig.robot, 1, []), loop, rig.arming, control, notifier, rig.drives
        )
        service.commands.set_up.asking = rig.by_sdo
        yield ServedDeskArm(rig, service)


def test_it_measures_what_is_true(rig):
    rig.enable()
    rig.request(Event.START)
    worst = np.zeros(3)
    residual = np.zeros(2)
    positions = []

    def compare():
        samples, arm = rig.samples, rig.arm
        errors = (
            samples.link_position - arm.plant.q,
            samples.motor_velocity - arm.plant.theta_dot,
            samples.current - arm.servo.current,
        )
        np.maximum(worst, [np.abs(error).max() for error in errors], out=worst)
        positions.append(samples.link_position[0])
        np.maximum(residual, np.abs(rig.estimate.residual), out=residual)

    rig.run(3.0, compare)
    assert rig.mode is Mode.TRACKING
    assert np.ptp(positions) > 0.3, "it moves"
    # One count; the noise of the velocity; what the current's filter of 3 ms and its noise leave.
    assert worst[0] < 2.5e-5
    assert worst[1] < 0.01
    assert worst[2] < 0.2
    assert (residual < [0.4, 0.3]).all()


def test_it_feels_a_hand(rig):
    rig.enable()
    rig.run(1.0)
    rig.arm.external_torque[0] = 1.5
    rig.run(0.3)
    assert rig.estimate.residual[0] == pytest.approx(1.5, abs=0.3)


def test_left_over_pdos_are_off(rig):
    for drive in rig.arm.drives:
        assert drive.objects.number(0x1802, 1) == 0xC0000380 + drive.node
        assert drive.objects.number(0x607F) > 0


def test_the_lock_holds_against_a_mere_reset(served):
    rig = served.rig
    rig.enable()
    served.silence(0.5)
    assert rig.mode is Mode.FAULTED
    assert {drive.state for drive in rig.arm.drives} == {State.FAULT}
    rig.request(Event.RESET)
    rig.run(0.6)
    assert rig.mode is Mode.FAULTED
    # And the drives alone, for comparison: an edge of the reset bit is not enough.
    for drive in rig.arm.drives:
        drive.on_nmt(1)
        for word in (0x00, 0x80):
            drive.objects.values[0x604000] = word
            drive._on_write(0x604000)
        assert drive.state is State.FAULT


def test_a_reset_sets_locked_drives_up_again(served):
    rig = served.rig
    rig.enable()
    rig.request(Event.START)
    rig.run(1.0)
    served.silence(0.5)
    assert rig.mode is Mode.FAULTED
    rig.run(0.3)  # until all were seen to stand
    stood = rig.arm.plant.q.copy()
    reply = served.ask("reset")
    assert (reply.ok, reply.mode, reply.armed) == (True, "off", False)
    rig.run(0.6)
    assert rig.mode is Mode.OFF, rig.tick.controller.machine.cause
    assert {drive.state for drive in rig.samples.drives} == {"switch on disabled"}
    rig.enable()
    assert np.abs(rig.arm.plant.q - stood).max() < 0.05
    assert rig.drives.serials == [1, 2]
    rig.request(Event.START)
    rig.run(1.0)
    assert rig.mode is Mode.TRACKING


def test_a_drive_that_restarts_in_the_middle_is_set_up_again_alone(served):
    rig = served.rig
    rig.enable()
    rig.arm.drives[0].boot()
    rig.run(0.1)
    assert rig.mode is Mode.FAULTED
    assert "restarted" in rig.tick.controller.machine.cause
    commands = []
    other = rig.arm.drives[1]
    on_nmt = other.on_nmt
    other.on_nmt = lambda command: (commands.append(command), on_nmt(command))
    assert served.ask("reset").ok
    rig.step()
    assert commands == [1], "the other is only started, as it is already"
    rig.run(0.2)
    rig.enable()


def test_a_drive_that_is_gone_keeps_the_fault(served):
    rig = served.rig
    rig.enable()
    drive = rig.arm.drives[0]
    drive.tick = drive.transmit = drive.on_sdo = lambda *_: None
    rig.run(0.3)
    assert "not seen to stand yet" in served.ask("reset").reasons[0]
    rig.run(1.0)  # all were left alone for long enough
    assert rig.mode is Mode.FAULTED
    reply = served.ask("reset")
    assert not reply.ok
    assert "node 11 (column) does not answer" in reply.reasons[0]
    rig.run(0.1)
    assert rig.mode is Mode.FAULTED


def test_while_it_waits_for_drives_the_watchdog_is_fed_and_no_other_is_missed(served, monkeypatch):
    rig = served.rig
    rig.run(0.5)  # off: without torque they stand, and go on counting as standing
    gone = rig.arm.drives[0]
    gone.tick = gone.transmit = gone.on_sdo = lambda *_: None
    rig.run(0.5)
    fed = []
    monkeypatch.setattr(served.service.notifier, "ticked", fed.append)
    renew = DriveBoot.renew

    def for_a_second(boot, joints, meanwhile, progress):
        rig.ticks += 100
        renew(boot, joints, meanwhile, progress)

    monkeypatch.setattr(DriveBoot, "renew", for_a_second)
    begun = rig.time_s
    assert not served.ask("reset").ok
    assert len(fed) > 10
    assert set(fed) == {begun, begun + 1.0}, "while they are read, and while one is waited for"
    rig.step()
    assert rig.samples.events == (), (
        "the other drive's heartbeats of this second went to the SDO client"
    )
    rig.run(0.3)
    rig.arm.drives[1].tick = lambda *_: None
    rig.run(0.3)
    assert rig.drives.silent() == ("column", "swing"), "and it is watched as before"
