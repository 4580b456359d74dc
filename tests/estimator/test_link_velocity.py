"""Link velocity and alignment: exact on parabolas, with the stated delay and noise."""

import numpy as np
import pytest

from estimator.link_velocity import ALIGNED, DELAY_PERIODS, Alignment, parabola

T = 0.01
METHODS = tuple(DELAY_PERIODS)


def alignment(method: str, **delays: float) -> Alignment:
    names = ("current_delay", "link_delay", "velocity_delay", "position_delay")
    values = {**dict.fromkeys(names, 0.0), **delays}
    return Alignment(2, method, T, **values)


@pytest.mark.parametrize("intervals", [(T, T), (2 * T, T), (0.7 * T, 1.2 * T)])
@pytest.mark.parametrize("delay", [0.0, 0.3 * T, 0.5 * T, T])
def test_exact_on_parabolas(intervals: tuple[float, float], delay: float) -> None:
    def position(t: float) -> np.ndarray:
        return np.array([1 + 2 * t - 3 * t * t, -0.5 + t + 40 * t * t])

    times = np.cumsum([0.0, -intervals[0], -intervals[1]])
    samples = np.array([position(t) for t in times])
    h, before = (np.full(2, interval) for interval in intervals)
    q, q_dot = (parabola(h, before, delay) * samples).sum(axis=1)
    np.testing.assert_allclose(q, position(-delay), rtol=1e-12)
    np.testing.assert_allclose(q_dot, [2 + 6 * delay, 1 - 80 * delay], rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_everything_belongs_to_one_instant(method: str) -> None:
    # Signals linear in time, each sampled late by its own delay: all come out at the same time.
    delays = {"velocity_delay": 0.0005, "position_delay": 0.0002}
    a = alignment(method, current_delay=0.003, link_delay=0.001, **delays)
    times = np.cumsum([0.01, 0.01, 0.02, 0.009])
    for t, dt in zip(times, np.diff(times, prepend=0.0), strict=True):
        late = np.array([t - 0.003, t - 0.0005, t - 0.0002, t - 0.001])
        a.push(np.repeat(late[:, None], 2, axis=1), np.full(2, dt))
    instant = times[-1] - a.delay
    aligned = np.zeros((len(ALIGNED), 2))
    a.aligned(out=aligned)
    expected = dict.fromkeys(ALIGNED, instant) | {"link_velocity": 1.0}
    for name, row in zip(ALIGNED, aligned, strict=True):
        np.testing.assert_allclose(row, expected[name], err_msg=name)
    assert a.delay == pytest.approx(DELAY_PERIODS[method] * T + 0.001)


@pytest.mark.parametrize(("method", "factor"), [("backward", 2.55), ("midpoint", 1.41),
                                                ("central", 0.71)])  # fmt: skip
def test_noise_is_as_stated(method: str, factor: float) -> None:
    rng = np.random.default_rng(0)
    a = alignment(method)
    velocities = []
    for _ in range(4000):
        a.push(rng.normal(size=(4, 2)), np.full(2, T))
        aligned = np.zeros((len(ALIGNED), 2))
        a.aligned(out=aligned)
        velocities.append(aligned[1])
    assert np.std(velocities[3:]) * T == pytest.approx(factor, rel=0.05)


def test_ready_after_three_samples() -> None:
    a = alignment("midpoint")
    ready = []
    for _ in range(4):
        ready.append(a.ready.tolist())
        a.push(np.zeros((4, 2)), np.array([T, T if len(ready) != 2 else 0.0]))
    assert ready == [[False, False]] * 3 + [[True, False]]
    a.restart(np.array([True, False]))
    assert a.ready.tolist() == [False, True]
