"""Damiao motors of one arm in the whole program, against simulated ones that fail."""

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import OPENARM, lockstep_rig
from common.errors import DriveError
from daemon.config.schema import Configuration
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from drivers.api import PowerTarget
from drivers.can.wire import Frame
from drivers.damiao.frames import ANSWERS, Status, setpoint_of
from tests.drivers.motors.one_arm import DAMIAO, Filtered, Make, cause, furthest

ON = PowerTarget.ON
JOINT = DAMIAO.joint


@pytest.fixture
def make() -> Make:
    return DAMIAO


# --- set-up ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("register", "value", "says"),
    [(21, 3.14, "position_max"), (22, 8.0, "velocity_max"), (23, 7.0, "torque_max_Nm"),
     (20, 6.0, "model")],
)  # fmt: skip
def test_a_motor_that_is_not_as_configured_is_refused(
    arm: Filtered, register: int, value: float, says: str
) -> None:
    arm.rig.arm.motors[2].registers.values[register] = value
    with arm.rig.lockstep.serving(), pytest.raises(DriveError, match=says):
        arm.rig.drives.boot_up(lambda line: None)


def test_a_reset_motor_is_set_up_again_before_the_arm_is_enabled(arm: Filtered) -> None:
    rig = arm.rig
    rig.run(0.1)
    rig.arm.motors[1].boot()
    assert rig.arm.motors[1].registers.number(9) == 0
    assert rig.ask(Event.ENABLE) == []
    rig.run(0.6)
    assert rig.mode is Mode.HOLDING
    assert rig.arm.motors[1].registers.number(9) == 2000  # 100 ms


# --- in order -------------------------------------------------------------------------------------


def test_enabled_it_holds_and_disabled_each_joint_ends_as_configured() -> None:
    def limp_wrist(c: Configuration) -> Configuration:
        *others, last = c.joints
        limp = msgspec.structs.replace(last, end="limp")
        return msgspec.structs.replace(c, joints=[*others, limp])

    with lockstep_rig(OPENARM, configure=limp_wrist) as rig:
        rig.enable()
        rig.run(1.0)
        assert furthest(rig, 3.0).max() < 0.002
        rig.request(Event.DISABLE)
        rig.run(1.0)
        assert rig.mode is Mode.OFF
        statuses = [motor.status for motor in rig.arm.motors]
        assert statuses == [Status.ENABLED] * 6 + [Status.DISABLED]


def test_a_daemon_that_ends_leaves_joints_that_hold_by_themselves(arm: Filtered) -> None:
    rig = arm.rig
    rig.enable()
    rig.run(1.0)
    with rig.lockstep.serving():
        rig.drives.disable_monitoring()
    before = rig.arm.plant.q.copy()
    rig.arm.advance(rig.arm.now + 3.0)
    assert all(motor.status == Status.ENABLED for motor in rig.arm.motors)
    assert np.abs(rig.arm.plant.q - before).max() < 0.005


def test_a_push_against_a_holding_joint_keeps_its_setpoint_near(arm: Filtered) -> None:
    rig = arm.rig
    rig.enable()
    rig.run(0.5)
    drive = rig.robot.configuration.joint_drives[JOINT]
    most = drive.wiring.max_current_A * drive.profile.Nm_per_A / drive.profile.stiffness
    rig.arm.external_torque[JOINT] = 25.0  # nearly all that its motor gives
    for _ in range(100):
        rig.step()
        positions = rig.drives._setpoints.positions
        here = rig.samples.motor_position
        assert here is not None
        assert abs(positions[JOINT] - here[JOINT]) < most + 0.05


def test_a_limp_joint_may_be_moved_by_hand(arm: Filtered) -> None:
    rig = arm.rig
    rig.run(0.5)
    moved = 0.0
    for k in range(600):
        rig.arm.external_torque[JOINT] = 2.0 if k % 60 < 30 else -2.0
        rig.step()
        moved = max(moved, abs(float(rig.samples.motor_velocity[JOINT])))
    assert moved > 1.0
    assert rig.mode is Mode.OFF, cause(rig)
    assert not rig.drives._stops.watches.each[JOINT].cut


# --- what fails -----------------------------------------------------------------------------------


@pytest.mark.parametrize("lost", [1, 2])
def test_a_lost_answer_is_one_missing_sample(moving: Filtered, lost: int) -> None:
    rig, answers = moving.rig, 17 + JOINT
    for _ in range(5):
        left = [lost]

        def passes(can_id: int, data: bytes, left: list[int] = left) -> bool:
            if can_id == answers and left[0]:
                left[0] -= 1
                return False
            return True

        moving.filter.passes = passes
        rig.step()
        moving.filter.passes = lambda can_id, data: True
        rig.run(0.3)
    assert rig.mode is Mode.TRACKING, cause(rig)


def test_two_motors_with_one_id_stop_the_arm(moving: Filtered) -> None:
    wire, doubled = moving.filter.wire, 17 + JOINT

    class Twice:
        def receive(self, timeout: float) -> Frame | None:
            frame = wire.receive(timeout)
            if frame is not None and frame[0] == doubled:
                moving.filter.more.append((frame[0], bytes(frame[1])))
            return frame

        send = staticmethod(wire.send)

    moving.filter.wire = Twice()
    moving.rig.run(0.5)
    assert moving.rig.mode is Mode.FAULTED
    assert cause(moving.rig).startswith(Condition.TWO_DRIVES)


def test_a_velocity_that_is_no_number_stops_all_motors(moving: Filtered) -> None:
    rig = moving.rig
    drives = rig.drives
    velocity = np.zeros(7)
    velocity[2] = np.nan
    drives.command(ON, velocity)
    held = [setpoint_of(data) for can_id, data in moving.filter.sent if can_id < ANSWERS]
    assert all(found is not None for found in held)
    before = [found[1] for found in held if found]
    for _ in range(60):
        drives.command(ON, velocity)
    after = [found[1] for _, data in moving.filter.sent if (found := setpoint_of(data))]
    assert max(abs(counts - 0x7FF) for counts in before) > 5
    assert max(abs(counts - 0x7FF) for counts in after) <= 1
