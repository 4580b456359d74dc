"""Setpoints of Damiao motors, and answers about registers, without a bus."""

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rigs.lockstep import OPENARM
from daemon.config.load import load_robot
from drivers.can.wire import Frame
from drivers.damiao.frames import ANSWERS, Register, setpoint_of
from drivers.damiao.language import DamiaoLanguage
from drivers.damiao.setup import DamiaoSetup
from drivers.motors.setpoints import Setpoints

T = 0.01
DRIVES = load_robot(OPENARM).configuration.joint_drives
DRIVE = DRIVES[0]
REACH = DRIVE.wiring.max_current_A * DRIVE.profile.Nm_per_A / DRIVE.profile.stiffness
FOLLOWS = DRIVE.velocity * T


@pytest.fixture
def setpoints() -> Setpoints:
    return Setpoints(DRIVES, DamiaoLanguage(DRIVES), T)


def test_there_is_none_until_its_motor_is_known(setpoints: Setpoints) -> None:
    assert not setpoints.write(0, 0.5, math.nan, 3.0, powered=True)
    assert setpoints.stop() == []
    assert setpoints.write(0, 0.5, 0.1, 0.0, powered=False)
    assert [can_id for can_id, _ in setpoints.stop()] == [DRIVE.node]


@given(
    st.lists(
        st.tuples(
            st.floats(-1.0, 1.0),
            st.one_of(st.just(math.nan), st.floats(-12.0, 12.0)),
            st.booleans(),
        ),
        min_size=2,
    )
)
def test_no_setpoint_steps_further_than_its_joint_may_move(
    ticks: list[tuple[float, float, bool]],
) -> None:
    setpoints, before = Setpoints(DRIVES, DamiaoLanguage(DRIVES), T), math.nan
    for velocity, measured, powered in ticks:
        setpoints.write(0, velocity, measured, 0.0, powered=powered)
        p = setpoints.positions[0]
        assert math.isnan(before) or abs(p - before) <= max(FOLLOWS, abs(velocity) * T) + 1e-9
        before = p


def test_a_limp_motor_is_followed_and_may_be_enabled_when_it_was_reached(
    setpoints: Setpoints,
) -> None:
    setpoints.write(0, 0.0, 0.0, 0.0, powered=False)
    ticks = 0
    while not setpoints.at(0, 0.3):
        setpoints.write(0, 0.0, 0.3, 0.0, powered=False)
        ticks += 1
    assert ticks == math.ceil(0.3 / FOLLOWS)
    found = setpoint_of(setpoints.stop()[0][1])
    assert found
    assert (found[0] / 0xFFFF * 2 - 1) * DRIVE.profile.position_max == pytest.approx(0.3, abs=3e-4)


def test_a_motor_that_holds_is_taken_up_where_its_torque_says(setpoints: Setpoints) -> None:
    setpoints.write(0, 0.0, 0.2, 2.0, powered=True)
    beyond = 2.0 * DRIVE.profile.Nm_per_A / DRIVE.profile.stiffness
    assert setpoints.positions[0] == pytest.approx(0.2 + beyond)
    setpoints.forget([0])
    setpoints.write(0, 0.0, 0.2, 1e9, powered=True)
    assert setpoints.positions[0] == pytest.approx(0.2 + REACH)


class Answers:
    """Wire with these answers, which come after a question."""

    def __init__(self, *data: str) -> None:
        self.data = [bytes.fromhex(text) for text in data]
        self.queued: Iterator[bytes] = iter(())

    def send(self, frames: list[Frame]) -> None:
        self.queued = iter(self.data)

    def receive(self, timeout: float) -> Frame | None:
        data = next(self.queued, None)
        return None if data is None else (1 + ANSWERS, data)


def test_an_answer_to_writing_is_none_to_reading() -> None:
    written, read = "01005509D0070000", "01003309C4090000"
    drive: Any = SimpleNamespace(node=1, profile=SimpleNamespace(answer_timeout_s=0.05))
    assert DamiaoSetup(Answers(written, read)).read(drive, Register.TIMEOUT) == 0x9C4
