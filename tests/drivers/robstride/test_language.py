"""Language of RobStride motors: whose a frame is, what it says, and what is sent."""

import pytest

from bench.rigs.lockstep import BEAM
from daemon.config.load import load_robot
from drivers.can.wire import EXTENDED
from drivers.motors.language import Feedback, State
from drivers.robstride import frames as f
from drivers.robstride.frames import HOST, Fault, Kind, Parameter, identifier
from drivers.robstride.language import RobStrideLanguage

DRIVES = load_robot(BEAM).configuration.joint_drives
MIDDLE = bytes.fromhex("7FFF7FFF7FFF00FA")


@pytest.fixture
def language() -> RobStrideLanguage:
    return RobStrideLanguage(DRIVES)


@pytest.mark.parametrize("host", [0x00, 0xAA, HOST, 0xFF])
def test_an_answer_counts_whomever_it_is_sent_to(language: RobStrideLanguage, host: int) -> None:
    assert language.answering(identifier(Kind.FEEDBACK, 0x8000 | 3, host)) == 2


@pytest.mark.parametrize(
    ("can_id", "commands", "masters"),
    [
        (f.setpoint_id(3), 2, True),
        (identifier(Kind.SETPOINT, 0x1234, 3), 2, True),
        (identifier(Kind.ENABLE, 0xAA, 3), 2, True),
        (identifier(Kind.STOP, 0xAA, 3), 2, True),
        (identifier(Kind.WRITE, 0xAA, 3), None, True),
        (identifier(Kind.READ, 0xAA, 3), None, False),
        (identifier(Kind.SETPOINT, 0x7FFF, 9), None, False),  # no motor of this arm
        (identifier(Kind.FEEDBACK, 3, HOST), None, False),
        (3, None, False),
    ],
)
def test_frames_of_a_master(
    language: RobStrideLanguage, can_id: int, commands: int | None, masters: bool
) -> None:
    assert language.commanded(can_id) == commands
    assert language.masters(can_id) is masters


@pytest.mark.parametrize(
    ("mode", "faults", "state", "powered"),
    [
        (0, Fault(0), State.OFF, False),
        (1, Fault(0), State.OFF, False),
        (2, Fault(0), State.ON, True),
        (0, Fault.OVERLOAD, State.FAILED, False),
        (2, Fault.OVERHEATED | Fault.OVERCURRENT, State.FAILED, True),
    ],
)
def test_statuses(
    language: RobStrideLanguage, mode: int, faults: Fault, state: State, powered: bool
) -> None:
    can_id = identifier(Kind.FEEDBACK, (mode << 6 | faults) << 8 | 3, HOST)
    found = language.answer_of(2, can_id, MIDDLE)
    assert isinstance(found, Feedback)
    assert (found.status.state, found.status.powered) == (state, powered)
    assert found.position == language.middle[0]
    assert found.degC == pytest.approx(25.0)
    assert language.answer_of(2, can_id, MIDDLE[:7]) is None


def test_a_tick_begins_with_the_first_motor(language: RobStrideLanguage) -> None:
    language.pack(0, 0.5, 0.0)
    assert language.begins(language.requests[0])
    assert language.begins(language.setpoints[0])
    assert not language.begins(language.setpoints[1])


def test_a_request_is_the_time_out_again(language: RobStrideLanguage) -> None:
    assert [can_id for can_id, _ in language.requests] == [
        EXTENDED | 0x1200FD00 | drive.node for drive in DRIVES
    ]
    assert {bytes(data).hex() for _, data in language.requests} == {"28700000d0070000"}
    assert language.time_out_of(*language.requests[2]) == (2, True)
    assert language.time_out_of(*f.write(3, Parameter.TIMEOUT, 0)) == (2, False)
    assert language.time_out_of(*f.write(3, Parameter.TORQUE_LIMIT, 0)) is None


def test_what_was_heard_is_said_again_without_its_velocity(language: RobStrideLanguage) -> None:
    language.pack(2, 0.5, 0.7)
    heard = bytes(language.setpoints[2][1])
    said = language.restated(2, heard, 0.4)
    assert language.setpoint_of(2, f.setpoint_id(3), said) == pytest.approx((0.4, 0.0), abs=1e-3)
    assert f.fields_of(said)[2:] == f.fields_of(heard)[2:]
