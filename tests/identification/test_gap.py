"""Half-gap by a hand; and logs that have none to give."""

import itertools
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.rigs.arm_batch import SoftHand, record_fleet
from identification.gap import identify_gap
from identification.gap_result import GapVerdict
from identification.motion_log import MotionLog
from identification.plateaus import from_plateaus
from simulator.description import SimulationSettings

DATA = Path(os.environ.get("CONTACTD_DATA", Path(__file__).parents[3] / "shared" / "data"))
T = 0.01


def visits(alpha: float, count: int, strain: float = 0.0, seed: int = 0) -> np.ndarray:
    """phi of a hand that rests `count` times at alternating borders, pushing now more, now less."""
    rng = np.random.default_rng(seed)
    sides = np.resize([1.0, -1.0], count) * (alpha + strain * rng.uniform(size=count))
    way = np.clip(np.arange(100) / 40.0, 0.0, 1.0)
    ends = np.concatenate([[0.0], sides])
    return np.concatenate([a + (b - a) * way for a, b in itertools.pairwise(ends)])


@pytest.mark.parametrize("measured", [True, False])
def test_a_hand_shows_every_gap_to_half_a_milliradian(handled, arm, measured):
    log, true = handled
    log = log if measured else replace(log, motor_position=None)
    for i in np.flatnonzero(true.half_gap > 0.0):
        gap = identify_gap(log, i, arm.transmission.torque_constant[i])
        assert gap.verdict is GapVerdict.CLEAR, gap
        assert gap.crossings >= 15
        assert gap.half_gap == pytest.approx(true.half_gap[i], abs=5e-4), gap


def test_a_rigid_joint_has_no_dead_zone(handled, arm):
    log, true = handled
    for i in np.flatnonzero(true.half_gap == 0.0):
        gap = identify_gap(log, i, 1.0)
        assert (gap.verdict, gap.half_gap) == (GapVerdict.NONE, 0.0), gap


def test_a_drifting_integral_changes_nothing():
    phi = visits(0.02, 24)
    t = T * np.arange(len(phi))
    drift = 0.0004 * t  # 10 mrad in the end
    gap = from_plateaus("j", t, phi, drift, 0.0004, -np.sign(phi) * (np.abs(phi) > 0.019))
    assert gap.half_gap == pytest.approx(0.02, abs=1e-4)


def test_what_no_scatter_of_plateaus_shows_is_in_the_interval():
    """An encoder of 4096 steps reads the same at each rest, and a gear that is pressed bends by as
    much each time; without a torque the ends are unknown."""
    phi = visits(0.01, 24)
    t, still = T * np.arange(len(phi)), np.zeros_like(phi)
    step = 2.0 * np.pi / 4096.0
    pressed = -np.sign(phi) * (np.abs(phi) > 0.95 * 0.01)
    coarse = step * np.round((phi + 0.0003) / step)
    soft = from_plateaus("j", t, coarse, still, 0.0, 0.01 * pressed)
    assert soft.verdict is GapVerdict.CLEAR, soft
    assert abs(soft.half_gap - 0.01) < soft.confidence
    assert 0.3 * step < soft.confidence < 0.5 * step
    for gives in (0.5e-3, 1e-3, 2e-3, 2.9e-3):  # [rad/Nm], down to 350 Nm/rad
        bent = phi + 2.0 * gives * np.sign(phi) * (np.abs(phi) > 0.95 * 0.01)
        hard = from_plateaus("j", t, bent, still, 0.0, 2.0 * pressed)
        assert hard.verdict is GapVerdict.CLEAR, hard
        assert abs(hard.half_gap - 0.01) < hard.confidence < 0.0065
    none = from_plateaus("j", t, phi, still, 0.0, still)
    assert none.verdict is GapVerdict.UNCLEAR, none
    assert none.estimate == pytest.approx(0.01)
    assert "the same throughout" in none.reason


def test_a_hand_that_is_hardly_felt_leaves_no_interval_beyond_what_a_soft_gear_bends():
    """0.16 Nm, with the noise of a current: the line through it ends anywhere."""
    alpha, load, rng = 0.0125, 0.16, np.random.default_rng(3)
    phi = visits(alpha, 24, strain=0.0002)
    t, still = T * np.arange(len(phi)), np.zeros_like(phi)
    border = np.clip((np.abs(phi) / alpha - 0.6) / 0.4, 0.0, 1.0)
    torque = -np.sign(phi) * load * border + rng.normal(0.0, 0.05, len(phi))
    gap = from_plateaus("j", t, phi, still, 0.0, torque)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert "of alpha the gear may have bent" in gap.reason
    assert abs(gap.half_gap - alpha) < gap.confidence < 0.0025, gap


