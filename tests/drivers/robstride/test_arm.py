"""RobStride motors of one arm in the whole program, against simulated ones that fail. What all
makes share is tried further in tests/drivers/damiao."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import BEAM, Rig, lockstep_rig
from common.errors import DriveError, SilentDriveError
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from drivers.can.wire import Wire
from drivers.motors.guardian import Activity
from drivers.robstride.frames import Kind, Parameter, identifier, kind_of, setpoint_id
from simulator.robstride import motor as m
from tests.drivers.damiao.test_arm import Broken, Filter, cause, stands

JOINT = 1
LOAD = 3.0  # [Nm]
T = 0.01


def broken(configure=lambda c: c) -> Iterator[Broken]:
    arm = Broken()

    def between(wire: Wire) -> Filter:
        arm.filter = Filter(wire)
        return arm.filter

    with lockstep_rig(BEAM, between=between, configure=configure) as arm.rig:
        yield arm


@pytest.fixture
def arm() -> Iterator[Broken]:
    yield from broken()


@pytest.fixture
def moving(arm: Broken) -> Broken:
    arm.rig.enable()
    arm.rig.request(Event.START)
    arm.rig.run(1.5)
    assert arm.rig.mode is Mode.TRACKING
    assert np.abs(arm.rig.samples.motor_velocity).max() > 0.1
    return arm


@pytest.fixture
def loaded(arm: Broken) -> Broken:
    """One that holds against a load."""
    rig = arm.rig
    rig.enable()
    rig.run(0.5)
    rig.arm.external_torque[JOINT] = LOAD
    rig.run(1.0)
    assert rig.mode is Mode.HOLDING
    return arm


def running(rig: Rig) -> list[bool]:
    return [motor.mode == m.RUN for motor in rig.arm.motors]


def without_the_daemon(rig: Rig, seconds: float) -> float:
    """Let so much time pass without it; the furthest that a link went [rad]."""
    begun, furthest = rig.arm.plant.q.copy(), 0.0
    for _ in range(round(seconds / T)):
        rig.arm.advance(rig.arm.now + T)
        rig.guard()
        rig.lockstep.pump()
        furthest = max(furthest, float(np.abs(rig.arm.plant.q - begun).max()))
    return furthest


# --- set-up ---------------------------------------------------------------------------------------


def stronger(motor: m.RobStrideMotor) -> None:
    motor.parameters[m.LIMIT_TORQUE] = 17.0


def elsewhere(motor: m.RobStrideMotor) -> None:
    motor._turns = 2.0 * math.pi


def older(motor: m.RobStrideMotor) -> None:
    motor._turns = 1.0
    motor.ranges = motor.ranges._replace(p_max=12.5)


def in_another_mode(motor: m.RobStrideMotor) -> None:
    motor.parameters[m.RUN_MODE], motor.mode = 5, m.RUN


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (stronger, "limit_torque"),
        (elsewhere, "zero_sta"),
        (older, "position_max"),
        (in_another_mode, "another mode"),
    ],
)
def test_a_motor_that_is_not_as_configured_is_refused(arm: Broken, made, says: str) -> None:
    made(arm.rig.arm.motors[4])
    with arm.rig.lockstep.serving(), pytest.raises(DriveError, match=says):
        arm.rig.drives.boot_up(lambda line: None)


def test_a_silent_motor_is_named(arm: Broken) -> None:
    arm.rig.arm.motors[4].silent = True
    with arm.rig.lockstep.serving(), pytest.raises(SilentDriveError, match="joint5"):
        arm.rig.drives.boot_up(lambda line: None)


def test_every_motor_has_a_number_of_its_own(arm: Broken) -> None:
    assert len(set(arm.rig.drives.serials)) == 6


def test_what_a_restart_took_is_set_up_again_before_the_arm_is_enabled(arm: Broken) -> None:
    rig = arm.rig
    rig.run(0.1)
    motor = rig.arm.motors[JOINT]
    assert motor.parameters[m.LIMIT_TORQUE] == pytest.approx(15.7 * 0.8627, rel=1e-3)
    motor.boot()
    assert motor.parameters[m.LIMIT_TORQUE] == 17.0
    assert rig.ask(Event.ENABLE) == []
    rig.run(0.6)
    assert rig.mode is Mode.HOLDING
    assert motor.parameters[m.LIMIT_TORQUE] == pytest.approx(15.7 * 0.8627, rel=1e-3)
    assert motor.parameters[m.TIMEOUT] == 2000  # 100 ms


# --- in order -------------------------------------------------------------------------------------


def test_a_tick_is_a_setpoint_for_each_motor(moving: Broken) -> None:
    requests: list[int] = []
    send = moving.filter.wire.send

    def counted(frames) -> None:
        requests.extend(can_id for can_id, _ in frames)
        send(frames)

    moving.filter.wire.send = counted
    moving.rig.run(1.0)
    kinds = [kind_of(can_id) for can_id in requests]
    assert kinds == [Kind.SETPOINT] * 600


@pytest.mark.parametrize("keeps", [False, True])
def test_motors_that_are_enabled_do_not_jump(arm: Broken, keeps: bool) -> None:
    rig = arm.rig
    rig.run(0.5)
    for motor in rig.arm.motors:
        motor.keeps = keeps
    before, furthest = rig.arm.plant.q.copy(), [0.0]
    rig.enable()

    def each() -> None:
        furthest[0] = max(furthest[0], float(np.abs(rig.arm.plant.q - before).max()))

    rig.run(2.0, each)
    assert furthest[0] < 0.003
    assert all(running(rig))


def test_a_stop_is_a_ramp_that_is_proved(moving: Broken) -> None:
    rig = moving.rig
    rig.request(Event.STOP)
    rig.run(1.0)
    assert rig.mode is Mode.HOLDING
    assert stands(rig)
    assert rig.drives.unproved() == ()


def test_a_hand_is_felt_and_yielded_to(moving: Broken) -> None:
    rig = moving.rig
    assert rig.permit() == []
    rig.arm.external_torque[JOINT] = 4.0
    rig.run(0.3)
    assert rig.mode in (Mode.ADMITTANCE, Mode.RETRACTING), cause(rig)
    before = float(rig.arm.plant.q[JOINT])
    rig.run(1.0)
    assert float(rig.arm.plant.q[JOINT]) - before > 0.1


# --- what fails -----------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", [m.UNDER_VOLTAGE, m.OVERLOAD])
def test_a_motor_in_fault_stops_the_arm_until_a_reset(moving: Broken, fault: int) -> None:
    rig = moving.rig
    rig.arm.motors[5].fail(fault)
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.EMERGENCY)
    assert rig.arm.motors[5].faults == fault  # nothing is cleared by itself
    assert rig.ask(Event.ENABLE)
    rig.reset()
    rig.enable()
    assert all(running(rig))


def test_a_motor_that_falls_silent_stops_the_arm_and_is_commanded_on(moving: Broken) -> None:
    rig = moving.rig
    rig.arm.motors[0].silent = True
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.STALE)
    assert "joint1" in cause(rig)
    assert all(running(rig)[1:])
    assert setpoint_id(1) in [can_id for can_id, _ in moving.filter.sent]  # it may hear
    rig.arm.motors[0].silent = False
    rig.run(1.0)
    rig.reset()
    rig.enable()


def test_a_motor_that_restarts_in_motion_stops_the_arm(moving: Broken) -> None:
    rig = moving.rig
    rig.arm.motors[JOINT].boot()
    rig.run(0.5)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.REBOOTED)
    assert not running(rig)[JOINT]  # it is not enabled unset
    rig.run(1.5)
    rig.reset()
    rig.enable()


#: 6 is a new zero, 7 a new id, 22 keeps parameters, 25 is another protocol.
@pytest.mark.parametrize("kind", [Kind.SETPOINT, Kind.ENABLE, Kind.STOP, Kind.WRITE, 6, 7, 22, 25])
def test_another_master_stops_the_arm(moving: Broken, kind: int) -> None:
    moving.filter.more.append((identifier(kind, 0xAA, 1 + JOINT), bytes(8)))
    moving.rig.run(0.2)
    assert moving.rig.mode is Mode.FAULTED
    assert cause(moving.rig).startswith(Condition.FOREIGN_MASTER)


class Falsified:
    """Wire that moves the next so many feedbacks of a motor by a way [rad]."""

    def __init__(self, wire: Wire) -> None:
        self.wire, self.send, self.left, self.way = wire, wire.send, 0, 0.0

    def receive(self, timeout: float):
        """The next frame, or what replaces it."""
        frame = self.wire.receive(timeout)
        own = frame and kind_of(frame[0]) == Kind.FEEDBACK and frame[0] >> 8 & 0xFF == JOINT + 1
        if not own or not self.left:
            return frame
        self.left -= 1
        counts = int.from_bytes(frame[1][:2], "big") + round(self.way / (8 * math.pi / 0xFFFF))
        return frame[0], counts.to_bytes(2, "big") + bytes(frame[1][2:])


@pytest.mark.parametrize(
    ("way", "frames"),
    [(6.2832, 1), (6.2832, 2), (3.0, 10), (3.0, 400), (0.25, 1), (0.25, 10), (0.25, 400)],
)
def test_a_false_feedback_moves_nothing(loaded: Broken, way: float, frames: int) -> None:
    rig = loaded.rig
    false = Falsified(loaded.filter.wire)
    loaded.filter.wire = false
    false.left, false.way = frames, way
    begun, furthest = rig.arm.plant.q.copy(), [0.0]

    def each() -> None:
        furthest[0] = max(furthest[0], float(np.abs(rig.arm.plant.q - begun).max()))

    rig.run(3.0, each)
    assert furthest[0] < 0.003
    assert all(running(rig))
    assert rig.mode is (Mode.HOLDING if frames == 1 else Mode.FAULTED)
    assert (JOINT in rig.drives.unfit()) is (frames > 1)  # what it has to hold is found anew
    if frames < 400 and rig.mode is Mode.FAULTED:
        rig.run(1.0)
        rig.reset()
        rig.enable()
        rig.run(1.0, each)
        assert furthest[0] < 0.03


# --- the guardian ---------------------------------------------------------------------------------


def test_a_daemon_that_dies_leaves_an_arm_that_holds(loaded: Broken) -> None:
    rig = loaded.rig
    assert without_the_daemon(rig, 5.0) < 0.01
    assert all(running(rig))
    assert isinstance(rig.guard, GuardianAtBus)
    assert rig.guard.guardian.activity is Activity.HOLDS


def test_without_a_guardian_the_arm_falls(loaded: Broken) -> None:
    rig = loaded.rig
    assert isinstance(rig.guard, GuardianAtBus)
    rig.guard.killed = True
    assert without_the_daemon(rig, 2.0) > 0.2
    assert not any(running(rig))


def test_a_daemon_that_comes_back_finds_a_fault_and_an_arm_where_it_was(loaded: Broken) -> None:
    rig = loaded.rig
    without_the_daemon(rig, 0.5)
    begun = rig.arm.plant.q.copy()
    rig.ticks += round(0.5 / T)
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.ABSENT)
    assert np.abs(rig.arm.plant.q - begun).max() < 0.02
    assert all(running(rig))


@pytest.mark.parametrize("left", [False, True])
def test_only_an_arm_that_was_not_left_holding_is_lowered_in_time(
    loaded: Broken, left: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = loaded.rig
    monkeypatch.setattr("drivers.motors.guardian.LOWERS_AFTER_S", 1.0)
    if left:
        with rig.lockstep.serving():
            rig.drives.disable_monitoring()
        assert {motor.parameters[Parameter.TIMEOUT] for motor in rig.arm.motors} == {0}
    without_the_daemon(rig, 0.9)
    assert (without_the_daemon(rig, 4.0) > 0.1) is not left
    assert all(running(rig))


class Lossy(dict[int, float]):
    """Parameters of a motor that misses the first frame that switches its time-out off."""

    missed = False

    def __setitem__(self, parameter: int, value: float) -> None:
        if parameter == m.TIMEOUT and value == 0 and not self.missed:
            self.missed = True
        else:
            super().__setitem__(parameter, value)


def test_a_lost_frame_leaves_no_motor_that_lets_go_after_the_end(arm: Broken) -> None:
    rig = arm.rig
    for motor in rig.arm.motors:
        motor.parameters = Lossy(motor.parameters)
    rig.enable()
    with rig.lockstep.serving():
        rig.drives.disable_monitoring()
    assert [motor.parameters[m.TIMEOUT] for motor in rig.arm.motors] == [0] * len(rig.arm.motors)


class Stubborn(dict[int, float]):
    """Parameters of a motor that keeps its time-out."""

    def __setitem__(self, parameter: int, value: float) -> None:
        if parameter != m.TIMEOUT:
            super().__setitem__(parameter, value)


@pytest.mark.parametrize("model", ["says it", "says 0", "has no answer"])
def test_a_time_out_that_stays_is_named_where_the_model_says_it(
    arm: Broken, monkeypatch: pytest.MonkeyPatch, model: str
) -> None:
    rig = arm.rig
    rig.enable()
    motor = rig.arm.motors[2]
    motor.parameters = Stubborn(motor.parameters)
    if model == "says it":
        monkeypatch.setattr(m, "_WRITE_ONLY", {m.ZERO_STA})
    elif model == "has no answer":
        monkeypatch.setattr(m.RobStrideMotor, "_on_read", lambda self, index: None)
    with rig.lockstep.serving():
        if model == "says it":
            with pytest.raises(DriveError, match=r"joint3.*0x7028"):
                rig.drives.disable_monitoring()
        else:
            rig.drives.disable_monitoring()
    assert [motor.parameters[m.TIMEOUT] == 0 for motor in rig.arm.motors] == [
        i != 2 for i in range(6)
    ]
