"""PDOs to SI values and back."""

import struct

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import ConfigurationError
from drivers.canopen.codec import (
    SampleDecoder,
    SetpointEncoder,
    link_side,
    receive_pdos,
    transmit_pdos,
    type_limits,
)
from drivers.canopen.settings import CanopenProfile, Quantity
from drivers.drive import Drive
from drivers.wiring import Harmonic, JointWiring

INT16 = st.integers(-(2**15), 2**15 - 1)
INT32 = st.integers(-(2**31), 2**31 - 1)
SIGN = st.sampled_from([-1, 1])


def wiring(node=1, **changes) -> JointWiring:
    values = {"gear": 100.0, "rated_current_A": 2.0, "max_current_A": 4.0} | changes
    return JointWiring(node=node, profile="plain", **values)


def quantity(index, kind="INTEGER32", scale=0.01, **changes) -> Quantity:
    return Quantity(object=index, type=kind, scale=scale, **changes)


def drive(profile: CanopenProfile, name="elbow", **changes) -> Drive:
    return Drive(name, wiring(**changes), profile, velocity=1.0, quick_stop=10.0)


def plain_profile(**changes) -> CanopenProfile:
    values = {
        "eds": "drive.eds",
        "current": quantity(0x6078, "INTEGER16", 0.001),
        "link_position": quantity(0x60E4, scale=2e-5, subindex=1),
        "motor_velocity": quantity(0x606C),
        "target_velocity": quantity(0x60FF),
        "quick_stop_deceleration": quantity(0x6085, "UNSIGNED32"),
        "tpdo": {"1": ["statusword", "current", "motor_velocity"], "2": ["link_position"]},
        "rpdo": {"1": ["controlword", "target_velocity"]},
    }
    return CanopenProfile(**values | changes)


def decoded(drives, frames) -> SampleDecoder:
    """Decoder of these drives after one frame of each COB-ID."""
    decoder = SampleDecoder(drives)
    for cob_id, data in frames.items():
        _, start, stop, layout = decoder.slots[cob_id]
        decoder.raw[start:stop] = layout.unpack(data)
    decoder.decode()
    return decoder


def test_romeo_uses_the_predefined_connection_set(joint_drives):
    fifth = joint_drives[4]
    assert [hex(pdo.cob_id) for pdo in transmit_pdos(fifth)] == ["0x185", "0x285"]
    assert [hex(pdo.cob_id) for pdo in receive_pdos(fifth)] == ["0x205"]
    assert [pdo.layout.format for pdo in transmit_pdos(fifth)] == ["<Hhi", "<ii"]
    assert receive_pdos(fifth)[0].layout.format == "<Hi"
    assert [field.bits for field in transmit_pdos(fifth)[0].fields] == [16, 16, 32]