def test_a_motor_that_answers_late_shows_no_stiff_gear():
    """Its friction holds at first what a hand presses by; its controller takes that over while the
    link rests, and the torque rises where nothing bends any more."""
    alpha, gives = 0.01, 0.001
    phi = visits(alpha + gives, 24)
    late = np.resize(np.clip((np.arange(100) - 30.0) / 60.0, 0.0, 1.0), len(phi))
    phi = phi + 1e-4 * np.sign(phi) * late
    torque = -1.5 * np.sign(phi) * late
    gap = from_plateaus("j", T * np.arange(len(phi)), phi, np.zeros_like(phi), 0.0, torque)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert abs(gap.half_gap - alpha) < gap.confidence < 0.3 * alpha, gap
    assert np.isnan(gap.compliance)


def test_a_motor_whose_friction_drifts_hides_no_border():
    """It takes a press over late, and what it holds beside sinks from ten times that in 10 s."""
    phi = visits(0.006, 40)
    t = T * np.arange(len(phi))
    press = -0.05 * np.sign(phi) * (np.abs(phi) > 0.0055)
    late = lfilter([0.1], [1.0, -0.9], press) + 0.5 * np.exp(-t / 10.0)
    gap = from_plateaus("j", t, phi, np.zeros_like(phi), 0.0, late)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert "did the link touch" not in gap.reason


@pytest.mark.parametrize("gives", [0.002, 0.006])
def test_a_motor_that_gives_way_to_a_hand_makes_no_strokes(gives):
    """It gives way at one slow speed and comes back at it, as strokes of a motor are."""
    phi = visits(0.02, 24)
    there = np.interp(np.arange(100), [40, 60, 80], [0.0, 1.0, 0.0])
    theta = gives * np.repeat(np.resize([1.0, -1.0], 24), 100) * np.tile(there, 24)
    log = replace(of(phi + theta, theta), current=-np.sign(phi)[:, None])
    gap = identify_gap(log, 0, 1.0, by_hand=True)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.half_gap == pytest.approx(0.02, abs=2e-4)
    assert "`--by-hand`" in identify_gap(log, 0, 1.0).reason


@pytest.mark.parametrize("measured", [True, False])
def test_a_second_sitting_adds_to_the_first_wherever_the_motor_stands_by_then(measured):
    """Neither alone has crossings enough; between them motor and zeros moved, and a hand leaned on
    the same border at the end of the one and at the beginning of the other."""
    first, second = visits(0.02, 11), visits(0.02, 12)[50:]
    phi = np.concatenate([first, second])
    after = np.arange(len(phi)) >= len(first)
    t = T * np.arange(len(phi)) + 10.0 * after
    theta = 0.3 * after + 0.001 * np.random.default_rng(0).standard_normal(len(phi)) * T
    velocity = np.full((len(phi), 1), 0.001)
    log = MotionLog(
        ("j",),
        t,
        np.sign(-phi)[:, None],
        (1.1 * theta + phi)[:, None],
        velocity,
        theta[:, None] if measured else None,
    )
    assert identify_gap(log.select(slice(0, len(first))), 0, 1.0).verdict is GapVerdict.FEW
    gap = identify_gap(log, 0, 1.0)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.crossings == 21
    assert gap.half_gap == pytest.approx(0.02, abs=2e-4)


def test_missing_samples_begin_no_sitting():
    phi = visits(0.02, 24)
    there = np.arange(len(phi)) % 60 >= 5
    still = np.zeros((int(there.sum()), 1))
    t = T * np.flatnonzero(there)
    log = MotionLog(("j",), t, np.sign(-phi[there])[:, None], phi[there][:, None], still, still)
    gap = identify_gap(log, 0, 1.0)
    assert gap.verdict is GapVerdict.CLEAR, gap
    assert gap.half_gap == pytest.approx(0.02, abs=2e-4)


