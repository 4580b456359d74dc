"""Makes of drives that an EDS is simulated as, and EDS files that are refused."""

import re
from pathlib import Path

import pytest

from common.errors import ConfigurationError
from simulator.objects import Objects
from simulator.profile import LOCKING, PROFILE, profile_of

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(("robot", "profile"), [("romeo_left_arm", PROFILE), ("desk_arm", LOCKING)])
def test_the_product_code_shows(robot, profile):
    assert profile_of(CONFIGS / robot / "drive.eds") is profile


def edited(folder: Path, pattern: str, new: str) -> Path:
    text = (CONFIGS / "romeo_left_arm" / "drive.eds").read_text()
    text, changes = re.subn(pattern, new, text, flags=re.DOTALL)
    assert changes
    # Makers write their names in a code page of their own.
    (folder / "drive.eds").write_bytes(text.encode() + b"; \xb0C")
    return folder / "drive.eds"


def test_an_unknown_product_is_refused_and_not_simulated_as_another(tmp_path):
    with pytest.raises(ConfigurationError, match="product 0x999 is of no built-in make"):
        profile_of(edited(tmp_path, "0x00000402", "0x00000999"))


@pytest.mark.parametrize(
    ("pattern", "new", "missing"),
    [(r"\[6085\].*?\n\n", "", "0x6085:00"), (r"\[60E4sub1\].*?\n\n", "", "0x60E4:01")],
)
def test_what_cannot_be_simulated_is_named(tmp_path, pattern, new, missing):
    with pytest.raises(
        ConfigurationError, match=f"drive.eds: this drive cannot be simulated: object {missing}"
    ):
        profile_of(edited(tmp_path, pattern, new))


def test_a_default_mapping_of_what_is_not_there_begins_empty(tmp_path):
    pattern = r"(\[1A00sub1\][^[]*?DefaultValue=)\w+"
    path = edited(tmp_path, pattern, r"\g<1>0x20010010")
    assert profile_of(path) is PROFILE
    assert Objects(path, 1).number(0x1A00) == 0
