"""Planted mistakes: `contactd check` says each at the field that is wrong, and nothing where there
is none."""

from pathlib import Path
from typing import Any

import pytest

from bench.rigs.generated_arms import generate
from bench.rigs.generated_makes import MAKES
from bench.study.mistakes import MISTAKES, PROFILE, Mistake, checkable, reported
from drivers.canopen.boot.data_sheet import load_data_sheet

CHECKABLE = list(checkable())
# What the files of this arm cannot show: its gear of 36 may have a digit more, and counts of a
# motor's turn are a power of two as those of the link's are.
UNSEEN = {"a gear with a digit too many", "counts per motor turn for the link's encoder"}


def test_there_are_sixty_that_the_files_may_show() -> None:
    assert len(CHECKABLE) == 60
    assert len({mistake.words for mistake in MISTAKES}) == len(MISTAKES)


@pytest.mark.parametrize("mistake", CHECKABLE, ids=lambda mistake: mistake.words)
def test_a_mistake_is_reported_at_its_field(mistake, tmp_path: Path) -> None:
    said = reported(mistake.plant(generate(0), tmp_path / "arm"))
    assert said.of(mistake.field) is (mistake.words not in UNSEEN), "\n".join(said.lines)


@pytest.mark.parametrize("mistake", [m for m in MISTAKES if m.only_wiring], ids=lambda m: m.words)
def test_what_only_the_wiring_shows_is_not_reported(mistake, tmp_path: Path) -> None:
    """Else it would belong to the others."""
    assert reported(mistake.plant(generate(0), tmp_path / "arm")).lines == []


@pytest.mark.parametrize("seed", range(20))
def test_an_arm_without_mistakes_is_not_warned_of(seed: int, tmp_path: Path) -> None:
    said = reported(generate(seed).write(tmp_path / "arm"))
    assert (said.refused, said.lines) == (False, [])


@pytest.mark.parametrize("make", MAKES, ids=lambda make: make.name)
def test_the_eds_of_a_make_says_what_its_data_sheet_says(make, tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    path.write_text(make.eds())
    sheet = load_data_sheet(path)
    assert sheet.device_information.product_number == make.product
    for quantity in make.quantities.values():
        variable = sheet.get_variable(quantity.index, quantity.subindex)
        assert variable is not None
        assert variable.name
    assert {index for index in sheet if 0x1800 <= index < 0x1A00} == {
        0x1800 + int(number) - 1 for number in make.tpdo
    }


def _timeout(data: dict[str, Any]) -> None:
    data["drives"][PROFILE]["master_timeout_ms"] = 5000


def _a_little_beyond(data: dict[str, Any]) -> None:
    data["joints"][1]["limits"]["lower"] = -1.3


def test_a_drive_that_would_move_on_without_its_master_is_reported(tmp_path: Path) -> None:
    said = reported(Mistake("", edit=_timeout).plant(generate(0), tmp_path / "arm"))
    assert not said.refused
    assert said.of("drives.master_timeout_ms"), said.lines
    assert len(said.lines) == 1


def test_limits_a_little_beyond_are_not_taken_for_degrees(tmp_path: Path) -> None:
    said = reported(Mistake("", edit=_a_little_beyond).plant(generate(0), tmp_path / "arm"))
    assert said.refused
    assert "goes beyond the URDF's [-1.28, 1.81]" in said.lines[0]
    assert "degrees" not in said.lines[0]
