"""Values of CiA 301 and CiA 402 that a simulated drive has where its EDS gives none."""

import re
from pathlib import Path

import pytest

from common.eds import eds_of
from simulator.objects import Objects, key
from simulator.supplied import in_words, supplied

EDS = (Path(__file__).parents[2] / "configs" / "romeo_left_arm" / "drive.eds").read_text()


def without_default(*sections: str) -> str:
    text = EDS
    for section in sections:
        text, count = re.subn(rf"(?s)(\[{section}\].*?)DefaultValue=[^\n]*\n", r"\1", text, count=1)
        assert count
    return text


@pytest.mark.parametrize(
    ("section", "where", "value"),
    [
        ("1000", key(0x1000), 0x00020192), ("1018sub1", key(0x1018, 1), 0x00C0DAC7),
        ("1018sub2", key(0x1018, 2), 0x402), ("1005", key(0x1005), 0x80),
        ("1014", key(0x1014), 0x80 + 3), ("6502", key(0x6502), 0x100),
        ("1400sub1", key(0x1400, 1), 0x200 + 3), ("1801sub1", key(0x1801, 1), 0x280 + 3),
        ("1801sub2", key(0x1801, 2), 255), ("1A00sub0", key(0x1A00), 0),
        ("1A00sub1", key(0x1A00), 0),
    ],
)  # fmt: skip
def test_a_value_that_the_eds_leaves_out(section, where, value, tmp_path):
    (tmp_path / "drive.eds").write_text(without_default(section))
    assert Objects(tmp_path / "drive.eds", 3).values[where] == value


def test_a_complete_eds_is_left_alone():
    assert supplied(eds_of(EDS)) == {}


def test_what_was_supplied_is_said_in_words():
    assert in_words(eds_of(without_default("1000", "6502", "1A00sub0"))) == [
        "0x1000:00 (Device type) = 0x20192",
        "0x6502:00 (Supported drive modes) = 0x100",
    ]


def test_a_drive_without_an_error_register_or_a_name_has_one(tmp_path):
    text = re.sub(r"(?s)\[1001\].*?\n\n", "", EDS)
    text += "\n[1008]\nParameterName=Device name\nDataType=9\nAccessType=const\n"
    (tmp_path / "drive.eds").write_text(text)
    objects = Objects(tmp_path / "drive.eds", 3)
    assert objects.read(0x1001, 0) == b"\0"
    assert objects.read(0x1008, 0)


def test_a_limit_of_the_time_alone_does_not_keep_the_master_out(tmp_path):
    text = re.sub(r"(\[1016sub1\])", r"\1\nHighLimit=65535", EDS)
    (tmp_path / "drive.eds").write_text(text)
    objects = Objects(tmp_path / "drive.eds", 3)
    objects.write(0x1016, 1, (127 << 16 | 100).to_bytes(4, "little"))
