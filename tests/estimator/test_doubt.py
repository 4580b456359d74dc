"""Doubt in what was learned: what raises it, what keeps it up, and what ends it."""

from typing import Any

import numpy as np
import pytest

from estimator.doubt import AGREES, ENDED, FRICTION, GRAZED, Doubt

DT = 0.01
LOWERED, STATED = 0.1, 0.8


@pytest.fixture
def doubt() -> Doubt:
    return Doubt(1)


def step(
    doubt: Doubt, *, touched: bool = False, q: float = 0.0, velocity: float = 0.3,
    residual: float = 0.0, believed: float | None = None, moving: bool = True,
) -> int:  # fmt: skip
    doubt.moving[0] = moving
    size = abs(residual) if believed is None else believed
    return doubt.step(0, touched, q, velocity, residual, size, LOWERED, STATED, DT)


def run(doubt: Doubt, seconds: float, **seen: Any) -> list[int]:
    return [step(doubt, **seen) for _ in range(round(seconds / DT))]


def contact(doubt: Doubt, size: float = 0.3, **seen: Any) -> int:
    """A contact of a tenth of a second, and the tick after it; returns its verdict."""
    run(doubt, 0.1, touched=True, residual=size, **seen)
    return step(doubt, **{key: value for key, value in seen.items() if key != "believed"})


@pytest.mark.parametrize(
    ("size", "believed", "verdict", "value"),
    [
        (0.3, 0.3, ENDED, 1.0),  # without what was learned, too
        (0.3, 0.1, ENDED, 1.0),  # by what was learned alone
        (0.9, 0.9, AGREES, 0.0),  # a person, or an obstacle
        (0.9, 0.7, ENDED, 1.0),
    ],
)
def test_a_contact_that_ended_raises_doubt_unless_it_exceeded_the_stated_level(
    doubt: Doubt, size: float, believed: float, verdict: int, value: float
) -> None:
    assert contact(doubt, size, believed=believed) == verdict
    assert doubt.value[0] == value


@pytest.mark.parametrize("velocity", [0.3, -0.3])
def test_doubt_ends_with_agreeing_motion_in_the_interrupted_direction(velocity: float) -> None:
    doubt = Doubt(1)
    contact(doubt, velocity=velocity)
    run(doubt, 60.0, q=1.0, velocity=-velocity, residual=0.05)
    assert doubt.at(0, 1.0) == 1.0, "the other direction shows nothing"
    run(doubt, 0.45, q=1.0, velocity=velocity, residual=0.05)
    assert doubt.at(0, 1.0) == 1.0
    run(doubt, 0.6, q=1.0, velocity=velocity, residual=0.05)
    assert doubt.at(0, 1.0) == 0.0


def test_both_directions_must_agree_where_the_joint_stood(doubt: Doubt) -> None:
    contact(doubt, moving=False)
    run(doubt, 5.0, q=1.0, velocity=0.3)
    assert doubt.at(0, 1.0) == 1.0
    run(doubt, 1.1, q=1.0, velocity=-0.3)
    assert doubt.at(0, 1.0) == 0.0


def test_a_direction_that_disagrees_must_agree_again(doubt: Doubt) -> None:
    contact(doubt, velocity=0.3)
    step(doubt, q=1.0, velocity=-0.3, residual=0.15)
    run(doubt, 5.0, q=1.0, velocity=0.3)
    assert doubt.at(0, 1.0) == 1.0
    run(doubt, 1.1, q=1.0, velocity=-0.3)
    assert doubt.at(0, 1.0) == 0.0


def test_doubt_stays_at_rest(doubt: Doubt) -> None:
    contact(doubt)
    run(doubt, 60.0, moving=False)
    assert doubt.at(0, 1.0) == 1.0


def test_a_residual_beyond_the_lowered_level_keeps_the_doubt(doubt: Doubt) -> None:
    contact(doubt)
    for _ in range(20):
        run(doubt, 0.45, q=1.0, residual=0.05)
        assert step(doubt, q=1.0, residual=0.15) == AGREES
    assert doubt.at(0, 1.0) == 1.0


def test_a_place_is_doubted_until_it_was_passed(doubt: Doubt) -> None:
    contact(doubt, q=0.5)
    run(doubt, 30.0, q=1.0)
    assert (doubt.at(0, 1.0), doubt.at(0, 0.5), doubt.at(0, 0.55)) == (0.0, 1.0, 1.0)
    run(doubt, 1.1, q=0.5)
    assert doubt.at(0, 0.5) == 0.0


def test_a_place_that_was_met_again_is_doubted_for_twice_as_long(doubt: Doubt) -> None:
    for _ in range(2):
        contact(doubt, q=0.5)
        run(doubt, 10.0, q=1.0)
    run(doubt, 1.9, q=0.5)
    assert doubt.at(0, 0.5) == 1.0
    run(doubt, 0.2, q=0.5)
    assert doubt.at(0, 0.5) == 0.0


