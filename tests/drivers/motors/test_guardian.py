"""Guardian of motors, against simulated arms that hold against a load."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.drives import build_motors
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from drivers.api import PowerTarget
from drivers.damiao import frames as damiao
from drivers.motors.arm import MotorArm
from drivers.motors.guardian import BEAT, GONE_S, HOT_C, LOWERS, Activity
from drivers.robstride import frames as robstride
from tests.drivers.motors.one_arm import (
    DAMIAO,
    RAISED,
    ROBSTRIDE,
    T,
    cause,
    hold_at,
    powered,
    without_the_daemon,
)

MAKES = pytest.mark.parametrize("rig", [DAMIAO, ROBSTRIDE], ids=str, indirect=True)


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    """Damiao motors that hold the arm's links, unless a test names a make."""
    make = getattr(request, "param", DAMIAO)
    with lockstep_rig(make.folder) as rig:
        if make is DAMIAO:
            hold_at(rig, RAISED)
            assert rig.samples.link_position[1] == pytest.approx(-0.5, abs=0.02)
        else:
            rig.enable()
            rig.run(0.5)
            rig.arm.external_torque[make.joint] = 3.0
            rig.run(1.0)
            assert rig.mode is Mode.HOLDING
        yield rig


def guardian(rig: Rig) -> GuardianAtBus:
    assert isinstance(rig.guard, GuardianAtBus)
    return rig.guard


@MAKES
def test_a_daemon_that_dies_leaves_an_arm_that_holds(rig: Rig) -> None:
    furthest = without_the_daemon(rig, 5.0)
    assert all(powered(rig))
    assert furthest.max() < 0.01
    assert guardian(rig).guardian.activity is Activity.HOLDS


@MAKES
def test_without_a_guardian_the_arm_falls(rig: Rig) -> None:
    guardian(rig).killed = True
    furthest = without_the_daemon(rig, 2.0)
    assert not any(powered(rig))
    assert furthest.max() > 0.2


def test_a_daemon_that_dies_in_motion_leaves_an_arm_that_stops(rig: Rig) -> None:
    rig.request(Event.START)
    rig.run(1.5)
    assert np.abs(rig.samples.motor_velocity).max() > 0.1
    furthest = without_the_daemon(rig, 3.0)
    assert all(powered(rig))
    assert furthest.max() < 0.05  # its way within the 40 ms, and the lag behind its setpoint
    assert np.abs(rig.arm.plant.theta_dot).max() < 0.01


@MAKES
def test_a_daemon_that_comes_back_finds_a_fault_and_an_arm_where_it_was(rig: Rig) -> None:
    furthest = without_the_daemon(rig, 0.5)
    begun = rig.arm.plant.q.copy()
    rig.ticks += round(0.5 / T)
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.ABSENT)
    assert (furthest + np.abs(rig.arm.plant.q - begun)).max() < 0.02
    assert guardian(rig).guardian.activity is Activity.WATCHES
    assert all(powered(rig))


def test_a_guardian_that_dies_stops_the_arm_and_forbids_arming(rig: Rig) -> None:
    rig.request(Event.START)
    rig.run(0.5)
    assert rig.permit() == []
    guardian(rig).killed = True
    rig.run(GONE_S + 0.5)
    assert rig.mode is Mode.HOLDING
    assert cause(rig).startswith(Condition.UNGUARDED)
    assert any("no guardian" in reason for reason in rig.permit())
    guardian(rig).killed = False
    rig.run(0.2)
    assert rig.permit() == []


def test_hot_motors_are_lowered_slowly_until_they_bear_nothing(rig: Rig) -> None:
    without_the_daemon(rig, 0.5)
    for motor in rig.arm.motors:
        motor.degC = (30.0, float(HOT_C))
    before, fastest = rig.arm.plant.q.copy(), 0.0
    for _ in range(300):
        here = rig.arm.plant.q.copy()
        without_the_daemon(rig, 0.1)
        fastest = max(fastest, float(np.abs(rig.arm.plant.q - here).max()) / 0.1)
    lowered = np.abs(rig.arm.plant.q - before)
    assert lowered[1] > 0.2  # of the joint that bears the most
    assert fastest < 2.5 * LOWERS  # links fall through their gaps
    assert all(powered(rig))
    assert guardian(rig).guardian.unloaded


