"""Cubic pieces between samples: the path that runs is the one checked, chunk by chunk."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import TrajectoryError
from daemon.motion.limits import Limits
from daemon.motion.sampled_path import PathBuilder, SampledPath
from daemon.motion.trajectory_file import MAX_ROWS, rows_of, slopes
from tests.examples import scaled

JOINTS = ["a", "b", "c"]
LIMITS = Limits(
    np.array([-1.0, -2.0, -0.5]),
    np.array([1.0, 0.5, 0.5]),
    np.array([1.0, 2.0, 1.0]),
    np.array([4.0, 6.0, 4.0]),
    0.015,
)
RAMP = 2.0
Row = list[float]


def builder(columns: tuple[str, ...] = ("a",), *, from_here: bool = False) -> PathBuilder:
    return PathBuilder("test", JOINTS, columns, LIMITS, RAMP, from_here=from_here)


def built(rows: list[Row], columns: tuple[str, ...] = ("a",), chunk: int = 10_000) -> SampledPath:
    taken = builder(columns)
    for first in range(0, len(rows), chunk):
        taken.append(rows[first : first + chunk])
    return taken.finish()


def swing(period: float = 0.05, start_s: float = 0.0) -> tuple[np.ndarray, list[Row]]:
    """c and a, in this order, for 6 s."""
    t = np.arange(0.0, 6.0 + 1e-9, period)
    q = np.stack([0.2 * np.cos(t) - 0.2, 0.5 * np.sin(t) + 0.3], axis=1)
    v = np.stack([-0.2 * np.sin(t), 0.5 * np.cos(t)], axis=1)
    return t, rows_of(t + start_s, q, v)


@pytest.mark.parametrize("chunk", [1, 2, 7, 10_000])
def test_it_goes_through_every_sample_whatever_the_chunks(chunk: int) -> None:
    t, rows = swing(start_s=5.0)
    path = built(rows, ("c", "a"), chunk)
    assert path.duration == pytest.approx(6.0)
    for time_s, (_, qc, qa, vc, va) in zip(t, rows, strict=True):
        s = float(time_s)
        np.testing.assert_allclose(path.offset(s), [qa - 0.3, 0.0, qc], atol=1e-12)
        np.testing.assert_allclose(path.slope(s), [va, 0.0, vc], atol=1e-9)
    np.testing.assert_allclose(path.begin, [0.3, np.nan, 0.0])


def test_between_the_samples_it_is_smooth_and_close() -> None:
    _, rows = swing(0.1)
    path = built(rows, ("c", "a"))
    for s in np.linspace(0.01, 5.99, 777):
        slope = (path.offset(s + 1e-6) - path.offset(s - 1e-6)) / 2e-6
        np.testing.assert_allclose(path.slope(s), slope, atol=1e-8)
        assert path.offset(s)[0] == pytest.approx(0.5 * math.sin(s), abs=1e-6)
        assert path.slope(s)[0] == pytest.approx(0.5 * math.cos(s), abs=1e-4)


def test_before_the_beginning_and_behind_the_end_it_stands_at_its_ends() -> None:
    path = built(swing()[1], ("c", "a"))
    np.testing.assert_array_equal(path.offset(-1.0), path.offset(0.0))
    np.testing.assert_array_equal(path.offset(9.0), path.offset(path.duration))


def test_the_extent_is_that_of_what_is_left() -> None:
    path = built(swing(0.005)[1], ("c", "a"), chunk=100)  # two blocks
    low, high = path.extent(0.0)
    np.testing.assert_allclose(low, [-0.5, 0.0, -0.4], atol=1e-4)
    np.testing.assert_allclose(high, [0.5, 0.0, 0.0], atol=1e-4)
    assert path.extent(5.9)[1][0] < 0.1  # the crest is behind
    for s in np.linspace(0.0, 6.0, 50):
        low, high = path.extent(s)
        ahead = np.array([path.offset(x) for x in np.linspace(s, 6.0, 50)])
        assert (ahead >= low - 1e-9).all()
        assert (ahead <= high + 1e-9).all()


@settings(max_examples=scaled(50))
@given(
    knots=st.lists(
        st.tuples(st.floats(0.02, 2.0), st.floats(-1.0, 1.0), st.floats(-1.5, 1.5)),
        min_size=2,
        max_size=8,
    ),
    chunk=st.integers(1, 4),
)
def test_what_is_accepted_breaks_no_limit_anywhere(
    knots: list[tuple[float, float, float]], chunk: int
) -> None:
    """And what is refused breaks one: by dense sampling, chunks and all."""
    times = np.cumsum([h for h, _, _ in knots])
    rows = [[float(t), q, v] for t, (_, q, v) in zip(times, knots, strict=True)]
    loose = Limits(np.full(3, -9e8), np.full(3, 9e8), np.full(3, 1e8), np.full(3, 1e8), 0.01)
    free = PathBuilder("free", JOINTS, ["a"], loose, RAMP)
    free.append(rows)
    path = free.finish()
    # Each piece by itself, from inside: the acceleration jumps from piece to piece.
    q, v, a = [], [], []
    for t0, t1 in zip(times - times[0], (times - times[0])[1:], strict=False):
        s = np.linspace(t0 + 1e-9, t1 - 1e-9, 60)
        slope = np.array([path.slope(x)[0] for x in s])
        q += [path.offset(x)[0] + rows[0][1] for x in s]
        v += slope.tolist()
        a += (np.abs(np.gradient(slope, s)) + np.abs(slope).max() / RAMP).tolist()
    broken = np.max(np.abs(q)) > 1.0 or np.max(np.abs(v)) > 1.0 or np.max(a) > 4.0
    near = (
        abs(np.max(np.abs(q)) - 1.0) < 1e-3
        or abs(np.max(np.abs(v)) - 1.0) < 2e-3
        or abs(np.max(a) - 4.0) < 0.1
    )
    taken = builder()
    refused = ""
    try:
        for first in range(0, len(rows), chunk):
            taken.append(rows[first : first + chunk])
        taken.finish()
    except TrajectoryError as error:
        refused = str(error)
    assert near or broken == bool(refused), refused


@pytest.mark.parametrize(
    ("rows", "row", "words"),
    [
        ([[0, 0, 0], [0.1, 0.5, 0]], 1, r"a: jumps by 0.5 rad in 0.1 s: 5 rad/s .* limit 1"),
        ([[0, 0.9, 0], [1, 0.9, 0], [2, 1.1, 0]], 2, r"a: reaches 1.1 rad, outside .*\[-1, 1\]"),
        ([[0, 0.9, 0.9], [0.9, 0.9, -0.9]], 1, r"a: reaches 1.\d+ rad, outside"),
        ([[0, 0, 0], [1, 0.9, 0]], 1, r"a: reaches 1.35 rad/s before this sample, .* limit 1"),
        ([[0, 0, 0], [0.1, 0.05, 0.9]], 1, r"a: reaches 1\d.* rad/s2 before .* limit 4"),
        ([[0, 0, 0], [1, 0, 0], [1, 0, 0]], 2, "time_s: 1 does not come after 1"),
        ([[5, 0, 0], [6, 0, 0], [5.5, 0, 0]], 2, "time_s: 5.5 does not come after 6"),
        ([[0, 0, 0], [1, math.nan, 0]], 1, "a: nan is not a number"),
        ([[0, 0, 0], [math.inf, 0, 0]], 1, "time_s: inf is not a number"),
        ([[0, 0, 0], [1, 0, 1e10]], 1, r"a: 10000000000.0 is not a number"),
        ([[0, 0, 0], [1, 0]], 1, "2 numbers instead of 3"),
        ([[0, 0, 0], []], 1, "0 numbers instead of 3"),
        ([[0, 0, 0]], None, "1 rows of samples; a trajectory needs two"),
        ([], None, "0 rows of samples"),
    ],
)
@pytest.mark.parametrize("chunk", [1, 2, 100])
def test_what_cannot_be_run_is_refused_with_its_row(
    rows: list[Row], row: int | None, words: str, chunk: int
) -> None:
    with pytest.raises(TrajectoryError, match=words) as caught:
        built(rows, chunk=chunk)
    assert caught.value.row == row


def test_a_limit_may_be_reached_and_not_crossed() -> None:
    for q, good in ((1.0, True), (1.0 + 1e-6, False)):
        rows = [[0.0, q - 0.01, 0.0], [1.0, q, 0.0]]
        if good:
            built(rows)
        else:
            with pytest.raises(TrajectoryError, match="outside"):
                built(rows)


def test_the_soft_start_is_part_of_the_acceleration() -> None:
    # At 0.9 rad/s a ramp of 2 s adds 0.45 rad/s2 to the 3.7 of the way there.
    h = 0.9 / 3.7
    rows = [[0.0, 0.0, 0.0], [h, 0.5 * 3.7 * h**2, 0.9]]
    with pytest.raises(TrajectoryError, match=r"4\.15 rad/s2"):
        built(rows)
    PathBuilder("hard", JOINTS, ["a"], LIMITS, 20.0).append(rows)


def test_from_here_only_the_shape_counts() -> None:
    rows = [[0.0, 5.0, 0.0], [1.0, 5.2, 0.0]]
    with pytest.raises(TrajectoryError, match="outside"):
        built(rows)
    taken = builder(from_here=True)
    taken.append(rows)
    path = taken.finish()
    assert path.begin is None
    assert path.offset(1.0)[0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (("a", "d"), "no joint `d`; there are: a, b, c"),
        (("a", "b", "a"), "two columns `a`"),
        ((), "no joint is named"),
    ],
)
def test_columns(columns: tuple[str, ...], words: str) -> None:
    with pytest.raises(TrajectoryError, match=words):
        builder(columns)


def test_a_refused_chunk_leaves_what_was_there() -> None:
    taken = builder()
    taken.append([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0]])
    with pytest.raises(TrajectoryError):
        taken.append([[2.0, 0.2, 0.0], [2.1, 0.9, 0.0]])
    assert taken.rows == 2
    taken.append([[2.0, 0.2, 0.0]])
    assert taken.finish().duration == 2.0


def test_there_is_a_most() -> None:
    taken = builder()
    for first in range(0, MAX_ROWS, 1000):
        taken.append([[0.01 * (first + i), 0.0, 0.0] for i in range(1000)])
    with pytest.raises(TrajectoryError, match="more than 60000 rows"):
        taken.append([[1e6, 0.0, 0.0]])
    assert taken.finish().duration == pytest.approx(0.01 * (MAX_ROWS - 1))


def test_slopes_are_those_of_parabolas() -> None:
    times = [0.0, 0.1, 0.4, 0.5, 1.0]
    positions = [[3 * t * t - t, 1.0] for t in times]
    found = slopes(times, positions)
    for t, (slope, flat) in list(zip(times, found, strict=True))[1:-1]:
        assert slope == pytest.approx(6 * t - 1)
        assert flat == 0.0
    assert found[0][0] == pytest.approx(-0.7)  # of the line at the end
    assert json.dumps(found)  # plain numbers
