"""Playout buffer: what late, early, repeated and lost targets leave of the sender's motion."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.motion.playout import HOLDOVER_S, LONGEST_DELAY_S, TOO_LATE_S, Playout, Target

DT = 0.01
SPEED = 0.5  # of a motion at constant velocity [rad/s]


def pose(*values: float) -> np.ndarray:
    return np.array(values)


def ramp(number: int, rate_hz: float) -> Target:
    return Target(number, number / rate_hz, pose(SPEED * number / rate_hz))


def played(rate_hz: float, seconds: float, jitter_s: float = 0.0, loss: float = 0.0) -> Playout:
    """Buffer after a ramp at a rate, of which a seeded share is late or lost."""
    rng = np.random.default_rng(7)
    count = int(seconds * rate_hz)
    late = rng.uniform(0.0, jitter_s, count)
    there = rng.random(count) >= loss
    arrivals = sorted((k / rate_hz + late[k], k) for k in range(1, count) if there[k])
    playout = Playout(ramp(0, rate_hz), 0.0)
    for tick in itertools.count(1):
        now_s = tick * DT
        while arrivals and arrivals[0][0] <= now_s:
            playout.put(ramp(arrivals.pop(0)[1], rate_hz), now_s)
        playout.step(now_s, DT)
        if not arrivals:
            return playout
    raise AssertionError


@pytest.mark.parametrize("rate_hz", [20.0, 50.0, 100.0, 200.0])
def test_a_steady_motion_is_read_at_its_speed_and_at_the_delay_that_it_reports(
    rate_hz: float,
) -> None:
    playout = played(rate_hz, 5.0, jitter_s=0.01, loss=0.05)
    q, velocity = playout.read()
    assert velocity[0] == pytest.approx(SPEED, rel=1e-6)
    behind_s = playout.newest.sent_s - q[0] / SPEED
    age_s = playout.now_s - playout.newest.sent_s
    assert behind_s + age_s == pytest.approx(playout.delay_s, abs=2.5 * DT)
    assert playout.delay_s <= 0.06 or rate_hz < 100.0


def test_period_losses_and_jitter_are_measured() -> None:
    playout = played(50.0, 10.0, jitter_s=0.02, loss=0.1)
    assert 1.0 / playout.period_s == pytest.approx(50.0, rel=0.02)
    assert 0.05 * 500 < playout.lost < 0.2 * 500
    assert 0.005 < playout.jitter_s < 0.021


@pytest.mark.parametrize(
    ("number", "sent_s", "now_s", "taken"),
    [
        (3, 0.03, 0.03, True),
        (2, 0.03, 0.03, False),  # repeated
        (1, 0.03, 0.03, False),  # out of order
        (3, 0.02, 0.03, False),  # its time stands still
        (3, 0.01, 0.03, False),  # its time runs back
        (3, 0.03, 0.03 + TOO_LATE_S + 0.01, False),
        (9, 0.09, 0.09, True),
    ],
)
def test_which_targets_count(number: int, sent_s: float, now_s: float, taken: bool) -> None:
    playout = Playout(Target(0, 0.0, pose(0.0)), 0.0)
    assert playout.put(Target(2, 0.02, pose(0.1)), 0.02)
    assert playout.put(Target(number, sent_s, pose(0.5)), now_s) is taken
    assert playout.dropped == (not taken)
    assert playout.newest.q[0] == (0.5 if taken else 0.1)


def test_a_first_target_that_was_late_is_found_out() -> None:
    playout = Playout(ramp(0, 100.0), 0.1)  # all others come at once
    for tick in range(1, 400):
        playout.put(ramp(tick, 100.0), tick * DT)
        playout.step(tick * DT, DT)
    behind_s = 3.99 - playout.read()[0][0] / SPEED
    assert behind_s == pytest.approx(playout.delay_s, abs=0.015)
    assert playout.delay_s < 0.07


def test_beyond_the_last_target_its_velocity_is_believed_for_a_while() -> None:
    playout = played(100.0, 1.0)
    last = playout.newest
    for tick in range(200):
        playout.step(last.sent_s + (tick + 1) * DT, DT)
    q, velocity = playout.read()
    assert velocity[0] == 0.0
    assert q[0] == pytest.approx(last.q[0] + SPEED * HOLDOVER_S)


def test_a_velocity_that_the_sender_gives_is_used() -> None:
    playout = Playout(Target(0, 0.0, pose(0.0)), 0.0)
    playout.put(Target(1, 0.01, pose(0.0), pose(0.8)), 0.01)
    for tick in range(100):
        playout.step(0.01 + (tick + 1) * DT, DT)
    assert playout.read()[0][0] == pytest.approx(0.8 * HOLDOVER_S)


@given(
    st.lists(
        st.tuples(st.integers(0, 40), st.floats(-1.0, 2.0), st.floats(-3.0, 3.0), st.booleans()),
        max_size=40,
    )
)
def test_what_is_read_is_one_smooth_motion_and_its_velocity(
    arrivals: list[tuple[int, float, float, bool]],
) -> None:
    """Whatever comes: the pose never leaves the range of the targets and of what their velocity
    adds, and the delay stays in its bound."""
    playout = Playout(Target(0, 0.0, pose(0.0)), 0.0)
    now_s = 0.0
    for number, sent_s, q, ticks in arrivals:
        playout.put(Target(number, sent_s, pose(q), pose(0.0)), now_s)
        for _ in range(3 if ticks else 0):
            now_s += DT
            playout.step(now_s, DT)
            here, velocity = playout.read()
            assert np.isfinite(here).all()
            assert np.isfinite(velocity).all()
            assert -3.0 - 1e-9 <= here[0] <= 3.0 + 1e-9
        assert 0.0 <= playout.delay_s <= LONGEST_DELAY_S
