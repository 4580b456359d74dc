"""Numbers of setpoints and answers, in any make's language."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rigs.lockstep import BEAM, OPENARM
from daemon.config.load import load_robot
from drivers.can.wire import EXTENDED
from drivers.damiao.frames import ANSWERS
from drivers.damiao.language import DamiaoLanguage
from drivers.makes import LANGUAGES
from drivers.motors.language import Language, Output, scaled
from drivers.robstride.frames import HOST, Kind, identifier

ARMS = pytest.mark.parametrize("arm", [OPENARM, BEAM])


def language_of(arm: Path) -> Language:
    drives = load_robot(arm).configuration.joint_drives
    language: Language = LANGUAGES[type(drives[0].profile)](drives)
    return language


LANGUAGE = {arm: language_of(arm) for arm in (OPENARM, BEAM)}


@given(st.floats(-100.0, 100.0), st.sampled_from((12, 16)))
def test_a_scaled_value_is_the_nearest_that_there_is(value: float, bits: int) -> None:
    step = 2.0 * 12.5 / ((1 << bits) - 1)
    found = scaled(value, 12.5, bits) * step - 12.5
    assert abs(found - min(max(value, -12.5), 12.5)) <= 0.5 * step + 1e-9


@ARMS
@given(p=st.floats(-1e300, 1e300), v=st.floats(-1e300, 1e300), joint=st.integers(0, 5))
def test_a_setpoint_beyond_its_range_is_its_end(arm: Path, p: float, v: float, joint: int) -> None:
    language = LANGUAGE[arm]
    profile = language.profiles[joint]
    language.pack(joint, 0.0, 0.0)
    gains = language.fields(language.setpoints[joint][1])[2:]
    language.pack(joint, p, v)
    can_id, data = language.setpoints[joint]
    found = language.setpoint_of(joint, can_id, data)
    assert found is not None
    most = profile.position_max, profile.velocity_max
    for value, wanted, end, step in zip(found, (p, v), most, language.steps[joint], strict=False):
        assert abs(value - min(max(wanted, -end), end)) <= step
    assert language.fields(data)[2:] == gains
    assert language.commanded(can_id) == joint
    assert language.answering(can_id) is None


@ARMS
@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0)])
def test_none_is_made_of_what_is_no_number(arm: Path, place: tuple[float, float]) -> None:
    """The frame stays as it was: the motor goes on with the setpoint before."""
    language = LANGUAGE[arm]
    language.pack(1, 0.5, 0.1)
    before = bytes(language.setpoints[1][1])
    with pytest.raises((ValueError, OverflowError)):
        language.pack(1, *place)
    assert bytes(language.setpoints[1][1]) == before


#: Any of 11 and of 29 bits, and those by which motors of each make answer.
IDS = (
    st.integers(0, 0x7FF)
    | st.integers(EXTENDED, EXTENDED | 0x1FFF_FFFF)
    | st.integers(ANSWERS + 1, ANSWERS + 7)
    | st.integers(0, 0xFFFF).map(lambda code: identifier(Kind.FEEDBACK, code & 0xFF07, HOST))
)


@ARMS
@given(can_id=IDS, data=st.binary(max_size=8))
def test_any_frame_is_one_motors_answer_or_none(arm: Path, can_id: int, data: bytes) -> None:
    language = LANGUAGE[arm]
    joint = language.answering(can_id)
    assert joint is None or language.commanded(can_id) is None
    if joint is not None:
        found = language.answer_of(joint, can_id, data)
        assert found is None or len(data) == 8
        if isinstance(found, Output):
            assert found.position is None or abs(found.position) <= 12.5


@given(sender=st.integers(0, 0xFF), head=st.integers(0, 0xFF))
def test_an_answer_is_of_the_motor_in_it(sender: int, head: int) -> None:
    """A Damiao motor says its id twice, in the identifier and in the data."""
    one: DamiaoLanguage = LANGUAGE[OPENARM]  # type: ignore[assignment]
    joint = one.answering(sender + ANSWERS)
    assert (joint is not None) is (sender in one.motors)
    if joint is not None:
        found = one.answer_of(joint, sender + ANSWERS, bytes((head, 0, 0x7F, 0, 0, 0, 0, 0)))
        assert (found is not None) is (head & 0xF == sender)
    beam = LANGUAGE[BEAM]
    assert (beam.answering(identifier(Kind.FEEDBACK, head << 8 | sender, HOST)) is not None) is (
        sender in beam.motors
    )