@pytest.mark.parametrize(
    ("phi", "mean_velocity", "verdict"),
    [
        (visits(0.02, 12), 0.0, GapVerdict.FEW),
        (visits(0.002, 40, strain=0.02), 0.0, GapVerdict.UNCLEAR),
        (visits(0.02, 30), 0.05, GapVerdict.MOTOR_MOVED),
        (visits(0.02, 30), -0.05, GapVerdict.MOTOR_MOVED),
        (visits(0.0005, 30), 0.0, GapVerdict.NONE),
        (visits(0.0006, 40, strain=0.0007), 0.0, GapVerdict.NONE),  # not rigid, but hardly a gap
    ],
)
def test_what_cannot_be_decided_is_not_answered(phi, mean_velocity, verdict):
    t, still = T * np.arange(len(phi)), np.zeros_like(phi)
    gap = from_plateaus("j", t, phi, still, mean_velocity, -np.sign(phi))
    assert gap.verdict is verdict, gap
    assert gap.usable == (verdict is GapVerdict.NONE)


@pytest.mark.parametrize("phi", [visits(0.0005, 30), visits(0.0006, 40, strain=0.0007)])
@pytest.mark.parametrize(
    ("torque", "verdict"),
    [
        (lambda up: -up, GapVerdict.NONE),
        (lambda up: 0.5 - up, GapVerdict.NONE),  # half of it is the link's weight
        (lambda up: 1.5 - up, GapVerdict.ONE_BORDER),  # more than it was pressed by
        (lambda up: -up - 1.0, GapVerdict.ONE_BORDER),  # pressed and released
        (lambda up: np.random.default_rng(1).normal(0.0, 0.01, len(up)), GapVerdict.ONE_BORDER),
        (np.zeros_like, GapVerdict.UNCLEAR),
    ],
)
def test_no_dead_zone_takes_a_hand_that_pressed_both_ways(phi, torque, verdict):
    """Pressed to and fro at one border of its gap, a link moves as a rigid one does."""
    t, still = T * np.arange(len(phi)), np.zeros_like(phi)
    gap = from_plateaus("j", t, phi, still, 0.0, torque(np.sign(phi)))
    assert gap.verdict is verdict, gap
    assert np.isfinite(gap.half_gap) == (verdict is GapVerdict.NONE)
    assert np.isnan(gap.estimate)
    assert ("pressed to one side only" in gap.reason) == (verdict is GapVerdict.ONE_BORDER)


def test_a_hand_that_stops_short_of_a_border_is_reported(arm, nominal):
    """It stops as exactly as at a border, but the motor feels little or nothing there."""
    settings = SimulationSettings(velocity_bias=0.001)
    q0 = np.array([joint.initial_position for joint in arm.description.joints])
    hand = StoppingHand([nominal] * 3, q0, arm.model.gravity(q0), settings.step_s)
    still = (q0, np.zeros_like(q0))
    logs = record_fleet(
        arm.description, [nominal] * 3, lambda t: still, 17.0, settings, push=hand, motors_only=True
    )[0]
    refused = 0
    for log, ends in zip(logs, ("upper|lower", "upper", "lower"), strict=True):
        for i in np.flatnonzero(nominal.half_gap > 0.0):
            gap = identify_gap(log, i, arm.transmission.torque_constant[i])
            refused += gap.verdict is GapVerdict.UNCLEAR
            assert re.search(f"did the link touch the ({ends}) border", gap.reason), gap
    assert refused >= 8, refused  # of fifteen


def test_a_gear_that_bends_under_the_hand_is_distinguished_from_its_gap(arm, nominal):
    """Gears of 1000 Nm/rad, pressed with 3.5 Nm by a hand that is not gentle."""
    settings = SimulationSettings(velocity_bias=0.001, friction="dahl", presliding=0.001)
    arms = [replace(nominal, half_gap=np.full(7, alpha)) for alpha in (0.007, 0.02)]
    q0 = np.array([joint.initial_position for joint in arm.description.joints])
    hand = PressingHand(arms, q0, arm.model.gravity(q0), settings.step_s)
    still = (q0, np.zeros_like(q0))
    logs = record_fleet(
        arm.description, arms, lambda t: still, 20.0, settings, push=hand, motors_only=True
    )[0]
    for log, true in zip(logs, arms, strict=True):
        for i in (0, 1):  # the shoulder, whose motors withstand it
            gap = identify_gap(log, i, arm.transmission.torque_constant[i])
            assert gap.verdict is GapVerdict.CLEAR, gap
            assert gap.half_gap == pytest.approx(true.half_gap[i], abs=5e-4), gap
            assert abs(gap.half_gap - true.half_gap[i]) < gap.confidence < 1e-3, gap
            assert 1.0 / gap.compliance == pytest.approx(true.stiffness[i], rel=0.15)
            assert "the gear bends by" in gap.reason


