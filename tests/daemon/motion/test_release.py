"""Release of a clamp: which joints move, which way, how fast and how far; and when it is over."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.arrays import Vector
from daemon.motion.limits import Limits
from daemon.motion.release import DEBOUNCE_TICKS, PAUSE_S, SLACK_S, Ending, Release, ReleaseSettings

DT = 0.01
BOUNDS = ReleaseSettings(velocity=0.25, distance=0.3, ahead=np.full(2, 0.15))
LIMITS = Limits(np.full(2, -1.0), np.full(2, 1.0), np.array([1.0, 0.1]), np.full(2, 4.0), 0.025)
PRESSED = np.array([2.0, 0.0])
FOLLOWS = np.array([0.25, 0.0])  # how the motors move

torques = st.lists(st.floats(-9.0, 9.0) | st.just(0.0), min_size=2, max_size=2).map(np.array)
poses = st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=2).map(np.array)


def begun(q: Vector, thresholded: Vector) -> Release:
    release = Release(BOUNDS, LIMITS)
    release.begin(q, thresholded, 2.0 * thresholded)
    return release


def ends(release: Release, q: Vector, thresholded: Vector, *, sure: bool = True) -> int:
    """Ticks until it is over at that place and torque."""
    for tick in range(1, 1000):
        release.step(q, FOLLOWS, thresholded, DT, sure=sure)
        if release.end:
            return tick
    raise AssertionError("never")


@given(q=poses, torque=torques, after=st.lists(torques, min_size=1, max_size=60))
def test_it_never_moves_against_the_push_nor_beyond_its_bounds(
    q: Vector, torque: Vector, after: list[Vector]
) -> None:
    """Whatever is felt later."""
    release, start, way = begun(q, torque), q.copy(), np.sign(torque)
    velocity, stopped = np.zeros(2), np.zeros(2, dtype=bool)
    for each in after * 5:
        release.step(q, velocity, each, DT, sure=True)
        if release.end:
            break
        wanted = release.velocity(q)
        assert (wanted * way >= 0.0).all()
        assert (np.abs(wanted) <= np.minimum(BOUNDS.velocity, LIMITS.velocity)).all()
        assert not wanted[stopped].any(), "a joint that stopped moves again"
        stopped |= wanted == 0.0
        velocity = LIMITS.bound_velocity(q, wanted, velocity, DT)
        q = q + velocity * DT
        assert (way * (q - start) <= BOUNDS.distance + 1e-9).all()
        assert (np.abs(q) <= 1.0 + 1e-9).all()


def test_joints_that_feel_nothing_stand() -> None:
    release = begun(np.zeros(2), PRESSED)
    release.step(np.zeros(2), FOLLOWS, PRESSED, DT, sure=True)
    np.testing.assert_array_equal(release.velocity(np.zeros(2)), [BOUNDS.velocity, 0.0])


@pytest.mark.parametrize(
    ("motor", "speed"), [(-0.5, 0.15), (0.0, 0.15), (0.05, 0.2), (0.2, 0.25), (9.0, 0.25)]
)
def test_it_is_not_far_ahead_of_a_motor_that_something_stiff_holds(
    motor: float, speed: float
) -> None:
    release = begun(np.zeros(2), PRESSED)
    release.step(np.zeros(2), np.array([motor, 0.0]), PRESSED, DT, sure=True)
    assert release.velocity(np.zeros(2))[0] == pytest.approx(speed)


def test_each_joint_stops_when_it_feels_no_more_and_the_last_one_ends_it() -> None:
    release = begun(np.zeros(2), np.array([2.0, -1.0]))
    release.step(np.zeros(2), FOLLOWS, np.array([2.0, 0.0]), DT, sure=True)
    assert release.velocity(np.zeros(2)).tolist() == [0.25, 0.0]
    release.step(np.zeros(2), FOLLOWS, np.array([2.0, -1.0]), DT, sure=True)
    assert release.velocity(np.zeros(2))[1] == 0.0
    assert not release.end
    release.step(np.zeros(2), FOLLOWS, np.zeros(2), DT, sure=True)
    assert release.end is Ending.CONTACT_ENDED


@pytest.mark.parametrize(
    "felt", [np.array([-0.1, 0.0]), np.array([2.0, 0.1]), np.array([2.0, -0.1])]
)
def test_a_push_from_elsewhere_ends_it(felt: Vector) -> None:
    """From the other side, or at a joint that felt nothing."""
    release = begun(np.zeros(2), PRESSED)
    release.step(np.zeros(2), FOLLOWS, PRESSED, DT, sure=True)
    took = ends(release, np.zeros(2), felt)
    assert took <= DEBOUNCE_TICKS
    assert release.end is Ending.ELSEWHERE


def test_a_single_tick_from_elsewhere_does_not() -> None:
    release = begun(np.zeros(2), PRESSED)
    for _ in range(10):
        for felt in ([2.0, 0.1], [2.0, 0.1], [2.0, 0.0]):
            release.step(np.zeros(2), FOLLOWS, np.array(felt), DT, sure=True)
    assert not release.end


def test_while_the_sensing_is_not_sure_it_stands_and_then_goes_on() -> None:
    """Whatever it seems to feel meanwhile, and for as long as it may take."""
    release = begun(np.zeros(2), PRESSED)
    for felt in (np.zeros(2), -PRESSED, np.full(2, 5.0)):
        for _ in range(DEBOUNCE_TICKS + 1):
            release.step(np.zeros(2), FOLLOWS, felt, DT, sure=False)
            assert not release.velocity(np.zeros(2)).any()
    assert release.end is None
    took_s = DT * ends(release, np.zeros(2), PRESSED)
    assert took_s == pytest.approx(BOUNDS.distance / BOUNDS.velocity + SLACK_S, abs=2 * DT)


def test_it_ends_when_the_sensing_is_not_sure_for_long() -> None:
    release = begun(np.zeros(2), PRESSED)
    took_s = DT * ends(release, np.zeros(2), PRESSED, sure=False)
    assert took_s == pytest.approx(PAUSE_S, abs=2 * DT)
    assert release.end is Ending.UNSURE


def test_a_sure_tick_now_and_then_does_not_let_it_wait_for_ever() -> None:
    release = begun(np.zeros(2), PRESSED)
    for tick in range(1000):
        release.step(np.zeros(2), FOLLOWS, PRESSED, DT, sure=tick % 3 == 0)
        if release.end:
            break
    assert release.end is Ending.UNSURE
    assert tick * DT == pytest.approx(3.0 * PAUSE_S, abs=5 * DT)


def test_begun_again_by_the_same_push_it_has_what_is_left_of_its_distance() -> None:
    release, further = begun(np.zeros(2), PRESSED), np.array([0.25, 0.0])
    for push, forgotten, room in ((1, False, 0.05), (-1, False, 0.3), (-1, True, 0.3)):
        if forgotten:
            release.forget()
        release.begin(further, push * PRESSED, PRESSED)
        reached = further + push * np.array([room - 0.005, 0.0])
        assert ends(release, reached, push * PRESSED) == 1
        assert release.end is Ending.BOUND
        release.begin(further, push * PRESSED, PRESSED)
        release.step(
            further + push * np.array([room - 0.03, 0]), FOLLOWS, push * PRESSED, DT, sure=True
        )
        assert release.end is None


@pytest.mark.parametrize(
    ("felt", "q", "words"),
    [
        ([0.0, 0.0], [0.1, 0.0], "let go of contact at a (+4.0 Nm)"),
        ([2.0, 0.0], [0.295, 0.0], "still pressed with +4.0 Nm at a after giving way by 0.29 rad"),
        (
            [2.0, 0.0],
            [0.1, 0.0],
            "still pressed with +4.0 Nm at a after giving way by 0.10 rad for 2.2 s",
        ),
        (
            [0.0, -0.1],
            [0.1, 0.0],
            "pressed from elsewhere while it let go: contact of -0.2 Nm at b",
        ),
    ],
)
def test_its_end_names_the_joint_and_the_torque(
    felt: list[float], q: list[float], words: str
) -> None:
    release, there, torque = begun(np.zeros(2), PRESSED), np.array(q), np.array(felt)
    ends(release, there, torque)
    assert release.in_words(("a", "b"), there, torque, 2.0 * torque) == words


def test_it_ends_when_it_takes_too_long() -> None:
    release = begun(np.zeros(2), PRESSED)
    took_s = DT * ends(release, np.zeros(2), PRESSED)
    assert took_s == pytest.approx(BOUNDS.distance / BOUNDS.velocity + SLACK_S, abs=2 * DT)
    assert release.end is Ending.TIME


@pytest.mark.parametrize("q", [np.array([0.995, 0.0]), np.array([0.295, 0.0])])
def test_it_ends_at_a_limit_and_after_its_distance(q: Vector) -> None:
    release = begun(np.zeros(2), PRESSED)
    assert ends(release, q, PRESSED) == 1
    assert release.end is Ending.BOUND


@pytest.mark.parametrize(
    ("torque", "possible"),
    [([1.0, 0.0], False), ([-1.0, 0.0], True), ([1.0, 0.5], True), ([0.0, 0.0], False)],
)
def test_it_is_possible_where_a_joint_that_is_pressed_has_room(
    torque: list[float], possible: bool
) -> None:
    release = Release(BOUNDS, LIMITS)
    assert release.possible(np.array([0.999, 0.0]), np.array(torque)) is possible


def test_it_rests_where_each_joint_is_further_from_what_pressed() -> None:
    release = begun(np.zeros(2), np.array([1.0, -1.0]))
    there, back = np.array([0.2, -0.2]), np.array([0.1, -0.1])
    np.testing.assert_array_equal(release.rest(back, there, np.zeros(2)), there)
    np.testing.assert_array_equal(release.rest(there, back, np.zeros(2)), there)
    pressed_back = np.array([-0.1, 0.0])
    np.testing.assert_array_equal(release.rest(back, there, pressed_back), [0.1, -0.2])
