"""Recordings left by a stopped step of `contactd identify`: continued, or refused before anything
moves."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bench.rigs.served_daemon import ServedDaemon
from daemon.config import identified as file
from programs.clients.client import Client
from programs.clients.recorder import record
from tests.programs.identify.commissioned_arm import CommissionedArm
from tests.programs.identify.typed_session import TypedCommand, identify, stopped, wired_joint

THRESHOLDS = ("thresholds", "--seconds", "40")
FRICTION = ("friction", "--seconds", "20")
OF_OTHERS = "has residuals computed with other values of the joints than those in force"
OF_OTHER_WIRING = "was recorded with other drives, another wiring or another period"


@pytest.fixture
def arm(tmp_path: Path) -> CommissionedArm:
    return wired_joint(tmp_path)


@contextmanager
def holding(arm: CommissionedArm) -> Iterator[ServedDaemon]:
    """The daemon started (again), and the arm enabled."""
    with arm.served() as served:
        served.rig.enable()
        yield served


def kept(arm: CommissionedArm) -> list[Path]:
    return sorted((arm.folder / "identify").glob("*.part*.mcap"))


def refused(served: ServedDaemon, *words: str) -> str:
    """Output instead of a motion."""
    typed = TypedCommand(served, *words)
    status, said = typed.ends()
    assert (status, typed.ticks_in_motion) == (65, 0), said
    assert "continuing earlier measurements" not in said
    return said


def moves(served: ServedDaemon, *words: str) -> str:
    """Output of a step that is stopped after a second of motion."""
    said = stopped(served, *words, after_s=1.0)[1]
    assert "stopped by you" in said
    return said


def find_a_wider_gap(arm: CommissionedArm) -> None:
    gap = file.GapEntry(date="2026-01-02T03:04:05+00:00", log="0", half_gap=0.025, confidence=0.0)
    identify(arm.folder, "gap", gap)


def test_residuals_of_other_values_are_in_the_way_until_they_are_deleted(
    arm: CommissionedArm,
) -> None:
    with holding(arm) as served:
        moves(served, *THRESHOLDS)
        moves(served, *THRESHOLDS)
    find_a_wider_gap(arm)
    first, second = kept(arm)
    with holding(arm) as served:
        said = refused(served, *THRESHOLDS)
        assert f"{first.name} {OF_OTHERS}; " in said
        assert f"{second.name} {OF_OTHERS}: delete them and run this again" in said
        first.unlink()
        said = refused(served, *THRESHOLDS)
        assert f"{second.name} {OF_OTHERS}: delete it and run this again" in said
        assert first.name not in said
        second.unlink()
        moves(served, *THRESHOLDS)
        assert "s of 40 s were measured before" in moves(served, *THRESHOLDS)


def test_friction_goes_on_with_samples_whose_residuals_are_of_other_values(
    arm: CommissionedArm,
) -> None:
    with holding(arm) as served:
        moves(served, *FRICTION)
    find_a_wider_gap(arm)
    with holding(arm) as served:
        assert "continuing earlier measurements" in moves(served, *FRICTION)


@pytest.mark.parametrize("words", [("gap", "--by-hand"), FRICTION, THRESHOLDS])
def test_samples_of_another_wiring_are_in_the_way_of_every_step(
    arm: CommissionedArm, words: tuple[str, ...]
) -> None:
    with holding(arm) as served:
        moves(served, *words)
    path = arm.folder / "config.yaml"
    path.write_text(path.read_text().replace("gear: 100", "gear: 110"))
    with holding(arm) as served:
        said = refused(served, *words)
    (part,) = kept(arm)
    assert f"{part.name} {OF_OTHER_WIRING}" in said
    assert "than the present configuration has: delete it and run this again" in said
    assert "stands still" not in said  # no one is asked to move a link first


def test_a_recording_without_samples_is_in_the_way_by_its_name(arm: CommissionedArm) -> None:
    first, second = (arm.folder / "identify" / f"friction.part0{i}.mcap" for i in (1, 2))
    first.parent.mkdir()
    first.touch()
    with holding(arm) as served:
        served.until(lambda: record(lambda: Client(served.path), second, stop=lambda: True))
        said = refused(served, *FRICTION)
    assert f"{first.name} is empty; " in said
    assert f"{second.name}: it contains no samples: delete them and run this again" in said
