"""Half-gap by ramps of torque against a clamped link, real ones and simulated ones."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from identification.gap import identify_gap
from identification.gap_result import GapVerdict
from identification.motion_log import MotionLog
from identification.ramps import from_ramps

DATA = Path(os.environ.get("CONTACTD_DATA", Path(__file__).parents[3] / "shared" / "data"))


def clamped(name: str) -> tuple[MotionLog, float]:
    """Torque ramps of a cycloidal gear whose output is clamped: position is the motor's."""
    path = DATA / "cycloid" / f"{name}.csv.gz"
    if not path.exists():
        pytest.skip(f"no real measurements at {DATA} (set CONTACTD_DATA)")
    with gzip.open(path, "rt") as stream:
        rows = np.genfromtxt(stream, delimiter=",", names=True)
    rows = rows[rows["test_nr"] >= 100]
    t = np.linspace(rows["TIME"][0], rows["TIME"][-1], len(rows))  # quantised to 16 ms
    theta = 2 * np.pi * rows["POSITION"][:, None]
    current = rows["Q_CURRENT"][:, None]
    large = np.abs(current[:, 0]) > 1.0
    constant = float(np.median(rows["TORQUE"][large] / current[large, 0]))
    still = np.zeros_like(theta)
    return MotionLog(("j",), t, current, still, np.gradient(theta, t, axis=0), theta), constant


def clamped_with(name: str) -> tuple[MotionLog, int, float]:
    log, constant = clamped(name)
    return log, 0, constant


def test_real_torque_ramps_with_a_dead_zone():
    gap = identify_gap(*clamped_with("base_runin1"))
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.half_gap == pytest.approx(0.0325, rel=0.05)
    assert gap.stiffness == pytest.approx(1066, rel=0.1)
    assert gap.coulomb == pytest.approx(2.5, rel=0.1)
    assert abs(gap.half_gap - 0.0325) < gap.confidence < 0.006


@pytest.mark.parametrize("begin_s", [0.0, 6.0])
@pytest.mark.parametrize("every", [1, 17, 25])  # up to 60 ms
def test_real_torque_ramps_however_slowly_and_from_wherever_they_are_sampled(begin_s, every):
    def answer(name: str):
        log, constant = clamped(name)
        rows = slice(round(begin_s / log.period_s), None, every)
        return identify_gap(log.select(rows), 0, constant)

    gap = answer("base_runin1")
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.half_gap == pytest.approx(0.0325, abs=0.0015), gap
    preloaded = answer("split_3pre1")
    assert preloaded.verdict is GapVerdict.UNCLEAR, preloaded


def sharp_gap(alpha: float, period_s: float) -> tuple[np.ndarray, ...]:
    """Time, phi and torque of two ramps from rest to 20 Nm and back against a clamped link: gear of
    1000 Nm/rad, friction of 2 Nm, and a gap that the motor crosses within a sample."""
    t = np.arange(0.0, 40.0, period_s)
    torque = 20.0 * np.interp(t, [0, 5, 15, 25, 35, 40], [0, 1, -1, 1, -1, 0])
    bent = np.zeros_like(t)
    for k in range(1, len(t)):
        bent[k] = min(max(bent[k - 1], (torque[k] - 2.0) / 1000.0), (torque[k] + 2.0) / 1000.0)
    rng = np.random.default_rng(0)
    theta = bent + alpha * np.sign(bent) + 2e-5 * rng.standard_normal(len(t))
    return t, -theta, torque + 0.05 * rng.standard_normal(len(t))


@pytest.mark.parametrize("period_s", [0.01, 0.06])
def test_the_sharpest_gap_is_the_clearest(period_s):
    gap = from_ramps("j", *sharp_gap(0.02, period_s))
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.half_gap == pytest.approx(0.02, rel=0.02)
    assert gap.stiffness == pytest.approx(1000.0, rel=0.05)


def test_the_first_ramp_counts_from_its_end_on():
    t, phi, torque = sharp_gap(0.02, 0.01)
    from_rest = from_ramps("j", t, phi, torque)
    torque = np.where(t < 3.0, -torque, torque)  # whatever the friction was before
    assert from_ramps("j", t, phi, torque) == from_rest


def test_a_gap_that_velocities_do_not_show_is_not_called_none():
    """The motor crosses it between two samples of its velocity, or is caught on the way now and
    then: what is left is no gear without a gap."""
    t, phi, torque = sharp_gap(0.02, 0.03)
    velocity = -np.gradient(phi, t)
    fast = np.abs(velocity) > 0.1
    for shown in (0.0, 0.3):
        seen = np.where(fast, shown * velocity * (np.arange(len(t)) % 3 > 0), velocity)
        still = np.zeros((len(t), 1))
        gap = identify_gap(MotionLog(("j",), t, torque[:, None], still, seen[:, None]), 0, 1.0)
        assert gap.verdict is GapVerdict.UNCLEAR, gap
        assert "log its position" in gap.reason, gap


def test_a_gear_that_stiffens_with_its_load_is_in_the_interval_of_ramps():
    t, phi, torque = sharp_gap(0.02, 0.01)
    for hardens in (0.0, 0.5, 1.0):
        beyond = np.abs(phi) - 0.02
        bent = np.where(beyond > 0.0, beyond * (1.0 + hardens * np.exp(-beyond / 0.004)), beyond)
        gap = from_ramps("j", t, np.sign(phi) * (0.02 + bent), torque)
        assert gap.verdict is GapVerdict.CLEAR, gap
        assert abs(gap.half_gap - 0.02) < gap.confidence < 0.25 * 0.02, gap


def test_real_torque_ramps_of_preloaded_gears():
    """A refusal shows its figure, the limit that it broke, and why that may be."""
    gap = identify_gap(*clamped_with("split_3pre1"))
    assert gap.verdict is GapVerdict.UNCLEAR, gap
    assert np.isnan(gap.half_gap)
    assert 0.01 < gap.estimate < 0.03
    assert gap.limit is not None
    assert gap.limit.value > gap.limit.most
    assert "slope inside over slope outside" in gap.reason
    assert "preloaded" in gap.reason
