"""The probe for a hand that rests: a swing that comes back, and what it takes for a hand."""

import numpy as np
import pytest

from daemon.motion.probe import CYCLES, FADES_S, PERIOD_S, SHARE, SPEED, Probe
from estimator.contact import dead_band

T, QUIET_S, LEVEL = 0.01, 2.0, np.array([1.0, 0.4])


def swung(probe: Probe, hand: float, rubs: float = 0.0, until_s: float = QUIET_S) -> np.ndarray:
    """Velocities (ticks, 2) of a quiet time with a hand [levels] on the second joint, whose
    friction is off by so many levels."""
    rows = []
    for tick in range(1, round(until_s / T) + 1):
        felt = hand + rubs * np.sign(probe.velocity[1])
        probe.step(tick * T, np.array([0.0, felt * LEVEL[1]]), LEVEL)
        rows.append(probe.velocity)
    return np.array(rows)


def test_it_swings_at_the_end_of_the_quiet_time_and_comes_back() -> None:
    velocity = swung(Probe(2, QUIET_S), 0.0)
    way = T * velocity.cumsum(axis=0)
    moves = np.flatnonzero(velocity.any(axis=1))
    assert moves[0] * T >= QUIET_S - CYCLES * PERIOD_S - T
    assert np.abs(velocity).max() <= SPEED
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.1 * SPEED  # no jump is felt
    assert np.abs(way).max() == pytest.approx(SPEED * PERIOD_S / np.pi, rel=0.05)
    assert np.abs(way[-1]).max() < 1e-4
    assert np.all(way[:, 0] == -way[:, 1])  # joints do not add up at the tool


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("hand", "rubs", "found"),
    [(1.1, 0.0, 1), (0.9, 0.0, None), (0.0, 0.9 / SHARE, None), (1.1, 0.5 / SHARE, 1)],
)
def test_what_does_not_turn_with_the_motion_is_a_hand(
    way: float, hand: float, rubs: float, found: int | None
) -> None:
    probe = Probe(2, QUIET_S)
    swung(probe, way * hand * SHARE, rubs * SHARE)
    assert probe.hand() == found


def test_a_pause_stands_and_changes_no_mean() -> None:
    probe = Probe(2, QUIET_S)
    swung(probe, 1.1 * SHARE, until_s=QUIET_S - 0.3)
    assert probe.velocity.any()
    probe.pause()
    assert not probe.velocity.any()
    for tick in range(round((QUIET_S - 0.3) / T) + 1, round(QUIET_S / T) + 1):
        probe.step(tick * T, 1.1 * SHARE * LEVEL * [0, 1], LEVEL)
    assert probe.hand() == 1


def test_a_contact_on_the_way_begins_it_anew() -> None:
    probe = Probe(2, QUIET_S)
    swung(probe, 0.9, until_s=QUIET_S - 0.1)
    probe.step(0.0, LEVEL, LEVEL)
    assert not probe.velocity.any()
    assert probe.hand() is None
    swung(probe, 0.0)
    assert probe.hand() is None


@pytest.mark.parametrize(
    ("first", "later", "found"),
    [(1.1, 0.95, 1), (1.1, 1.2, 1), (1.1, 0.85, None), (1.1, 0.6, None), (1.1, -0.9, None),
     (1.1, -1.1, 1), (2.0, 1.25, 1), (2.0, 1.15, 1)],
)  # fmt: skip
def test_a_hand_that_was_found_rests_until_its_mean_changes(
    first: float, later: float, found: int | None
) -> None:
    probe = Probe(2, QUIET_S)
    for _ in range(2):
        swung(probe, first * SHARE)
        assert probe.hand() == 1
        probe.stop()
    for hand in (1, found):  # what it left stays
        swung(probe, later * SHARE)
        assert probe.hand() == hand
        probe.stop()
    swung(probe, later * SHARE)
    probe.forget()
    assert (probe.hand() is None) == (abs(later) < 1.0)


@pytest.mark.parametrize(("last", "found"), [(0.0, None), (0.3, None), (0.6, 1), (-0.6, 1)])
def test_a_hand_that_moves_is_not_gone_where_it_shows_least(last: float, found: int | None) -> None:
    """It pressed at right angles to what shows, and the trajectory went on in it."""
    probe = Probe(2, QUIET_S)
    for mean, hand in ((1.4, 1), (0.7, 1), (0.0, 1), (last, found)):
        swung(probe, mean * SHARE)
        assert probe.hand() == hand
        probe.stop()


@pytest.mark.parametrize(("ends", "found"), [(0.18, 1), (0.17, None)])
def test_a_hand_whose_mean_fades_slowly_rests_until_it_is_no_more_than_without_one(
    ends: float, found: int | None
) -> None:
    """Friction that has slid sticks anew, and takes over a part."""
    probe = Probe(2, QUIET_S)
    for mean in (*np.linspace(0.28, ends, 6), ends):
        swung(probe, mean)
        hand = probe.hand()
        probe.stop()
    assert hand == found


@pytest.mark.parametrize(("quiet_s", "some"), [(FADES_S + CYCLES * PERIOD_S - 0.05, False),
                                               (FADES_S + CYCLES * PERIOD_S + 0.05, True),
                                               (10.0, True)])  # fmt: skip
def test_a_short_quiet_time_has_no_room_for_it(quiet_s: float, some: bool) -> None:
    probe = Probe(2, quiet_s)
    velocity = swung(probe, 0.9, until_s=quiet_s)
    assert velocity.any() == some
    assert (probe.hand() is not None) == some
    assert not dead_band(np.array([0.9]) * LEVEL[1], LEVEL[1:]).any()  # no level shows it


# Force at the tool along x, y, z: shares of the levels.
TOOL = np.array([[0.5, 0.5], [0.0, 0.0], [0.0, 0.1]]) * LEVEL


@pytest.mark.parametrize(
    ("hand", "work", "found"),
    [((0.13, 0.13), (0.0, 0.0), True), ((0.12, -0.12), (0.0, 0.0), False),
     ((0.12, 0.12), (0.1, 0.1), False), ((0.0, 0.0), (-0.13, -0.13), True),
     ((0.12, 0.12), (0.9, 0.9), False), ((0.26, 0.0), (0.25, 0.0), True)],
)  # fmt: skip
def test_a_force_at_the_tool_is_found_beyond_what_the_work_showed(
    hand: tuple[float, float], work: tuple[float, float], found: bool
) -> None:
    probe = Probe(2, QUIET_S)
    for tick in range(800):
        way, shown = np.sign(np.sin(0.1 * tick)) * np.ones(2), work if tick > 400 else (-1.0, -1.0)
        probe.work((np.array(shown) + 0.4 * way) * LEVEL, 0.2 * way, 0.5)  # and friction
    for tick in range(1, round(QUIET_S / T) + 1):
        probe.step(tick * T, np.array(hand) * LEVEL, LEVEL)
    assert (probe.hand(TOOL) is not None) == found


def test_work_of_one_direction_shows_no_error_of_the_masses() -> None:
    probe = Probe(2, QUIET_S)
    for _ in range(400):
        probe.work(0.13 * LEVEL, np.full(2, 0.2), T)
    for tick in range(1, round(QUIET_S / T) + 1):
        probe.step(tick * T, 0.13 * LEVEL, LEVEL)
    assert probe.hand(TOOL) is not None
