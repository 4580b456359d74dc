"""Counting of false contacts, and the population that makes them."""

import numpy as np
import pytest

from bench import false_contacts
from bench.false_contacts import PARTS, tally
from bench.rigs.arm_without_bus import Course, Recording, Scenario, record
from bench.rigs.lockstep import ROMEO
from bench.study import unseen, world
from bench.study.estimates import Estimates
from daemon.config.load import load_robot
from estimator.motor_position import Side
from tests.bench.reports import reported

TICKS, N = 300, 2
CONTACT = np.array([1.0, 0.5])


def recorded(load: float = 0.0) -> Recording:
    return Recording(
        time_s=0.01 * np.arange(1, TICKS + 1),
        samples=np.zeros((TICKS, 4, N)),
        phi=np.zeros((10 * TICKS, N)),
        gear_torque=np.full((10 * TICKS, N), load),
        external=np.zeros((10 * TICKS, N)),
        half_gap=np.full(N, 0.02),
        breakaway=np.zeros(N),
    )


def estimated(residual: np.ndarray, side: int = Side.LEFT) -> Estimates:
    return Estimates(
        residuals={"ours": residual, "theirs": 2.0 * residual},
        threshold=np.tile(CONTACT, (TICKS, 1)),
        side=np.full((TICKS, N), side, dtype=np.int8),
        delay_s=0.0,
    )


def test_stretches_beyond_the_threshold_count_by_residual_part_and_joint() -> None:
    residual, kinds = np.zeros((TICKS, N)), np.zeros(TICKS, dtype=np.int64)
    kinds[200:] = 2
    residual[50:60, 0] = 1.1  # before anybody could have armed it
    residual[150:160, 0] = 1.1
    residual[180:190, 1] = -0.3  # only for theirs
    residual[250:251, 1] = -0.6
    residual[260:270, 1] = 0.6
    found = tally(recorded(), estimated(residual), kinds, CONTACT)
    expected = np.zeros((2, len(PARTS), N))
    expected[:, 0, 0], expected[:, 2, 1], expected[1, 0, 1] = 1, 2, 1
    np.testing.assert_array_equal(found.alarms, expected)
    assert found.hours == pytest.approx(3.0 / 3600.0)


@pytest.mark.parametrize(
    ("load", "side", "expected"),
    [(0.3, Side.GAP, [0, TICKS]), (0.6, Side.GAP, [TICKS, TICKS]), (0.2, Side.GAP, [0, 0]),
     (0.6, Side.UNKNOWN, [0, 0])],
)  # fmt: skip
def test_gap_under_load(load: float, side: int, expected: list[int]) -> None:
    kinds = np.zeros(TICKS, dtype=np.int64)
    found = tally(recorded(load), estimated(np.zeros((TICKS, N)), side), kinds, CONTACT)
    assert found.gap_under_load.tolist() == expected


def test_arms_of_the_world_differ_in_what_no_one_knows() -> None:
    robot = load_robot(ROMEO)
    subjects = [world.subject(robot, "lugre", seed) for seed in range(200)]
    settings = [subject.settings for subject in subjects]
    for values, (low, high) in (
        ([s.presliding for s in settings], world.PRESLIDING),
        ([s.contact_stiffness for s in settings], world.STIFFNESS),
        ([s.stribeck for s in settings], world.STRIBECK),
    ):
        assert low <= min(values) < low * (high / low) ** 0.05
        assert high >= max(values) > high * (low / high) ** 0.05
    assert 0.2 < np.mean([not subject.interpolates for subject in subjects]) < 0.4
    smooth = world.subject(robot, "smooth", 7).settings
    assert (smooth.friction, smooth.stribeck) == ("smooth", 1.0)
    assert world.subject(robot, "dahl", 7).settings.presliding == smooth.presliding


@pytest.mark.parametrize("more", ["", "--unseen"])
def test_the_report_is_of_every_law_residual_and_arm(more: str) -> None:
    report = reported(false_contacts, f"--arms 1 --minutes 0.3 --jobs 1 {more}")
    changes = [f" {name}" for name in unseen.drawn(1)] if more else [""]
    assert set(report["data"]["laws"]) == set(world.LAWS)
    assert "classical" in report["data"]["residuals"]
    for whole in report["data"]["laws"].values():
        assert whole["hours"] == pytest.approx(len(changes) * 0.3 / 60)
        assert len(whole["threshold_in_motion"]) == 7
        shape = (len(report["data"]["residuals"]), len(PARTS), 7)
        assert np.array(whole["alarms"]).shape == shape
    assert set(report["data"]["by_arm"]) == {f"{law} 1{by}" for law in world.LAWS for by in changes}
    assert [target["limit"] for target in report["targets"]] == [2 if more else 0] * 3


def test_every_unseen_change_acts_on_the_arm() -> None:
    subject, still = world.subject(load_robot(ROMEO), "smooth", 1), np.full(7, 0.1)
    q = still + 0.2 * np.sin(np.arange(300) / 60.0)[:, None]
    course = Course(q, np.gradient(q, 0.01, axis=0))
    quiet = record(subject, Scenario(seconds=3.0, motion=course, begin_s=900.0)).samples
    for name, change in unseen.CHANGES.items():
        act = change(np.random.default_rng(1), still)
        acted = Scenario(seconds=3.0, motion=course, begin_s=900.0, act=act)
        assert np.abs(record(subject, acted).samples - quiet)[:, 0].max() > 0.01, name
