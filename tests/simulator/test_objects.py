"""SDO over frames: transfers, abort codes, limits, and the defaults of the EDS."""

import struct
from pathlib import Path
from typing import Any

import canopen
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import ConfigurationError
from simulator.description import ArmDescription
from simulator.objects import Objects, key
from tests.examples import scaled

NODE = 3


@pytest.mark.parametrize(
    ("index", "sub", "code", "value", "abort"),
    [
        (0x2000, 0, "H", 0, 0x06020000), (0x607A, 0, "i", 0, 0x06020000),
        (0x1018, 9, "I", 0, 0x06090011), (0x6041, 0, "H", 0, 0x06010002),
        (0x1000, 0, "I", 0, 0x06010002), (0x6075, 0, "I", 5000, 0x06010002), (0x6007, 0, "H", 0, 0),
        (0x6007, 0, "I", 0, 0x06070010), (0x6040, 0, "B", 0, 0x06070010),
        (0x6007, 0, "h", 4, 0x06090031), (0x6007, 0, "h", -1, 0x06090032),
        (0x605A, 0, "h", 5, 0x06090030), (0x6060, 0, "b", 8, 0x06090030),
        (0x6060, 0, "b", 10, 0x06090031), (0x60C2, 2, "b", 1, 0x06090031),
        (0x6073, 0, "H", 2001, 0x06090031), (0x6085, 0, "I", 0, 0x06090032),
        (0x1003, 0, "B", 1, 0x06090030), (0x1005, 0, "I", 0x40000080, 0x06090030),
        (0x1016, 1, "I", 100, 0x06090030), (0x1016, 1, "I", 127 << 16 | 100, 0),
        (0x1017, 0, "H", 50, 0), (0x60FF, 0, "i", -1000, 0),
    ],
)  # fmt: skip
def test_download(one: Any, index: int, sub: int, code: str, value: int, abort: int) -> None:
    one.read(NODE, 0x6041, 0, "H")  # brings the statusword up to date
    before = dict(one.arm.drives[NODE - 1].objects.values)
    assert one.write(NODE, index, sub, code, value) == abort
    if abort:
        assert one.arm.drives[NODE - 1].objects.values == before
    else:
        assert one.read(NODE, index, sub, code) == value


def test_upload_says_what_the_drive_is(one: Any) -> None:
    assert one.read(NODE, 0x1000, 0, "I") == 0x00020192
    assert one.read(NODE, 0x1018, 1, "I") == 0x00C0DAC7
    assert [one.read(n, 0x1018, 4, "I") for n in (1, 2, 7)] == [1, 2, 7]
    assert [one.read(n, 0x6075, 0, "I") for n in (1, 7)] == [2000, 300]
    assert one.read(NODE, 0x6007, 0, "h") == 0
    assert one.read(NODE, 0x1802, 1, "I") == 0x40000380 + NODE


def test_segmented_upload(one: Any) -> None:
    ((_, answer),) = one.send(0x600 + NODE, struct.pack("<BHBI", 0x40, 0x1008, 0, 0))
    assert answer[0] == 0x41
    (length,) = struct.unpack_from("<I", answer, 4)
    text, toggle, last = b"", 0x00, False
    while not last:
        ((_, answer),) = one.send(0x600 + NODE, bytes([0x60 | toggle, *[0] * 7]))
        assert answer[0] & 0x10 == toggle
        text += answer[1 : 8 - (answer[0] >> 1 & 7)]
        toggle, last = toggle ^ 0x10, bool(answer[0] & 1)
    assert text == b"contactd simulated two-encoder servo drive"
    assert len(text) == length


def test_segmented_download(one: Any) -> None:
    ((_, answer),) = one.send(0x600 + NODE, struct.pack("<BHBI", 0x21, 0x60FF, 0, 4))
    assert answer[0] == 0x60
    segment = bytes([0x00 | 3 << 1 | 1]) + struct.pack("<i", -777) + b"\0\0\0"
    ((_, answer),) = one.send(0x600 + NODE, segment)
    assert answer[0] == 0x20
    assert one.read(NODE, 0x60FF, 0, "i") == -777


def test_wrong_toggle_aborts(one: Any) -> None:
    one.send(0x600 + NODE, struct.pack("<BHBI", 0x40, 0x1008, 0, 0))
    ((_, answer),) = one.send(0x600 + NODE, bytes([0x70, *[0] * 7]))
    assert answer[0] == 0x80
    assert struct.unpack_from("<I", answer, 4) == (0x05030000,)


@given(requests=st.lists(st.binary(min_size=0, max_size=8), max_size=4))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=scaled(200))
def test_no_request_upsets_the_server(one: Any, requests: list[bytes]) -> None:
    for data in requests:
        answers = one.send(0x600 + NODE, data)
        assert all(cob == 0x580 + NODE and len(answer) == 8 for cob, answer in answers)
    assert one.read(NODE, 0x1000, 0, "I") == 0x00020192


def test_canopen_reads_the_same_eds(romeo: ArmDescription) -> None:
    ours, theirs = Objects(romeo.eds, NODE), canopen.import_od(str(romeo.eds), NODE)
    for index, sub in ((0x1400, 1), (0x1800, 1), (0x1014, 0), (0x6085, 0)):
        thing = theirs[index] if sub == 0 else theirs[index][sub]
        assert ours.values[key(index, sub)] == thing.default


def test_garbage_is_a_configuration_error(tmp_path: Path) -> None:
    path = tmp_path / "garbage.eds"
    path.write_text("not an EDS\n[1000\n")
    with pytest.raises(ConfigurationError, match=r"garbage\.eds"):
        Objects(path, 1)


def test_missing_eds_is_a_configuration_error(romeo: ArmDescription) -> None:
    with pytest.raises(ConfigurationError, match=r"none\.eds"):
        Objects(romeo.eds.with_name("none.eds"), 1)