def test_a_guardian_that_is_to_end_lowers_the_arm_first(rig: Rig) -> None:
    held = guardian(rig).guardian
    without_the_daemon(rig, 0.5)
    assert not held.unloaded
    held.lowers = True
    without_the_daemon(rig, 0.1)
    assert held.activity is Activity.LOWERS
    assert not held.unloaded
    without_the_daemon(rig, 25.0)
    assert held.unloaded
    before = rig.arm.plant.q.copy()
    guardian(rig).killed = True
    without_the_daemon(rig, 2.0)
    assert np.abs(rig.arm.plant.q - before).max() < 0.2  # where friction holds it, or nearly


def restarted(rig: Rig) -> MotorArm:
    """Drives of a daemon that starts anew, while the arm holds."""
    assert isinstance(rig.drives, MotorArm)
    drives = built(rig, listen_s=0.2)
    with guarded(rig):
        drives.boot_up(lambda line: None)
    return drives


def built(rig: Rig, listen_s: float) -> MotorArm:
    c = rig.robot.configuration
    return build_motors(rig.line.wire, c.joint_drives, T, lambda: 0.0, c.bus.bitrate, listen_s)


@contextmanager
def guarded(rig: Rig) -> Iterator[None]:
    """A guardian that goes on in a thread, as motors answer in one."""
    ended = threading.Event()

    def turns() -> None:
        while not ended.wait(0.005):
            rig.lockstep.let_pass(0.005)
            rig.guard()

    thread = threading.Thread(target=turns)
    with rig.lockstep.serving():
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def first_ticks(rig: Rig, drives: MotorArm, seconds: float) -> float:
    """Tick so long, commanded to hold; the furthest that a link went [rad]."""
    begun, furthest = rig.arm.plant.q.copy(), 0.0
    drives.start(rig.time_s)
    for _ in range(round(seconds / T)):
        drives.sync(rig.time_s)
        rig.lockstep.pump()
        rig.guard()
        drives.collect(0.0)
        drives.command(PowerTarget.QUICK_STOP, np.zeros(rig.arm.plant.n))
        rig.ticks += 1
        furthest = max(furthest, float(np.abs(rig.arm.plant.q - begun).max()))
    assert drives.samples.events == ()
    return furthest


def test_a_restarted_daemon_takes_over_an_arm_that_the_guardian_holds(rig: Rig) -> None:
    without_the_daemon(rig, 0.5)
    drives = restarted(rig)
    assert all(powered(rig))
    assert first_ticks(rig, drives, 1.0) < 0.02
    assert guardian(rig).guardian.activity is Activity.WATCHES
    assert all(powered(rig))


def motor_time_out(motor: Any) -> float:
    if hasattr(motor, "registers"):
        return float(motor.registers.number(damiao.Register.TIMEOUT))
    return float(motor.parameters[robstride.Parameter.TIMEOUT])


@MAKES
@pytest.mark.parametrize("left", [False, True])
def test_only_an_arm_that_was_not_left_holding_is_lowered_in_time(
    rig: Rig, left: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.motors.guardian.LOWERS_AFTER_S", 1.0)
    if left:
        with rig.lockstep.serving():
            rig.drives.disable_monitoring()
        assert {motor_time_out(motor) for motor in rig.arm.motors} == {0}
    without_the_daemon(rig, 0.9)
    assert guardian(rig).guardian.activity is Activity.HOLDS
    furthest = without_the_daemon(rig, 4.0)
    assert (furthest.max() > 0.1) is not left
    assert all(powered(rig))


def test_without_a_guardian_a_start_does_not_move_an_arm_that_holds(rig: Rig) -> None:
    with rig.lockstep.serving():
        rig.drives.disable_monitoring()
    guardian(rig).killed = True
    drives = built(rig, listen_s=0.0)
    with rig.lockstep.serving():
        drives.boot_up(lambda line: None)
    assert all(powered(rig))
    # It sags by what its load makes of the stiffness, and is no more than held.
    assert first_ticks(rig, drives, 1.0) < 0.1


def test_its_heartbeat_is_sent_every_20_ms(rig: Rig) -> None:
    beats = [message for message in heard(rig, 0.2) if message == (BEAT, b"\0")]
    assert len(beats) == pytest.approx(10, abs=1)


def heard(rig: Rig, seconds: float) -> list[tuple[int, bytes]]:
    """Frames of the guardian, while the daemon ticks."""
    sent: list[tuple[int, bytes]] = []
    end = guardian(rig).end
    send = end.send
    end.send = lambda message, timeout=None: (  # type: ignore[method-assign]
        sent.append((message.arbitration_id, bytes(message.data))),
        send(message),
    )[1]
    rig.run(seconds)
    return sent