@given(
    current=INT16, velocity=INT32, link=INT32, motor=INT32, motor_sign=SIGN, link_sign=SIGN,
    sign=SIGN, link_offset=st.floats(-3, 3), offset=st.floats(-3, 3),
)  # fmt: skip
def test_counts_arrive_as_si_values_at_the_link(
    current, velocity, link, motor, motor_sign, link_sign, sign, link_offset, offset
):
    profile = plain_profile(
        link_position=quantity(0x60E4, scale=2e-5, sign=sign, offset=offset),
        motor_position=quantity(0x6064, scale=1e-3, sign=sign),
        tpdo={"2": ["link_position", "motor_position"],
              "1": ["motor_velocity", "statusword", "current"]},
    )  # fmt: skip
    signs = {"motor_sign": motor_sign, "link_sign": link_sign, "link_offset": link_offset}
    frames = {
        0x181: struct.pack("<iHh", velocity, 0x27, current),
        0x281: struct.pack("<ii", link, motor),
    }
    decoder = decoded([drive(profile, **signs)], frames)
    assert decoder.statuswords == (0x27,)
    for found, expected in (
        (decoder.current, motor_sign * 2.0 * 0.001 * current),
        (decoder.motor_velocity, motor_sign * 0.01 * velocity / 100.0),
        (decoder.motor_position, motor_sign * sign * 1e-3 * motor / 100.0),
        (decoder.link_position, link_sign * sign * (offset + 2e-5 * link) + link_offset),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@given(link=st.integers(-157080, 157080), link_sign=SIGN, link_offset=st.floats(-3, 3))
def test_harmonic_errors_of_an_encoder_are_corrected(link, link_sign, link_offset):
    """Correction of its joint alone, by the angle of the encoder itself."""
    harmonics = [Harmonic(order=1, cosine=0.0004, sine=-0.0003), Harmonic(order=3, sine=0.002)]
    corrected = {"link_sign": link_sign, "link_offset": link_offset, "link_correction": harmonics}
    drives = [drive(plain_profile(), "a"), drive(plain_profile(), "b", node=2, **corrected)]
    decoder = decoded(drives, dict.fromkeys((0x281, 0x282), struct.pack("<i", link)))
    angle = link_sign * 2e-5 * link
    error = 0.0004 * np.cos(angle) - 0.0003 * np.sin(angle) + 0.002 * np.sin(3.0 * angle)
    expected = [2e-5 * link, angle + link_offset - error]
    np.testing.assert_allclose(decoder.link_position, expected, rtol=0, atol=1e-12)
    assert not decoder.link_position.flags.writeable


def test_nothing_is_known_before_the_first_frame(joint_drives):
    decoder = decoded(joint_drives, {})
    assert np.isnan([decoder.current, decoder.link_position, decoder.motor_velocity]).all()
    assert decoder.statuswords == (-1,) * 7


def test_drives_of_two_kinds_share_an_arm():
    other = plain_profile(
        current=quantity(0x6077, "INTEGER16", 0.002, sign=-1),
        motor_position=quantity(0x6064),
        tpdo={"1": ["link_position", "current", "statusword"],
              "3": ["motor_position", "motor_velocity"]},
    )  # fmt: skip
    frames = {
        0x181: struct.pack("<Hhi", 0x40, 500, 100),
        0x281: struct.pack("<i", 1000),
        0x182: struct.pack("<ihH", 2000, 500, 0x27),
        0x382: struct.pack("<ii", 7, 300),
    }
    decoder = decoded([drive(plain_profile(), "a"), drive(other, "b", node=2)], frames)
    joints = {cob_id: slot[0] for cob_id, slot in decoder.slots.items()}
    assert joints == {0x181: 0, 0x281: 0, 0x182: 1, 0x382: 1}
    assert decoder.statuswords == (0x40, 0x27)
    np.testing.assert_allclose(decoder.current, [1.0, -2.0])
    np.testing.assert_allclose(decoder.link_position, [0.02, 0.04])
    np.testing.assert_allclose(decoder.motor_velocity, [0.01, 0.03])
    assert decoder.motor_position is None, "only one of the drives sends it"


@given(
    velocity=st.floats(-100, 100), gear=st.floats(0.5, 500), motor_sign=SIGN, sign=SIGN,
    scale=st.floats(1e-3, 1.0),
)  # fmt: skip
def test_a_setpoint_is_right_within_half_a_count(velocity, gear, motor_sign, sign, scale):
    profile = plain_profile(target_velocity=quantity(0x60FF, scale=scale, sign=sign))
    elbow = drive(profile, gear=gear, motor_sign=motor_sign)
    encoder = SetpointEncoder([elbow])
    (counts,) = encoder.encode(np.array([velocity]))
    gain, bias = link_side(elbow, "target_velocity")
    assert gain == pytest.approx(motor_sign * sign * scale / gear)
    assert abs(gain * counts + bias - velocity) <= 0.5 * abs(gain) * (1 + 1e-9)
    assert encoder.standstill == [0]


@pytest.mark.parametrize("kind", ["INTEGER16", "INTEGER32"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_setpoint_is_saturated_at_the_limits_of_its_type(kind, sign):
    profile = plain_profile(target_velocity=quantity(0x60FF, kind, sign=sign))
    encoder = SetpointEncoder([drive(profile, "a"), drive(profile, "b", node=2)])
    lowest, highest = type_limits(kind)
    limits = [highest, lowest] if sign == 1 else [lowest, highest]
    assert encoder.encode(np.array([1e9, -1e9])) == limits
    for counts in ([highest, lowest], [highest - 1, lowest + 1]):
        assert encoder.encode(sign * np.array(counts) * 0.01 / 100.0) == counts


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_setpoint_that_is_not_finite_is_refused(joint_drives, bad):
    velocity = np.zeros(7)
    velocity[3] = bad
    with pytest.raises(ValueError, match="not finite"):
        SetpointEncoder(joint_drives).encode(velocity)


@pytest.mark.parametrize(
    ("kind", "limits"),
    [
        ("INTEGER8", (-128, 127)),
        ("UNSIGNED8", (0, 255)),
        ("INTEGER16", (-32768, 32767)),
        ("UNSIGNED16", (0, 65535)),
        ("INTEGER32", (-(2**31), 2**31 - 1)),
        ("UNSIGNED32", (0, 2**32 - 1)),
    ],
)
def test_type_limits(kind, limits):
    assert type_limits(kind) == limits


FIRST = "statusword current motor_velocity"


@pytest.mark.parametrize(
    ("direction", "layout", "says"),
    [
        ("tpdo", ["statusword current"], "tpdo: link_position, motor_velocity missing"),
        ("tpdo", ["current motor_velocity", "link_position"], "statusword"),
        ("tpdo", ["link_position motor_velocity current"], "10 bytes; 8 are"),
        ("tpdo", [FIRST, "link_position current"], "more than once"),
        ("tpdo", [FIRST, "link_position motor_position"],
         "lists `motor_position`, but the drive profile does not define it"),
        ("tpdo", [FIRST, "link_position controlword"], "tpdo: controlword is not allowed"),
        ("rpdo", ["controlword"], "target_velocity missing"),
        ("rpdo", ["target_velocity"], "controlword missing"),
        ("rpdo", ["controlword statusword"], "rpdo: statusword is not allowed"),
    ],
)  # fmt: skip
def test_an_impossible_layout_of_pdos_is_refused(direction, layout, says):
    pdos = {str(number): names.split() for number, names in enumerate(layout, 1)}
    mapped = transmit_pdos if direction == "tpdo" else receive_pdos
    with pytest.raises(ConfigurationError, match=says):
        mapped(drive(plain_profile(**{direction: pdos})))


def test_settings_refuse_a_ninth_entry_and_a_fifth_pdo():
    raw = msgspec.to_builtins(plain_profile())
    for layout in ({"5": ["statusword"]}, {"1": []}, {"1": ["speed"]}):
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(raw | {"tpdo": layout}, CanopenProfile)


def test_a_profile_reports_current_or_torque():
    raw = msgspec.to_builtins(plain_profile())
    torque = raw["current"] | {"object": 0x6077}
    for both in ({"torque": torque}, {"current": None}):
        with pytest.raises(msgspec.ValidationError, match="either `current` or `torque`"):
            msgspec.convert(raw | both, CanopenProfile)
    layout = {"1": ["statusword", "torque", "motor_velocity"], "2": ["link_position"]}
    by_torque = plain_profile(current=None, torque=quantity(0x6077, "INTEGER16", 0.001, sign=-1),
                              tpdo=layout)  # fmt: skip
    assert transmit_pdos(drive(by_torque))[0].fields[1].index == 0x6077
    for layout, says in (
        (plain_profile().tpdo, "the PDO lists `current`, but"),
        ({"1": ["statusword", "motor_velocity"], "2": ["link_position"]}, "torque missing"),
    ):
        with pytest.raises(ConfigurationError, match=says):
            transmit_pdos(drive(msgspec.structs.replace(by_torque, tpdo=layout)))
    # Beside a drive that reports its current, half of the rated torque is half the rated current.
    by_current = drive(plain_profile(), "b", node=2, rated_current_A=3.0)
    frames = {0x181 + k: struct.pack("<Hhi", 0x27, 500 + k, 0) for k in range(2)}
    decoder = decoded([drive(by_torque, "a"), by_current], frames)
    np.testing.assert_allclose(decoder.current, [-1.0, 1.503])
