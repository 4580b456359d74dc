"""Half-gap, skew and errors of the encoders in motion of motor and link."""

from dataclasses import replace

import numpy as np
import pytest

from identification.gap import identify_gap
from identification.gap_in_motion import from_motion
from identification.gap_result import GapVerdict
from identification.motion_log import MotionLog


def two_encoders(skew_s: float, alpha: float, seconds: float = 60.0) -> tuple[np.ndarray, ...]:
    """Both encoders of a joint with friction, moved at speeds that vary; the link's is late."""
    fine = np.arange(0.0, seconds, 0.001)
    theta = 0.5 * np.sin(2 * np.pi * 0.21 * fine) + 0.2 * np.sin(2 * np.pi * 0.47 * fine)
    q = np.empty_like(theta)
    q[0] = theta[0]
    for k in range(1, len(q)):
        q[k] = min(max(q[k - 1], theta[k] - alpha), theta[k] + alpha)
    late = np.interp(fine - skew_s, fine, q)
    rng = np.random.default_rng(0)
    rows = slice(None, None, 10)
    noise = 2e-5 * rng.standard_normal((2, len(fine[rows])))
    return fine[rows], late[rows] + noise[0], theta[rows] + noise[1]


def test_motion_shows_gap_and_skew_apart():
    alpha, skew = 0.004, 0.003
    t, q, theta = two_encoders(skew, alpha)
    gap = from_motion("j", t, q, theta, np.gradient(theta, t))
    assert gap.skew_s == pytest.approx(skew, abs=3e-4)
    assert gap.half_gap == pytest.approx(alpha, rel=0.05)
    # Taken for phi as it is, the skew would look like a gap.
    assert np.percentile(np.abs(q - theta), 95) > 1.3 * alpha


@pytest.mark.parametrize("gives", [0.0003, 0.0012, 0.002])
def test_what_a_gear_bends_in_motion_is_in_the_interval(gives):
    """Friction of 1 Nm at the link and 1 Nm at the motor: phi rests that much beyond its gap, each
    time the same, and scatters by nothing."""
    alpha = 0.01
    t, q, theta = two_encoders(0.0, alpha)
    way = np.sign(np.gradient(theta, t))
    at_border = np.clip((theta - q) / alpha, -1.0, 1.0)
    q = q - gives * at_border
    current = at_border + way
    velocity = np.gradient(theta, t)
    log = MotionLog(("j",), t, *(x[:, None] for x in (current, q, velocity, theta)))
    gap = identify_gap(log, 0, 1.0)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert abs(gap.half_gap - alpha) < gap.confidence < 0.3 * alpha, gap
    wrong = identify_gap(replace(log, current=1000.0 * log.current), 0, 1.0)  # mA
    assert wrong.verdict is GapVerdict.UNCLEAR, wrong
    assert "another unit" in wrong.reason


@pytest.mark.parametrize("turns", [40.0, 100.0, 160.0])
def test_errors_that_repeat_with_a_turn_are_reported_and_hide_no_gap(turns):
    alpha = 0.0015
    t, q, theta = two_encoders(0.001, alpha)
    off = 0.0005 * np.sin(turns * theta + 1.0) + 0.0003 * np.sin(2.0 * turns * theta)
    off += 0.0004 * np.cos(2.0 * q + 0.3)
    gap = from_motion("j", t, q + off, theta, np.gradient(theta, t), gear=turns)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.half_gap == pytest.approx(alpha, rel=0.02)
    found = {(one.encoder, one.order): one.amplitude for one in gap.harmonics}
    assert found["motor", 1] == pytest.approx(0.0005, rel=0.1)
    assert found["motor", 2] == pytest.approx(0.0003, rel=0.1)
    assert {encoder for encoder, _ in found} == {"motor"}  # half a turn of the link shows none
    assert all(one.interval < 0.3 * one.amplitude for one in gap.harmonics)
    # Without the gear's ratio the motor's turns are not known: refused, with figure and cause.
    blind = from_motion("j", t, q + off, theta, np.gradient(theta, t))
    assert blind.verdict is GapVerdict.UNCLEAR
    assert blind.estimate == pytest.approx(alpha, rel=0.1)
    assert blind.limit is not None
    assert "scatter of phi" in blind.reason


