"""RobStride motors of one arm in the whole program, against simulated ones that fail; further tests
of every make are in tests/drivers/motors."""

import math

import numpy as np
import pytest

from common.errors import DriveError
from daemon.modes.table import Event, Mode
from drivers.can.wire import Wire
from drivers.robstride.frames import Kind, kind_of
from simulator.robstride import motor as m
from tests.drivers.motors.one_arm import ROBSTRIDE, Filtered, Make, cause, furthest, powered

JOINT = ROBSTRIDE.joint
LOAD = 3.0  # [Nm]


@pytest.fixture
def make() -> Make:
    return ROBSTRIDE


@pytest.fixture
def loaded(arm: Filtered) -> Filtered:
    """One that holds against a load."""
    rig = arm.rig
    rig.enable()
    rig.run(0.5)
    rig.arm.external_torque[JOINT] = LOAD
    rig.run(1.0)
    assert rig.mode is Mode.HOLDING
    return arm


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
def test_a_motor_that_is_not_as_configured_is_refused(arm: Filtered, made, says: str) -> None:
    made(arm.rig.arm.motors[4])
    with arm.rig.lockstep.serving(), pytest.raises(DriveError, match=says):
        arm.rig.drives.boot_up(lambda line: None)


def test_every_motor_has_a_number_of_its_own(arm: Filtered) -> None:
    assert len(set(arm.rig.drives.serials)) == 6


def test_a_restarted_motor_is_set_up_again_before_the_arm_is_enabled(arm: Filtered) -> None:
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


def test_each_tick_sends_one_setpoint_to_each_motor(moving: Filtered) -> None:
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
def test_motors_that_are_enabled_do_not_jump(arm: Filtered, keeps: bool) -> None:
    rig = arm.rig
    rig.run(0.5)
    for motor in rig.arm.motors:
        motor.keeps = keeps
    begun = rig.arm.plant.q.copy()
    rig.enable()
    assert np.abs(rig.arm.plant.q - begun).max() < 0.003
    assert furthest(rig, 2.0).max() < 0.003
    assert all(powered(rig))


def test_a_push_is_detected_and_yielded_to(moving: Filtered) -> None:
    rig = moving.rig
    assert rig.permit() == []
    rig.arm.external_torque[JOINT] = 4.0
    rig.run(0.3)
    assert rig.mode in (Mode.ADMITTANCE, Mode.RETRACTING), cause(rig)
    before = float(rig.arm.plant.q[JOINT])
    rig.run(1.0)
    assert float(rig.arm.plant.q[JOINT]) - before > 0.1


# --- what fails -----------------------------------------------------------------------------------


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
def test_a_false_feedback_moves_nothing(loaded: Filtered, way: float, frames: int) -> None:
    rig = loaded.rig
    false = Falsified(loaded.filter.wire)
    loaded.filter.wire = false
    false.left, false.way = frames, way
    begun = rig.arm.plant.q.copy()
    assert furthest(rig, 3.0).max() < 0.003
    assert all(powered(rig))
    assert rig.mode is (Mode.HOLDING if frames == 1 else Mode.FAULTED)
    assert (JOINT in rig.drives.unfit()) is (frames > 1)  # what it has to hold is found anew
    if frames < 400 and rig.mode is Mode.FAULTED:
        rig.run(1.0)
        rig.reset()
        rig.enable()
        way = np.abs(rig.arm.plant.q - begun) + furthest(rig, 1.0)
        assert way.max() < 0.03


# --- the end --------------------------------------------------------------------------------------


class Lossy(dict[int, float]):
    """Parameters of a motor that misses the first frame that switches its time-out off."""

    missed = False

    def __setitem__(self, parameter: int, value: float) -> None:
        if parameter == m.TIMEOUT and value == 0 and not self.missed:
            self.missed = True
        else:
            super().__setitem__(parameter, value)


def test_a_lost_frame_leaves_no_motor_with_a_time_out(arm: Filtered) -> None:
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
def test_a_time_out_that_stays_is_named_where_it_can_be_read(
    arm: Filtered, monkeypatch: pytest.MonkeyPatch, model: str
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