def test_a_place_that_interrupts_grows_and_is_counted(doubt: Doubt) -> None:
    contact(doubt, q=0.5)
    for _ in range(3):
        run(doubt, 5.0, q=0.0)
        for q in np.arange(0.42, 0.7, 0.01):
            step(doubt, q=float(q), residual=0.15)
    assert doubt.met[0] == 4
    assert doubt.at(0, 0.7) == 1.0
    assert doubt.at(0, 0.0) == 0.0


@pytest.mark.parametrize(("apart_s", "counted"), [(0.05, 1), (0.12, 9)])
def test_a_contact_that_comes_again_at_once_is_one(apart_s: float, counted: int) -> None:
    """A hand that pulls with about the level flickers across it; after the shortest quiet time the
    arm has gone on."""
    doubt = Doubt(1)
    rests: dict[str, Any] = {"q": 0.5, "velocity": 0.0, "moving": False}
    for _ in range(9):
        contact(doubt, q=0.5)
        run(doubt, apart_s, **rests)
    run(doubt, 0.1, **rests)
    assert (doubt.met[0], doubt.interrupted[0]) == (counted, counted)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_residual_that_follows_the_sign_of_the_motion_is_friction(sign: float) -> None:
    doubt = Doubt(1)
    contact(doubt, q=5.0)
    assert FRICTION not in run(doubt, 0.1, velocity=0.3, residual=0.2 * sign)
    assert FRICTION in run(doubt, 0.1, velocity=-0.3, residual=-0.2 * sign)


def test_a_residual_of_one_sign_is_no_friction(doubt: Doubt) -> None:
    contact(doubt, q=5.0)
    for velocity in (0.3, -0.3, 0.3, -0.3):
        assert FRICTION not in run(doubt, 0.5, velocity=velocity, residual=0.2)


def test_a_long_contact_raises_doubt(doubt: Doubt) -> None:
    run(doubt, 9.9, touched=True, residual=0.3)
    assert doubt.value[0] == 0.0
    run(doubt, 1.2, touched=True, residual=0.3)
    assert doubt.value[0] == 1.0


def test_a_long_contact_beyond_the_stated_level_raises_no_doubt(doubt: Doubt) -> None:
    run(doubt, 60.0, touched=True, residual=0.9)
    assert doubt.value[0] == 0.0


@pytest.mark.parametrize(
    ("before", "seconds", "size", "verdict"),
    [
        (0.08, 0.3, 0.12, GRAZED),
        (-0.08, 0.3, -0.12, GRAZED),
        (0.08, 0.1, 0.12, ENDED),  # it came at once
        (0.05, 0.3, 0.12, ENDED),
        (0.08, 0.3, 0.14, ENDED),  # it pressed on
    ],
)
def test_a_residual_that_creeps_over_the_level_grazes_it(
    doubt: Doubt, before: float, seconds: float, size: float, verdict: int
) -> None:
    run(doubt, seconds, residual=before)
    assert contact(doubt, size) == verdict


@pytest.mark.parametrize(
    ("grazes", "margins"),
    [
        ("own own own own own", (0.4, 1.2, 2.8, 4.0, 4.0)),  # soon at the stated level
        ("other other", (0.4, 0.4)),
        ("own own other", (0.4, 1.2, 1.2)),
    ],
)
def test_a_graze_widens_the_margin(doubt: Doubt, grazes: str, margins: tuple[float, ...]) -> None:
    for graze, margin in zip(grazes.split(), margins, strict=True):
        doubt.widen(0, graze == "own")
        assert doubt.margin[0] == pytest.approx(margin)


def test_a_margin_fades_in_motion_that_needs_none(doubt: Doubt) -> None:
    doubt.widen(0, True)
    for _ in range(3):
        run(doubt, 0.02, residual=0.095)  # below the level, but hardly
        run(doubt, 17.9, residual=0.085)
    run(doubt, 600.0, residual=0.085, moving=False)
    assert doubt.margin[0] == 0.4
    run(doubt, 10.1, residual=0.085)
    assert doubt.margin[0] == pytest.approx(0.4 / np.e, rel=0.02)


def test_changed_friction_is_found_below_the_margin(doubt: Doubt) -> None:
    doubt.widen(0, True)
    assert FRICTION not in run(doubt, 1.0, velocity=0.3, residual=-0.12)
    assert FRICTION in run(doubt, 1.0, velocity=-0.3, residual=0.12)


def test_a_reset_forgets_the_contact_that_lasts(doubt: Doubt) -> None:
    run(doubt, 0.1, touched=True, residual=0.9)
    doubt.reset(0)
    assert contact(doubt) == ENDED
