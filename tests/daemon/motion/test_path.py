"""Sinusoids, and a Follower that runs along a path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.arrays import Vector
from daemon.motion.limits import Limits
from daemon.motion.path import Follower, PathPoint, Sinusoids
from daemon.motion.sampled_path import PathBuilder, SampledPath
from daemon.motion.trajectory_file import rows_of, slopes

JOINTS = ["a", "b", "c"]
PATH = Sinusoids(
    amplitude=np.array([0.35, 0.0, 0.1]), omega=2.0 * np.pi * np.array([0.15, 0.0, 0.5])
)
DT, RAMP = 0.01, 2.0
HERE = np.array([1.0, -0.5, 0.2])


def follower_of(path: object = PATH, ramp_s: float = RAMP) -> Follower:
    return Follower(PathPoint(path), ramp_s)  # type: ignore[arg-type]


def wave(duration: float = 4.0) -> SampledPath:
    """b swings by 0.3 rad around 0.1 and ends in motion."""
    limits = Limits(np.full(3, -1.0), np.full(3, 1.0), np.full(3, 2.0), np.full(3, 8.0), 0.015)
    builder = PathBuilder("wave", JOINTS, ["b"], limits, RAMP)
    times = np.arange(0.0, duration + 1e-9, 0.02)
    q = 0.1 + 0.3 * np.sin(times[:, None])
    builder.append(rows_of(times, q, slopes(times, q)))
    return builder.finish()


def test_a_joint_that_is_not_named_holds() -> None:
    assert PATH.amplitude.tolist() == [0.35, 0.0, 0.1]
    assert PATH.offset(3.3)[1] == PATH.slope(3.3)[1] == 0.0


@pytest.mark.parametrize("s", [0.0, 0.7, 1.9, 12.34])
def test_the_slope_is_the_derivative_of_the_offset(s: float) -> None:
    h = 1e-6
    difference = (PATH.offset(s + h) - PATH.offset(s - h)) / (2 * h)
    np.testing.assert_allclose(PATH.slope(s), difference, atol=1e-8)


def test_it_starts_where_the_arm_stands_and_softly() -> None:
    follower = follower_of()
    follower.anchor(HERE)
    first = follower.step(DT)
    np.testing.assert_allclose(first.q, HERE, atol=1e-4)
    np.testing.assert_allclose(first.velocity, PATH.slope(0.0) * DT / RAMP, rtol=1e-4)


def test_it_reaches_full_speed_after_the_ramp_and_lags_half_of_it() -> None:
    follower = follower_of()
    follower.anchor(HERE)
    for _ in range(round(RAMP / DT)):
        reference = follower.step(DT)
    s = RAMP / 2
    np.testing.assert_allclose(reference.velocity, PATH.slope(s), rtol=1e-9)
    np.testing.assert_allclose(reference.q, HERE + PATH.offset(s), rtol=1e-9)
    for _ in range(100):
        reference = follower.step(DT)
    np.testing.assert_allclose(reference.q, HERE + PATH.offset(s + 1.0), rtol=1e-9)
    assert not follower.finished


@pytest.mark.parametrize("path", [PATH, wave()], ids=["sinusoids", "samples"])
def test_the_velocity_is_that_of_the_reference(path: object) -> None:
    follower = follower_of(path)
    follower.anchor(HERE)
    references = [follower.step(1e-3) for _ in range(7000)]
    q = np.array([r.q for r in references])
    v = np.array([r.velocity for r in references])
    np.testing.assert_allclose((q[2:] - q[:-2]) / 2e-3, v[1:-1], atol=6e-4)


@pytest.mark.parametrize("dt", [0.001, 0.01, 0.1])
@pytest.mark.parametrize("duration", [0.04, 1.0, 4.0])
def test_it_stops_softly_exactly_at_the_end(duration: float, dt: float) -> None:
    path = wave(duration)
    follower = follower_of(path)
    follower.anchor(HERE)
    rates = [0.0]
    for _ in range(round((duration + 2 * RAMP + 1.0) / dt)):
        reference = follower.step(dt)
        rates.append(follower._rate)
    assert follower.finished
    assert not reference.velocity.any()
    np.testing.assert_array_equal(reference.q, HERE + path.offset(duration))
    assert np.abs(np.diff(rates)).max() <= dt / RAMP + 1e-9
    assert follower.place.s == duration


def test_anchored_anew_it_goes_on_from_there_at_its_path_time() -> None:
    follower = follower_of()
    follower.anchor(HERE)
    for _ in range(300):
        before = follower.step(DT)
    moved = HERE + np.array([0.3, 0.2, -0.1])
    follower.anchor(moved)
    after = follower.step(DT)
    np.testing.assert_allclose(after.q, moved, atol=1e-4)  # from where the person left it
    assert np.abs(after.velocity).max() <= DT / RAMP * np.abs(PATH.slope(0.0)).max()  # from rest
    for _ in range(400):
        after = follower.step(DT)
    # The same shape at the same path time, only elsewhere: 2 s + 3.01 s of path were run.
    np.testing.assert_allclose(after.q - moved, PATH.offset(5.01) - PATH.offset(2.0), atol=1e-9)
    assert not np.allclose(after.q, before.q)


def test_put_at_its_beginning_it_begins_from_the_start() -> None:
    used, fresh = follower_of(), follower_of()
    used.anchor(HERE)
    for _ in range(321):
        used.step(DT)
    used.place = PathPoint(PATH)
    for follower in (used, fresh):
        follower.anchor(HERE)
    np.testing.assert_array_equal(used.step(DT).q, fresh.step(DT).q)


@pytest.mark.parametrize(
    ("shift", "leaves"),
    [
        ([0.0, 0.0, 0.0], [False, False, False]),
        ([0.149, 0.0, 0.0], [False, False, False]),
        ([0.151, 0.0, 0.0], [True, False, False]),
        ([-0.151, 0.0, 0.401], [True, False, True]),
        ([0.0, 9.0, 0.0], [False, False, False]),  # a joint that holds does not leave its place
    ],
)
def test_which_joints_would_leave_their_limits(shift: list[float], leaves: list[bool]) -> None:
    bound = np.full(3, 0.5)
    assert PathPoint(PATH).leaves_limits(np.array(shift), -bound, bound).tolist() == leaves


def test_leaving_limits_looks_at_the_path_ahead_not_only_at_the_place() -> None:
    follower = follower_of()
    follower.anchor(np.zeros(3))
    for _ in range(200):
        reference = follower.step(DT)
    # At the far end of the swing there is room for the way back.
    bound = np.full(3, 0.36)
    assert not follower.place.leaves_limits(reference.q, -bound, bound).any()
    assert follower.place.leaves_limits(reference.q + 0.02, -bound, bound).tolist() == [
        True,
        False,
        False,
    ]


def test_only_the_beginning_of_recorded_samples_asks_for_a_place() -> None:
    def stand(b: float) -> np.ndarray:  # joints that are not named may stand anywhere
        return np.array([9.0, b, -9.0])

    place = PathPoint(wave())
    assert not place.off_start(stand(0.1), 0.05).any()
    assert not place.off_start(stand(0.149), 0.05).any()
    assert place.off_start(stand(0.049), 0.05).tolist() == [False, True, False]
    assert not PathPoint(wave(), 1.0).off_start(stand(1.1), 0.05).any()
    assert not PathPoint(PATH).off_start(stand(0.1), 0.05).any()


positions = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)
LOWER, UPPER = np.full(3, -1.0), np.full(3, 1.0)


@given(positions, st.floats(0.0, 20.0), st.floats(0.0, 0.5))
def test_the_nearest_place_where_a_path_fits(q: Vector, s: float, inside: float) -> None:
    place = PathPoint(PATH, s)
    nearest = place.nearest(q, LOWER, UPPER, inside)
    assert not place.leaves_limits(nearest, LOWER, UPPER).any()
    assert nearest[1] == q[1]  # it holds
    fits = ~place.leaves_limits(q, LOWER, UPPER)
    if inside == 0.0:
        np.testing.assert_allclose(nearest[fits], q[fits], atol=2e-9)
        # Nearer to q it does not fit.
        nearer = nearest + 1e-6 * np.sign(q - nearest)
        assert (place.leaves_limits(nearer, LOWER, UPPER) | (nearest == q) | fits).all()
    room = UPPER - LOWER - 2.0 * PATH.amplitude
    depth = np.minimum(inside, 0.5 * room)[[0, 2]]
    origin = (nearest - PATH.offset(s))[[0, 2]]
    edges = 1.0 - PATH.amplitude[[0, 2]]
    assert (edges - np.abs(origin) >= depth - 1e-9).all()


def test_a_path_that_fits_nowhere_has_no_nearest_place() -> None:
    nearest = PathPoint(PATH).nearest(HERE, np.full(3, -0.3), np.full(3, 0.3))
    assert np.isnan(nearest).tolist() == [True, False, False]


def test_of_a_path_that_ends_only_what_is_left_must_fit() -> None:
    """b goes from 0.1 over 0.4 at s = pi/2 to -0.2 or so at 4."""
    q = np.array([0.0, 0.9, 0.0])
    nearest = PathPoint(wave(), 0.0).nearest(q, LOWER, UPPER)
    assert nearest[1] == pytest.approx(0.7, abs=1e-3)
    assert PathPoint(wave(), 2.0).nearest(q, LOWER, UPPER)[1] == 0.9
