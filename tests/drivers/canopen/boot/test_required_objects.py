"""Objects that the configuration counts on, checked against the EDS."""

import copy
import math
from dataclasses import replace

import msgspec
import pytest

from common.errors import ConfigurationError
from drivers.canopen.boot.required_objects import check_drive, lacks, required_values
from drivers.canopen.settings import CanopenProfile


def changed(setup, **fields):
    """The setup with other fields in its profile; a dict changes fields of a quantity."""
    raw = msgspec.to_builtins(setup.drive.profile)
    for name, value in fields.items():
        raw[name] = raw[name] | value if isinstance(value, dict) else value
    profile = msgspec.convert(raw, CanopenProfile)
    return replace(setup, drive=replace(setup.drive, profile=profile))


@pytest.mark.parametrize(
    ("timeout_ms", "allowed"), [(19, False), (20, True), (5000, True), (5001, False)]
)
def test_the_range_of_the_sdo_timeout(setups, timeout_ms, allowed):
    if allowed:
        assert (
            changed(setups[0], sdo_timeout_ms=timeout_ms).drive.profile.sdo_timeout_ms == timeout_ms
        )
    else:
        with pytest.raises(msgspec.ValidationError, match="sdo_timeout_ms"):
            changed(setups[0], sdo_timeout_ms=timeout_ms)


def test_romeo_fits(setups):
    for setup in setups:
        check_drive(setup, 10, 127)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"current": {"object": 0x6079}}, "current, object 0x6079:00, is missing"),
        ({"current": {"type": "INTEGER32"}, "tpdo": {"1": ["statusword", "motor_velocity"],
          "2": ["link_position", "current"]}}, "current.* is INTEGER16, not INTEGER32"),
        (
            {"current": {"object": 6078}},
            "0x17BE:00, is missing; 0x6078 exists: 6078 without 0x is decimal",
        ),
        (
            {"write": [{"object": 6085, "value": 1}]},
            "0x17C5:00 .* is missing, and 1 .*; 0x6085 exists: 6085 without 0x",
        ),
        ({"link_position": {"subindex": 2}}, "0x60E4:02, is missing"),
        ({"motor_velocity": {"subindex": 1}}, "0x606C:01, is missing"),
        ({"target_velocity": {"object": 0x6007, "type": "INTEGER16"}}, "cannot be mapped"),
        ({"write": [{"object": 0x2000, "value": 1}]}, "0x2000:00 .* is missing, and 1 cannot"),
        ({"write": [{"object": 0x6075, "value": 1}]}, r"cannot be written \(access ro\)"),
        ({"write": [{"object": 0x1017, "value": 65536}]}, r"65536 is outside 0 \.\.\. 65535"),
        ({"quick_stop_deceleration": {"type": "INTEGER32"}}, "is UNSIGNED32, not INTEGER32"),
        ({"max_motor_speed": {"object": 0x607F}}, r"0x607F:00 \(speed limit\) is missing"),
        ({"max_motor_speed": {"scale": 1e-5}}, "0x6080:00 .*: .* is outside 1"),
        ({"quick_stop_deceleration": {"scale": 1e-9}}, "0x6085:00 .*: .* is outside 1"),
    ],
)  # fmt: skip
def test_what_the_drive_has_not_is_refused(setups, fields, says):
    with pytest.raises(ConfigurationError, match=rf"node 3 \(LElbowRoll\), drive.eds: .*{says}"):
        check_drive(changed(setups[2], **fields), 10, 127)


@pytest.mark.parametrize(
    ("index", "subindex", "value", "says"),
    [
        (0x6007, 0, 0, r"cannot be 0: contactd writes 3 \(quick stop when the master falls"),
        (0x605A, 0, 2, r"cannot be 2: contactd writes 6 \(quick stop: ramp, then hold\)"),
        (0x6085, 0, 1, r"cannot be 1: contactd writes \d+ \(deceleration of the quick stop"),
        (0x1016, 1, 0, "cannot be 0: contactd writes 8323172 .*heartbeat"),
        (0x6060, 0, 8, "cannot be 8: contactd writes 9"),
        (0x1400, 1, 0x203, "belongs to a PDO"),
        (0x1A03, 1, 0, "belongs to a PDO"),
        (0x6040, 0, 15, "would energise or move the drive"),
        (0x60FF, 0, 100, "would energise or move the drive"),
    ],
)
def test_what_the_configuration_may_not_write(setups, index, subindex, value, says):
    own = {"object": index, "subindex": subindex, "value": value}
    place = rf"object 0x{index:04X}:{subindex:02X} \(from the configuration\)"
    with pytest.raises(ConfigurationError, match=f"{place} {says}"):
        check_drive(changed(setups[2], write=[own]), 10, 127)


