"""Likely mistakes about a drive, found by its EDS."""

from pathlib import Path

import msgspec
import pytest

from bench.rigs.generated_arms import EDS, PROFILE, generate
from bench.rigs.makers import makers
from daemon.config.drive_mistakes import drive_mistakes
from daemon.config.load import load_robot
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.settings import Quantity

ALDER, LINK = generate(0), ("link_position", "scale")  # 131072 counts on 0x60E4:01


def said(folder: Path, times: float, sheet) -> list[tuple[str, ...]]:
    """Fields of the warnings with another scale of the link's encoder."""
    c = load_robot(folder).configuration
    profile = c.drives[PROFILE]
    scale = times * profile.link_position.scale
    link = msgspec.structs.replace(profile.link_position, scale=scale)
    changed = msgspec.structs.replace(profile, link_position=link)
    c = msgspec.structs.replace(c, drives={PROFILE: changed})
    return [tuple(map(str, problem.keys[2:])) for problem in drive_mistakes(c, PROFILE, sheet)]


@pytest.mark.parametrize(("times", "wrong"), [(1.0, False), (16.0, True), (1 / 16, True)])
@pytest.mark.parametrize("low", [0, -65536])
def test_a_range_in_the_eds_is_one_turn_of_the_link(tmp_path, times, wrong, low) -> None:
    sheet = load_data_sheet(ALDER.write(tmp_path / "arm") / EDS)
    assert said(tmp_path / "arm", times, sheet) == []
    variable = sheet[0x60E4][1]
    variable.min, variable.max = low, low + 131071
    assert (LINK in said(tmp_path / "arm", times, sheet)) == wrong


@pytest.mark.parametrize(
    ("maker", "where", "says"),
    [
        ("maxon_epos4", (0x30D1, 2), ""),
        ("maxon_epos4", (0x30D1, 1), "averaged"),
        ("maxon_epos4", (0x30D0, 0), "demand"),
        ("maxon_epos4", (0x30B2, 0), "can be written"),
        ("elmo_gold", (0x6078, 0), ""),
        ("elmo_gold", (0x6075, 0), "the rated current"),
        ("elmo_gold", (0x6073, 0), "the largest current"),
        ("technosoft_ipos", (0x2052, 0), "nominal"),
        ("technosoft_ipos", (0x207F, 0), "can be written"),
        ("technosoft_ipos", (0x6041, 0), "cannot be negative"),
    ],
)
def test_a_current_that_is_none(tmp_path, maker, where, says) -> None:
    (tmp_path / "drive.eds").write_text(makers()[maker].eds())
    sheet = load_data_sheet(tmp_path / "drive.eds")
    c = load_robot(ALDER.write(tmp_path / "arm")).configuration
    current = Quantity(object=where[0], subindex=where[1], type="INTEGER16", scale=0.001)
    profile = msgspec.structs.replace(c.drives[PROFILE], current=current)
    c = msgspec.structs.replace(c, drives={PROFILE: profile})
    found = [p for p in drive_mistakes(c, PROFILE, sheet) if p.keys[2:] == ["current", "object"]]
    assert bool(found) == bool(says)
    assert all(says in problem.what for problem in found[:1])
