"""A drive's EDS as makers write it, and what is none."""

from pathlib import Path

import pytest

from common.errors import ConfigurationError
from drivers.canopen.boot.data_sheet import find_object, load_data_sheet

EDS = Path(__file__).parents[4] / "configs" / "romeo_left_arm" / "drive.eds"


@pytest.mark.parametrize(
    ("before", "code"), [(b"", "latin-1"), (b"", "utf-8"), (b"\xef\xbb\xbf", "utf-8")]
)
def test_names_in_any_code_page(tmp_path, before, code):
    text = EDS.read_text().replace("ParameterName=Statusword", "ParameterName=Zustand (°C, µm)")
    assert "°C" in text
    (tmp_path / "drive.eds").write_bytes(before + text.replace("\n", "\r\n").encode(code))
    sheet = load_data_sheet(tmp_path / "drive.eds")
    assert sheet[0x6041].name.startswith("Zustand (")
    assert sheet.keys() == load_data_sheet(EDS).keys()


@pytest.mark.parametrize(
    ("index", "subindex", "there"),
    [
        (0x6041, 0, True),
        (0x6041, 1, False),  # a variable has no members
        (0x60E4, 1, True),
        (0x60E4, 2, False),
        (0x1016, 1, True),
        (0x1016, 2, False),  # of an array whose EDS says that it has one
        (0x2000, 0, False),
    ],
)
def test_objects_that_are_there(index, subindex, there):
    found = find_object(load_data_sheet(EDS), index, subindex)
    assert (found is not None) is there


@pytest.mark.parametrize(
    "text", ["nonsense", "[1000]\nParameterName=x\nDataType=abc\n", "[DeviceInfo]\nVendorName=x\n"]
)
def test_a_damaged_data_sheet(tmp_path, text):
    path = tmp_path / "drive.eds"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r"drive\.eds: not an? (readable )?EDS"):
        load_data_sheet(path)


def test_no_data_sheet(tmp_path):
    with pytest.raises(ConfigurationError, match=r"none\.eds"):
        load_data_sheet(tmp_path / "none.eds")