def test_the_drives_own_limits_may_be_written(setups):
    limits = [{"object": 0x6080, "value": 3000}, {"object": 0x6073, "value": 1500}]
    check_drive(changed(setups[2], write=limits), 10, 127)


def test_a_quick_stop_without_deceleration_is_none(setups):
    sheet = copy.deepcopy(setups[2].data_sheet)
    sheet[0x6085].min = None
    coarse = changed(setups[2], quick_stop_deceleration={"scale": 1e5})
    with pytest.raises(ConfigurationError, match=r"0x6085:00 .*: 0 is outside 1 \.\.\."):
        check_drive(replace(coarse, data_sheet=sheet), 10, 127)


def test_a_fixed_mapping_that_is_another(setups):
    sheet = copy.deepcopy(setups[2].data_sheet)
    sheet[0x1600][2].access_type, sheet[0x1600][2].default = "const", 0x60FF0020
    check_drive(replace(setups[2], data_sheet=sheet), 10, 127)
    sheet[0x1600][2].default = 0x60810020
    with pytest.raises(
        ConfigurationError,
        match=r"object 0x1600:02 cannot be written, and maps 0x60810020 where target_velocity "
        r"\(0x60FF0020\) is configured",
    ):
        check_drive(replace(setups[2], data_sheet=sheet), 10, 127)


def less(setup, *objects):
    """The setup with an EDS that does not have these objects."""
    sheet = copy.deepcopy(setup.data_sheet)
    for index in objects:
        del sheet[index]
    return replace(setup, data_sheet=sheet)


OPTIONAL = (0x1005, 0x1014, 0x1029, 0x605E, 0x6061, 0x6072, 0x6073, 0x6075, 0x60C2, 0x6502)


def test_what_a_drive_may_lack(setups):
    poor = less(setups[2], *OPTIONAL, 0x1403)
    check_drive(poor, 10, 127)
    lines = lacks(poor, 10, 127)
    assert [int(line.split("0x")[1][:4], 16) for line in lines] == [
        0x1005, 0x1014, 0x1029, 0x605E, 0x60C2, 0x6072, 0x6073, 0x6061, 0x6502, 0x6075,
    ]  # fmt: skip
    assert lines[2] == (
        "without object 0x1029:01 (no setpoints without a master): its handling of setpoints "
        "after the loss of its master is the factory default"
    )
    assert lacks(setups[2], 10, 127) == []


@pytest.mark.parametrize("index", [0x1016, 0x1017, 0x1018, 0x6007, 0x605A, 0x6060, 0x6085])
def test_what_a_drive_must_have(setups, index):
    with pytest.raises(ConfigurationError, match=f"0x{index:04X}:.* is missing"):
        check_drive(less(setups[2], index), 10, 127)


def test_a_pdo_that_is_not_there_or_takes_fewer_objects(setups):
    spread = changed(setups[2], rpdo={"1": ["controlword"], "4": ["target_velocity"]})
    check_drive(spread, 10, 127)
    with pytest.raises(ConfigurationError, match="no PDO parameters at 0x1403"):
        check_drive(less(spread, 0x1403), 10, 127)
    poor = less(setups[2])
    poor.data_sheet[0x1A00].subindices.pop(3)
    del poor.data_sheet[0x1A00][0]
    with pytest.raises(ConfigurationError, match="the PDO at 0x1800 cannot map 3 objects"):
        check_drive(poor, 10, 127)


def test_a_period_that_the_drive_cannot_interpolate_over(setups):
    with pytest.raises(ConfigurationError, match=r"0x60C2:01 .*: 300 is outside 1 \.\.\. 255"):
        check_drive(setups[0], 300, 127)


def test_the_safety_of_what_is_written(setups):
    held = {(row.index, row.subindex): row.value for row in required_values(setups[0], 10, 126)}
    assert held[0x6007, 0] == 3, "a drive whose master is silent stops"
    assert held[0x605A, 0] == 6, "and holds"
    assert held[0x1029, 1] == 0, "and takes no setpoint any more"
    assert held[0x1016, 1] == 126 << 16 | 100
    assert held[0x6072, 0] == held[0x6073, 0] == 2000
    # 1 rad/s at the link and a tenth, behind a gear of 150, in rpm.
    assert held[0x6080, 0] == math.ceil(1.1 * 150 * 60 / (2 * math.pi))
    assert held[0x6085, 0] == round(10 * 150 / 0.010471975511965977)
