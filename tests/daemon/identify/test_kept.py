"""Recordings left by a stopped step of `contactd identify`: continued, or refused before anything
moves."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bench.rigs.person import Arm
from bench.rigs.served_daemon import ServedDaemon
from bench.rigs.typed_session import Typed, identify, stopped, wired_joint
from daemon.clients.client import Client
from daemon.clients.recorder import record
from daemon.config import identified as file

THRESHOLDS = ("thresholds", "--seconds", "40")
FRICTION = ("friction", "--seconds", "20")
OF_OTHERS = "has residuals of other values of the joints than are in force now"
OF_OTHER_WIRING = "was recorded with other drives, another wiring or another period"


@pytest.fixture
def arm(tmp_path: Path) -> Arm:
    return wired_joint(tmp_path)


@contextmanager
def holding(arm: Arm) -> Iterator[ServedDaemon]:
    """The daemon started (again), and the arm enabled."""
    with arm.house() as house:
        house.rig.enable()
        yield house


def kept(arm: Arm) -> list[Path]:
    return sorted((arm.folder / "identify").glob("*.part*.mcap"))


def refused(house: ServedDaemon, *words: str) -> str:
    """What is said instead of moving."""
    typed = Typed(house, *words)
    status, said = typed.ends()
    assert (status, typed.ticks_in_motion) == (65, 0), said
    assert "going on with" not in said
    return said


def moves(house: ServedDaemon, *words: str) -> str:
    """What is said by a step that is stopped after a second of motion."""
    said = stopped(house, *words, after_s=1.0)[1]
    assert "stopped by you" in said
    return said


def find_a_wider_gap(arm: Arm) -> None:
    gap = file.Gap(date="2026-01-02T03:04:05+00:00", log="0", half_gap=0.025, confidence=0.0)
    identify(arm.folder, "gap", gap)


def test_residuals_of_other_values_are_in_the_way_until_they_are_deleted(arm: Arm) -> None:
    with holding(arm) as house:
        moves(house, *THRESHOLDS)
        moves(house, *THRESHOLDS)
    find_a_wider_gap(arm)
    first, second = kept(arm)
    with holding(arm) as house:
        said = refused(house, *THRESHOLDS)
        assert f"{first.name} {OF_OTHERS}; " in said
        assert f"{second.name} {OF_OTHERS}: delete them and run this again" in said
        first.unlink()
        said = refused(house, *THRESHOLDS)
        assert f"{second.name} {OF_OTHERS}: delete it and run this again" in said
        assert first.name not in said
        second.unlink()
        moves(house, *THRESHOLDS)
        assert "s of 40 s are measured already" in moves(house, *THRESHOLDS)


def test_friction_goes_on_with_samples_whose_residuals_are_of_other_values(arm: Arm) -> None:
    with holding(arm) as house:
        moves(house, *FRICTION)
    find_a_wider_gap(arm)
    with holding(arm) as house:
        assert "going on with" in moves(house, *FRICTION)


@pytest.mark.parametrize("words", [("gap",), FRICTION, THRESHOLDS])
def test_samples_of_another_wiring_are_in_the_way_of_every_step(
    arm: Arm, words: tuple[str, ...]
) -> None:
    with holding(arm) as house:
        moves(house, *words)
    path = arm.folder / "config.yaml"
    path.write_text(path.read_text().replace("gear: 100", "gear: 110"))
    with holding(arm) as house:
        said = refused(house, *words)
    (part,) = kept(arm)
    assert f"{part.name} {OF_OTHER_WIRING}" in said
    assert said.endswith("than the configuration has now: delete it and run this again")
    assert "stands still" not in said  # nobody is asked to move a link first


def test_a_recording_without_samples_is_in_the_way_by_its_name(arm: Arm) -> None:
    first, second = (arm.folder / "identify" / f"friction.part0{i}.mcap" for i in (1, 2))
    first.parent.mkdir()
    first.touch()
    with holding(arm) as house:
        house.until(lambda: record(lambda: Client(house.path), second, stop=lambda: True))
        said = refused(house, *FRICTION)
    assert f"{first.name} is not an MCAP file; " in said
    assert f"{second.name}: there are no samples in it: delete them and run this again" in said
