"""Joints that swing by themselves: distinguished from what was commanded, and from what fades."""

from dataclasses import replace

import numpy as np
import pytest

from identification.limit_cycle import limit_cycles
from identification.motion_log import MotionLog

T = 0.01
TIMES = T * np.arange(2000)


def log_of(*velocities: np.ndarray) -> MotionLog:
    """Log of joints a, b, ... whose motors move like this."""
    w = np.stack(velocities, axis=1)
    names = tuple("abcdefg"[: w.shape[1]])
    return MotionLog(names, TIMES, np.zeros_like(w), T * np.cumsum(w, axis=0), w)


def swing(hertz: float, amplitude: float) -> np.ndarray:
    """Velocity of a motor that swings so far [rad]."""
    w = 2.0 * np.pi * hertz
    return amplitude * w * np.cos(w * TIMES)


def noise(size: float) -> np.ndarray:
    return size * np.random.default_rng(1).standard_normal(len(TIMES))


@pytest.mark.parametrize("hertz", [2.1, 2.5, 6.3, 12.0])
def test_a_swing_has_its_frequency_amplitude_and_length(hertz: float) -> None:
    asked = swing(0.4, 0.3)
    motion = asked + noise(0.001)
    reference = log_of(asked, asked).link_position
    assert limit_cycles(log_of(motion, motion), reference) == []
    (found,) = limit_cycles(log_of(motion, motion + swing(hertz, 0.01)), reference)
    assert found.joint == "b"
    assert found.frequency_Hz == pytest.approx(hertz, abs=0.05)
    assert found.amplitude == pytest.approx(0.01, rel=0.1)
    assert found.lasted_s == pytest.approx(20.0)


def test_who_swings_furthest_comes_first() -> None:
    cycles = limit_cycles(log_of(swing(2.0, 0.002), swing(2.0, 0.02), noise(0.001)))
    assert [one.joint for one in cycles] == ["b", "a"]


NO_CYCLE = {
    "noise": noise(0.02),
    "too small to matter": swing(2.5, 0.0005),
    "what fades after a reversal": swing(5.0, 0.02) * np.exp(-2.0 * (TIMES % 2.5)),
    "a moment's shaking": swing(2.5, 0.02) * (TIMES < 2.0),
    "another frequency each second": np.concatenate(
        [swing(f, 0.02)[:100] for f in (1.3, 2.9, 1.9, 4.7, 1.1, 3.7) * 4]
    )[: len(TIMES)],
    "twice as fast as an excitation": swing(1.5, 0.1),
    "a reference that jumps": 0.3 * np.sign(np.sin(0.75 * TIMES)),
}


@pytest.mark.parametrize("velocity", NO_CYCLE.values(), ids=NO_CYCLE)
def test_what_is_no_cycle(velocity: np.ndarray) -> None:
    assert limit_cycles(log_of(velocity)) == []


def test_what_was_commanded_is_no_cycle() -> None:
    """Log with a known reference; a log of another controller does not have it."""
    log = log_of(swing(2.2, 0.1))
    assert limit_cycles(log, log.link_position) == []
    assert len(limit_cycles(log)) == 1


def test_a_swing_meets_both_borders_of_its_gap() -> None:
    """Ringing at one border, as after each reversal of an excitation, is none."""
    log = log_of(swing(2.2, 0.01))
    stands = replace(log, link_position=np.zeros_like(log.link_position))
    assert len(limit_cycles(stands, half_gap=np.array([0.01]))) == 1
    assert limit_cycles(stands, half_gap=np.array([0.02])) == []
    assert len(limit_cycles(stands, half_gap=np.zeros(1))) == 1  # its gap is unknown
    for half_gap in (0.01, 0.0):  # the link goes along
        assert limit_cycles(log, half_gap=np.array([half_gap])) == []


def test_nothing_swings_in_an_excitation(moved, sticking) -> None:
    """On simulated arms whose loops are quiet, whatever friction and gears do at a reversal."""
    for log in (*moved.filtered, *moved.unfiltered, sticking[0]):
        assert limit_cycles(log) == []


def test_heavy_links_on_soft_gears_swing(wound_up) -> None:
    cycles = limit_cycles(wound_up[0])
    assert cycles[0].joint == "LWristPitch"
    assert all(one.frequency_Hz == pytest.approx(2.7, abs=0.1) for one in cycles)
