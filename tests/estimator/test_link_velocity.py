"""Link velocity and alignment: exact on parabolas, with the stated delay and noise."""

import numpy as np
import pytest

from estimator.link_velocity import DELAY_PERIODS, Alignment
from estimator.settings import EstimatorSettings

T = 0.01
METHODS = tuple(DELAY_PERIODS)
ALIGNED = ("link_position", "link_velocity", "current", "motor_velocity", "motor_position")
NO_DELAY = {"current_delay_ms": 0.0}


def alignment(method: str, **delays_ms: float) -> Alignment:
    return Alignment(2, EstimatorSettings(link_velocity=method, **NO_DELAY | delays_ms), T)


def push(a: Alignment, samples: np.ndarray, *intervals: float) -> None:
    np.asarray(a.samples)[:] = samples
    for i, dt in enumerate(intervals):
        a.push(i, dt)


def aligned(a: Alignment) -> np.ndarray:
    for i in range(2):
        a.align(i)
    return np.array(a.aligned)


@pytest.mark.parametrize("intervals", [(T, T), (2 * T, T), (0.7 * T, 1.2 * T)])
@pytest.mark.parametrize("method", METHODS[:3])
def test_exact_on_parabolas(intervals: tuple[float, float], method: str) -> None:
    def position(t: float) -> np.ndarray:
        return np.array([1 + 2 * t - 3 * t * t, -0.5 + t + 40 * t * t])

    a = alignment(method)
    times = np.cumsum([0.0, -intervals[0], -intervals[1]])[::-1]
    for t, dt in zip(times, (T, *intervals[::-1]), strict=True):
        push(a, np.tile(position(t), (4, 1)), dt, dt)
    q, q_dot = aligned(a)[:2]
    delay = DELAY_PERIODS[method] * T
    np.testing.assert_allclose(q, position(-delay), rtol=1e-12)
    np.testing.assert_allclose(q_dot, [2 + 6 * delay, 1 - 80 * delay], rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_everything_belongs_to_one_instant(method: str) -> None:
    # Signals linear in time, each sampled late by its own delay: all come out at the same time.
    delays = {"motor_velocity_delay_ms": 0.5, "motor_position_delay_ms": 0.2}
    a = alignment(method, current_delay_ms=3.0, link_position_delay_ms=1.0, **delays)
    times = np.cumsum([0.01, 0.01, 0.02, 0.009])
    for t, dt in zip(times, np.diff(times, prepend=0.0), strict=True):
        late = np.array([t - 0.003, t - 0.0005, t - 0.0002, t - 0.001])
        push(a, np.repeat(late[:, None], 2, axis=1), dt, dt)
    instant = times[-1] - a.delay_s
    slope = instant if method == "motor" else 1.0
    expected = dict.fromkeys(ALIGNED, instant) | {"link_velocity": slope}
    for name, row in zip(ALIGNED, aligned(a), strict=True):
        np.testing.assert_allclose(row, expected[name], err_msg=name)
    assert a.delay_s == pytest.approx(DELAY_PERIODS[method] * T + 0.001)


@pytest.mark.parametrize(
    ("method", "factor"),
    [("backward", 2.55), ("midpoint", 1.41), ("central", 0.71), ("motor", 0.71 * T)],
)
def test_noise_is_as_stated(method: str, factor: float) -> None:
    rng = np.random.default_rng(0)
    a = alignment(method)
    velocities = []
    for _ in range(4000):
        push(a, rng.normal(size=(4, 2)), T, T)
        velocities.append(aligned(a)[1])
    assert np.std(velocities[3:]) * T == pytest.approx(factor, rel=0.05)


def test_before_the_first_sample_the_link_moved_with_its_motor() -> None:
    a = alignment("central")
    push(a, np.array([[0.5, 0.5], [0.2, -0.2], [3.0, 3.0], [1.0, 1.0]]), 5 * T, 5 * T)
    np.testing.assert_allclose(aligned(a)[:, 1], [1.002, -0.2, 0.5, -0.2, 3.002])
    assert a.count[1] == 1


def test_without_a_sample_a_joint_goes_on() -> None:
    a = alignment("backward")
    push(a, np.array([[0.5, 0.5], [0.2, 0.2], [3.0, 3.0], [1.0, 1.0]]), T, T)
    before = aligned(a)
    a.carry(0, 0.1)
    np.testing.assert_allclose(
        np.array(a.aligned)[:, 0] - before[:, 0], [0.02, 0.0, 0.0, 0.0, 0.02], atol=1e-12
    )
    np.testing.assert_array_equal(np.array(a.aligned)[:, 1], before[:, 1])


def test_restart_forgets_one_joint() -> None:
    a = alignment("midpoint")
    for _ in range(4):
        push(a, np.ones((4, 2)), T, T)
    assert list(a.count) == [3, 3]
    a.restart(0)
    assert list(a.count) == [0, 3]
    assert not np.array(a.history)[..., 0].any()
    assert not np.array(a.aligned)[:, 0].any()
