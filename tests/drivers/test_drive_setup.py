"""What the configuration counts on, checked against the EDS."""

from dataclasses import replace

import msgspec
import pytest

from drivers.drive_setup import check_drive, load_data_sheet, objects_to_write
from drivers.settings import DriveProfile
from errors import ConfigurationError


def changed(setup, **fields):
    """The setup with other fields in its profile; a dict changes fields of a quantity."""
    raw = msgspec.to_builtins(setup.profile)
    for name, value in fields.items():
        raw[name] = raw[name] | value if isinstance(value, dict) else value
    return replace(setup, profile=msgspec.convert(raw, DriveProfile))


def test_romeo_fits(setups):
    for setup in setups:
        check_drive(setup, 10, 127)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"current": {"object": 0x6079}}, "current, object 0x6079:00, is missing"),
        ({"current": {"type": "INTEGER32"}, "tpdo": {"1": ["statusword", "motor_velocity"],
          "2": ["link_position", "current"]}}, "current.* is INTEGER16, not INTEGER32"),
        ({"link_position": {"subindex": 2}}, "0x60E4:02, is missing"),
        ({"target_velocity": {"object": 0x6007, "type": "INTEGER16"}}, "cannot be mapped"),
        ({"write": [{"object": 0x2000, "value": 1}]}, "0x2000:00 is missing, and 1 cannot"),
        ({"write": [{"object": 0x6075, "value": 1}]}, r"cannot be written \(access ro\)"),
        ({"write": [{"object": 0x1017, "value": 65536}]}, r"65536 is outside 0 \.\.\. 65535"),
        ({"quick_stop_deceleration": {"scale": 1e-9}}, "0x6085:00: .* is outside 1"),
    ],
)  # fmt: skip
def test_what_the_drive_has_not_is_refused(setups, fields, says):
    with pytest.raises(ConfigurationError, match=rf"node 3 \(LElbowRoll\), drive.eds: .*{says}"):
        check_drive(changed(setups[2], **fields), 10, 127)


def test_a_period_that_the_drive_cannot_interpolate_over(setups):
    with pytest.raises(ConfigurationError, match=r"0x60C2:01: 300 is outside 1 \.\.\. 255"):
        check_drive(setups[0], 300, 127)


def test_the_safety_of_what_is_written(setups):
    wanted = {(o.object, o.subindex): o.value for o in objects_to_write(setups[0], 10, 126)}
    assert wanted[0x6007, 0] == 3, "a drive whose master is silent stops"
    assert wanted[0x605A, 0] == 6, "and holds"
    assert wanted[0x1029, 1] == 1, "and goes on telling"
    assert wanted[0x1016, 1] == 126 << 16 | 100
    assert wanted[0x6073, 0] == 2000
    assert wanted[0x6085, 0] == round(10 * 150 / 0.010471975511965977)


@pytest.mark.parametrize(
    "text",
    ["nonsense", "[1000]\nParameterName=x\nDataType=abc\n", "[DeviceInfo]\nVendorName=x\n"],
)
def test_a_damaged_data_sheet(tmp_path, text):
    path = tmp_path / "drive.eds"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r"drive\.eds: not an? (readable )?EDS"):
        load_data_sheet(path)


def test_no_data_sheet(tmp_path):
    with pytest.raises(ConfigurationError, match=r"none\.eds"):
        load_data_sheet(tmp_path / "none.eds")
