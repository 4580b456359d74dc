"""Damiao arm that holds while a daemon begins: it is not let go before the first setpoint, and only
a guardian that holds it may command beside us."""

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import OPENARM, Rig, lockstep_rig
from common.errors import BusError, SilentDriveError
from daemon.config.load import load_robot
from daemon.drives import build_motors
from daemon.modes.table import Event, Mode
from drivers.can.wire import Frame
from drivers.damiao.frames import Status
from drivers.motors.guardian import BEAT, Activity
from simulator.damiao.registers import TIMEOUT

T = 0.01
SLOW = 0.5  # a start of the daemon [s], five times what the motors wait for


@pytest.fixture
def rig() -> Iterator[Rig]:
    """An arm that holds a load, off; no guardian."""
    with lockstep_rig(OPENARM) as rig:
        assert isinstance(rig.guard, GuardianAtBus)
        rig.guard.killed = True
        rig.enable()
        rig.arm.external_torque[1] = -4.0
        rig.run(1.0)
        rig.request(Event.DISABLE)
        rig.run(0.5)
        assert rig.mode is Mode.OFF
        yield rig


def time_outs(rig: Rig) -> set[float]:
    return {motor.registers.values[TIMEOUT] for motor in rig.arm.motors}


def test_a_slow_start_without_a_guardian_lets_no_arm_go(rig: Rig) -> None:
    wanted, begun = time_outs(rig), rig.arm.plant.q.copy()
    rig.take_up(rig.robot)
    for _ in range(round(SLOW / T)):
        rig.arm.advance(rig.arm.now + T)
    assert time_outs(rig) == {0.0}
    rig.run(1.0)
    assert rig.mode is Mode.OFF
    assert all(motor.status == Status.ENABLED for motor in rig.arm.motors)
    assert np.abs(rig.arm.plant.q - begun).max() < 0.05  # its load over its stiffness
    assert time_outs(rig) == wanted


@pytest.mark.parametrize(
    ("heard", "error"),
    [
        ([(0x001, bytes(8)), (BEAT, bytes([Activity.HOLDS]))], SilentDriveError),
        ([(BEAT, bytes([Activity.LOWERS])), (0x001, bytes(8))], SilentDriveError),
        ([(0x001, bytes(8)), (BEAT, bytes([Activity.WATCHES]))], BusError),
        ([(0x001, bytes(8))], BusError),
        ([(BEAT, bytes([Activity.WATCHES])), (0x7FF, bytes(8))], BusError),
    ],
)
def test_setpoints_of_a_guardian_that_holds_are_no_other_masters(
    heard: list[Frame], error: type[Exception]
) -> None:
    frames = deque(heard)

    class Bus:
        def receive(self, timeout: float) -> Frame | None:
            return frames.popleft() if frames else None

        def send(self, frames: Sequence[Frame]) -> None:
            pass

    c = load_robot(OPENARM).configuration
    arm = build_motors(Bus(), c.joint_drives, T, lambda: 0.0, c.bus.bitrate, listen_s=0.01)
    with pytest.raises(error) as raised:
        arm.boot_up(lambda text: None)
    assert type(raised.value) is error
    assert ("another master" in str(raised.value)) is (error is BusError)