@pytest.mark.parametrize(
    ("alpha", "gives"), [(0.0022, 0.0), (0.0016, 0.0011), (0.0022, 0.0011), (0.0022, 0.0028)]
)
def test_an_eccentric_encoder_of_an_elastic_gear_hides_no_gap(alpha, gives):
    """Its map repeats with the position, and oftener than twice a turn; the load differs."""
    t, q, theta = two_encoders(0.001, alpha)
    map_ = 0.0008 * np.cos(3.0 * q + 0.3) + 0.0006 * np.sin(5.0 * q) + 0.0003 * np.cos(11.0 * q)
    border = np.clip((theta - q) / alpha, -1.0, 1.0)
    load = border * (0.4 + 0.2 * np.sin(1.7 * t))
    off = map_ - gives * load
    torque = load + 0.4 * np.sign(np.gradient(theta, t))
    gap = from_motion("j", t, q + off, theta, np.gradient(theta, t), torque=torque)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert abs(gap.half_gap - alpha) < gap.confidence < 0.6 * alpha, gap


@pytest.mark.parametrize("unit", [1e-3, 0.0])
def test_a_torque_that_no_gear_carries_so_little_of_gives_no_narrow_interval(unit):
    t, q, theta = two_encoders(0.0, 0.0038)
    border = np.clip((theta - q) / 0.0038, -1.0, 1.0)
    torque = unit * (border + np.sign(np.gradient(theta, t)))
    gap = from_motion("j", t, q + 0.0007 * border, theta, np.gradient(theta, t), torque=torque)
    assert gap.verdict is GapVerdict.UNCLEAR, gap
    assert gap.limit.name == "least torque of a gear over the measured one"
    assert np.isfinite(gap.estimate)


@pytest.mark.parametrize("measured", [True, False])
def test_an_encoder_that_was_not_read_is_not_accused(measured):
    turns = 100.0
    t, q, theta = two_encoders(0.0, 0.0015)
    off = 0.0005 * np.sin(turns * theta + 1.0)
    columns = (np.zeros_like(t), q + off, np.gradient(theta, t))
    position = theta[:, None] if measured else None
    log = MotionLog(("j",), t, *(one[:, None] for one in columns), position)
    assert (
        "motor" in {one.encoder for one in identify_gap(log, 0, 1.0, turns).harmonics}
    ) is measured


def test_good_encoders_are_not_accused():
    t, q, theta = two_encoders(0.0, 0.004)
    assert from_motion("j", t, q, theta, np.gradient(theta, t), gear=100.0).harmonics == ()


def test_a_border_that_is_only_passed_by_is_none():
    """Slow samples of a joint that rests at one border, and leaves it for a moment now and then: no
    way through the gap ends twice at the same place, however well the other border shows."""
    t, q, theta = two_encoders(0.0, 0.0)
    away = np.zeros_like(t)
    for k, depth in enumerate(np.random.default_rng(0).uniform(0.002, 0.008, 40)):
        away[100 + 140 * k : 115 + 140 * k] = depth
    gap = from_motion("j", t, q - away, theta, np.gradient(theta, t))
    assert gap.verdict is GapVerdict.UNCLEAR, gap
    assert gap.limit.name == "scatter of phi at the borders"


@pytest.mark.parametrize("measured", [True, False])
def test_a_part_at_one_border_after_a_pause_moves_no_zero(measured):
    """The middle of its phi is no middle of the gap; without the motor's position it is left."""
    t, q, theta = two_encoders(0.0, 0.004)
    phi = np.clip(q - theta, -0.004, 0.004)
    phi[3000:] = 0.004
    columns = (-0.2 * np.sign(phi), theta + phi, np.gradient(theta, t))
    position = theta[:, None] if measured else None
    log = MotionLog(("j",), t + 2.0 * (t > 30.0), *(x[:, None] for x in columns), position)
    gap = identify_gap(log, 0, 1.0)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert abs(gap.half_gap - 0.004) < min(gap.confidence, 0.001), gap


def test_a_velocity_of_the_same_encoder_is_asked_about():
    t, q, _ = two_encoders(0.0, 0.004)
    columns = (np.sign(q), q, np.gradient(q, t))
    gap = identify_gap(MotionLog(("j",), t, *(x[:, None] for x in columns)), 0, 1.0)
    assert gap.verdict is GapVerdict.UNCLEAR, gap
    assert "as of one encoder" in gap.reason


def test_borders_that_wander_in_motion_are_none():
    t, q, theta = two_encoders(0.0, 0.004)
    wander = 0.003 * np.sin(2 * np.pi * 0.05 * t)
    gap = from_motion("j", t, q + wander, theta, np.gradient(theta, t))
    assert gap.verdict is GapVerdict.UNCLEAR, gap
    assert np.isnan(gap.half_gap)


def test_one_border_is_no_proof_of_no_gap():
    t, q, theta = two_encoders(0.0, 0.0)
    gap = from_motion("j", t, q + 0.02, theta, np.gradient(theta, t))
    assert gap.verdict is GapVerdict.UNCLEAR
    assert not gap.usable
