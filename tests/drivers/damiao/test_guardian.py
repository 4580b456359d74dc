"""Guardian of Damiao motors, against the simulated arm of configs/openarm_left."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import OPENARM, Rig, lockstep_rig
from common.arrays import Vector
from daemon.drives import build_motors
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import Go
from daemon.service.poses import Poses
from drivers.api import PowerTarget
from drivers.damiao.frames import Status
from drivers.motors.arm import MotorArm
from drivers.motors.guardian import BEAT, GONE_S, HOT_C, LOWERS, Activity

T = 0.01
#: Where gravity pulls at every large joint.
RAISED = {"joint1": -0.9, "joint2": -0.5, "joint4": 0.9}


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(OPENARM) as rig:
        rig.enable()
        path = Poses(rig.robot).path(Go(targets=RAISED), rig.samples.link_position)
        assert not rig.tick.controller.request(Event.START, "the test", rig.time_s, path)
        rig.run(9.0)
        assert rig.mode is Mode.HOLDING
        assert rig.samples.link_position[1] == pytest.approx(-0.5, abs=0.02)
        yield rig


def guardian(rig: Rig) -> GuardianAtBus:
    assert isinstance(rig.guard, GuardianAtBus)
    return rig.guard


def without_the_daemon(rig: Rig, seconds: float) -> Vector:
    """Let so much time pass without it; the furthest that each link went [rad]."""
    begun, furthest = rig.arm.plant.q.copy(), np.zeros(rig.arm.plant.n)
    for _ in range(round(seconds / T)):
        rig.arm.advance(rig.arm.now + T)
        rig.guard()
        rig.lockstep.pump()
        furthest = np.maximum(furthest, np.abs(rig.arm.plant.q - begun))
    return furthest


def enabled(rig: Rig) -> list[bool]:
    return [motor.status == Status.ENABLED for motor in rig.arm.motors]


def test_a_daemon_that_dies_leaves_an_arm_that_holds(rig: Rig) -> None:
    furthest = without_the_daemon(rig, 5.0)
    assert all(enabled(rig))
    assert furthest.max() < 0.01
    assert guardian(rig).guardian.activity is Activity.HOLDS


def test_without_a_guardian_the_arm_falls(rig: Rig) -> None:
    guardian(rig).killed = True
    furthest = without_the_daemon(rig, 2.0)
    assert not any(enabled(rig))
    assert furthest.max() > 0.2


def test_a_daemon_that_dies_in_motion_leaves_an_arm_that_stops(rig: Rig) -> None:
    rig.request(Event.START)
    rig.run(1.5)
    assert np.abs(rig.samples.motor_velocity).max() > 0.1
    furthest = without_the_daemon(rig, 3.0)
    assert all(enabled(rig))
    assert furthest.max() < 0.05  # its way within the 40 ms, and the lag behind its setpoint
    assert np.abs(rig.arm.plant.theta_dot).max() < 0.01


def test_a_daemon_that_comes_back_finds_a_fault_and_an_arm_where_it_was(rig: Rig) -> None:
    furthest = without_the_daemon(rig, 0.5)
    begun = rig.arm.plant.q.copy()
    rig.ticks += round(0.5 / T)
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert str(rig.tick.controller.machine.cause).startswith(Condition.ABSENT)
    assert (furthest + np.abs(rig.arm.plant.q - begun)).max() < 0.02
    assert guardian(rig).guardian.activity is Activity.WATCHES
    assert all(enabled(rig))


def test_a_guardian_that_dies_stops_the_arm_and_forbids_arming(rig: Rig) -> None:
    rig.request(Event.START)
    rig.run(0.5)
    assert rig.permit() == []
    guardian(rig).killed = True
    rig.run(GONE_S + 0.5)
    assert rig.mode is Mode.HOLDING
    assert str(rig.tick.controller.machine.cause).startswith(Condition.UNGUARDED)
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
    assert all(enabled(rig))
    assert guardian(rig).guardian.unloaded


def test_one_that_is_to_end_lowers_the_arm_first(rig: Rig) -> None:
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
    c = rig.robot.configuration
    drives = build_motors(
        rig.line.wire, c.joint_drives, c.period_s, lambda: 0.0, c.bus.bitrate, listen_s=0.2
    )
    with guarded(rig):
        drives.boot_up(lambda line: None)
    return drives


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


def test_a_daemon_that_starts_anew_takes_an_arm_over_that_the_guardian_holds(rig: Rig) -> None:
    without_the_daemon(rig, 0.5)
    drives = restarted(rig)
    assert all(enabled(rig))
    assert first_ticks(rig, drives, 1.0) < 0.02
    assert guardian(rig).guardian.activity is Activity.WATCHES
    assert all(enabled(rig))


@pytest.mark.parametrize("left", [False, True])
def test_only_an_arm_that_was_not_left_holding_is_lowered_in_time(
    rig: Rig, left: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.motors.guardian.LOWERS_AFTER_S", 1.0)
    if left:
        with rig.lockstep.serving():
            rig.drives.disable_monitoring()
    without_the_daemon(rig, 0.9)
    assert guardian(rig).guardian.activity is Activity.HOLDS
    furthest = without_the_daemon(rig, 3.0)
    assert (furthest.max() > 0.1) is not left
    assert all(enabled(rig))


def test_without_a_guardian_a_start_makes_no_jump_of_an_arm_that_holds(rig: Rig) -> None:
    with rig.lockstep.serving():
        rig.drives.disable_monitoring()
    guardian(rig).killed = True
    c = rig.robot.configuration
    drives = build_motors(
        rig.line.wire, c.joint_drives, c.period_s, lambda: 0.0, c.bus.bitrate, listen_s=0.0
    )
    with rig.lockstep.serving():
        drives.boot_up(lambda line: None)
    assert all(enabled(rig))
    # It sags by what its load makes of the stiffness, and is no more than held.
    assert first_ticks(rig, drives, 1.0) < 0.1


def test_it_says_on_the_bus_that_it_is_there(rig: Rig) -> None:
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
