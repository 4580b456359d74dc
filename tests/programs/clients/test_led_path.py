"""The way of a lead: no rests at its ends, no tremor, few samples; loops and pauses stay."""

import numpy as np
import pytest

from daemon.motion.trajectory_file import slopes
from programs.clients.led_path import OFF_RAD, SMOOTHS_S, led_path

STEP_S = 0.05


def recorded(tremor: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Rest of 2 s, a loop of 6 s, a pause of 3 s, back on half of it, rest of 2 s."""
    t = np.arange(0.0, 17.0, STEP_S)
    angle = np.interp(t, [2.0, 8.0, 11.0, 15.0], [0.0, 2.0 * np.pi, 2.0 * np.pi, np.pi])
    way = np.array([0.3 * np.cos(angle), 0.2 * np.sin(angle)]).T
    return t, way + tremor * np.sin(2.0 * np.pi * 6.0 * t)[:, np.newaxis]


def played(times: list[float], positions: list[list[float]], at: np.ndarray) -> np.ndarray:
    """The daemon's path through the samples: cubic pieces through them."""
    t, q = np.array(times), np.array(positions)
    v = np.array(slopes(times, positions))
    i = np.clip(np.searchsorted(t, at, "right") - 1, 0, len(t) - 2)
    h = (t[i + 1] - t[i])[:, np.newaxis]
    u = ((at - t[i])[:, np.newaxis]) / h
    r = 3 * u**2 - 2 * u**3
    ends = (u**3 - 2 * u**2 + u) * v[i] + (u**3 - u**2) * v[i + 1]
    return np.asarray(q[i] + r * (q[i + 1] - q[i]) + h * ends)


@pytest.mark.parametrize("tremor", [0.0, 0.004])
def test_loops_and_pauses_stay_and_rests_and_tremor_go(tremor: float) -> None:
    t, q = recorded(tremor)
    times, positions = led_path(t.tolist(), q.tolist())
    assert times[0] == 0.0
    assert len(times) < len(t) / 4
    assert 13.0 <= times[-1] <= 13.0 + SMOOTHS_S  # the rests are gone
    clean = recorded()[1]
    at = np.arange(0.0, times[-1], 0.01)
    way = played(times, positions, at)
    assert np.ptp(way, axis=0) == pytest.approx(np.ptp(clean, axis=0), abs=0.02)
    still = np.abs(np.diff(way, axis=0)).max(axis=1) < 1e-4
    assert 2.4 < 0.01 * still.sum() < 3.4  # the pause
    turned = np.unwrap(np.arctan2(way[:, 1] / 0.2, way[:, 0] / 0.3))
    assert turned.max() == pytest.approx(2.0 * np.pi, abs=0.05)  # the whole loop
    assert turned[-1] == pytest.approx(np.pi, abs=0.05)


def test_the_kept_path_stays_near_the_led_one() -> None:
    t, q = recorded()
    times, positions = led_path(t.tolist(), q.tolist())
    shift = np.abs(np.array(t)[:, None] - 2.0).argmin() * STEP_S
    at = np.arange(1.0, times[-1] - 1.0, STEP_S)
    angle = np.interp(at + shift, [2.0, 8.0, 11.0, 15.0], [0.0, 2 * np.pi, 2 * np.pi, np.pi])
    true = np.array([0.3 * np.cos(angle), 0.2 * np.sin(angle)]).T
    assert np.abs(played(times, positions, at) - true).max() < 0.02 + OFF_RAD


def test_a_path_without_motion_is_empty() -> None:
    t = np.arange(0.0, 5.0, STEP_S).tolist()
    assert led_path(t, [[0.001 * np.sin(s), 0.5] for s in t]) == ([], [])