class PressingHand(SoftHand):
    """Leads every link to and fro within 1 s, the shoulder with 3.5 Nm and more."""

    def __call__(self, t, q, q_dot):
        visit, phase = divmod(t, 1.0)
        strong = np.arange(len(q)) % 7 < 2
        strength = np.where(strong, 3.5, self._strongest) * (1.0 + 0.25 * np.sin(1.7 * visit))
        way = min(phase / 0.15 - 1.0, 1.0) * (1.0 if int(visit) % 2 == 0 else -1.0)
        pull = 60.0 * strength * (self._q0 + way * (self._half_gap + 0.03) - q)
        return self._gravity + np.clip(pull, -strength, strength) - self._damping * q_dot


class StoppingHand(SoftHand):
    """On the way to a border that it does not reach it stops at 0.6 of the half-gap: with the first
    arm on both sides, with the second only upwards, with the third only downwards."""

    _short = np.repeat([[True, True], [False, True], [True, False]], 7, axis=0)

    def __call__(self, t, q, q_dot):
        visit, phase = divmod(t, 0.9)
        upwards = int(visit) % 2 == 0
        short = self._short[:, int(upwards)]
        end = np.where(short, 0.6 * self._half_gap, self._half_gap + 0.008)
        lead = min(phase / 0.25 - 1.0, 1.0) * (1.0 if upwards else -1.0)
        spring = 100.0 * self._strongest * (self._q0 + lead * end - q)
        spring = np.clip(spring, -self._strongest, self._strongest)
        return self._gravity + spring - self._damping * q_dot


def of(q: np.ndarray, theta: np.ndarray) -> MotionLog:
    column = theta[:, None]
    t = T * np.arange(len(q))
    velocity = np.gradient(column, T, axis=0)
    return MotionLog(("j",), t, np.zeros_like(column), q[:, None], velocity, column)


@pytest.mark.parametrize(
    ("q", "theta", "verdict"),
    [(visits(0.3, 20), visits(0.3, 20), GapVerdict.NO_LINK_ENCODER),
     (np.zeros(500), np.zeros(500), GapVerdict.NO_MOTION),
     (visits(0.06, 20), visits(0.03, 20), GapVerdict.MOTOR_MOVED)],
)  # fmt: skip
def test_says_which_encoder_is_to_blame(q, theta, verdict):
    assert identify_gap(of(q, theta), 0, 1.0).verdict is verdict


@pytest.mark.parametrize(
    ("phi", "verdict"),
    [(visits(0.0015, 60), GapVerdict.CLEAR), (np.zeros(10000), GapVerdict.NO_MOTION)],
)
def test_the_noise_of_a_velocity_adds_up_to_no_motion(phi, verdict):
    """Velocity of a motor that stands, whose noise adds up to more than the gap."""
    log = of(phi, np.zeros_like(phi))
    noise = np.random.default_rng(2).normal(0.0, 0.004, log.motor_velocity.shape)
    pressed = -np.sign(phi) * (np.abs(phi) > 0.0014)
    log = replace(log, motor_velocity=noise, motor_position=None, current=0.2 * pressed[:, None])
    found = identify_gap(log, 0, 1.0, by_hand=True)
    assert found.verdict is verdict, found
    assert not found.usable or abs(found.half_gap - 0.0015) < found.confidence, found


def columns(name: str) -> np.ndarray:
    """Positions in a file of the TX40, at 100 Hz, (N, 6)."""
    path = DATA / "tx40" / f"{name}.csv.gz"
    if not path.exists():
        pytest.skip(f"no real measurements at {DATA} (set CONTACTD_DATA)")
    return np.loadtxt(path, delimiter=",", skiprows=1)[::50]


def test_a_real_arm_with_one_position_per_joint_has_no_link_encoder():
    q, current = np.radians(columns("pos_read_data")), columns("curr_data")
    joints = tuple(f"joint_{i}" for i in range(1, 7))
    log = MotionLog(joints, T * np.arange(len(q)), current, q, np.gradient(q, T, axis=0), q)
    for i in range(6):
        gap = identify_gap(log, i, 1.0)
        assert gap.verdict is GapVerdict.NO_LINK_ENCODER, gap
        assert not gap.usable
