"""Counts of the bench of the motor position, on stretches made by hand, and one short run."""

from dataclasses import replace

import numpy as np
import pytest

from bench.motor_position import Job, Tally, ratio, recall, rows_of, run, tally, targets, trend
from bench.rigs.arm_without_bus import Recording, Subject
from bench.rigs.lockstep import ROMEO
from bench.study.estimates import Estimates
from daemon.config.load import load_robot
from estimator.motor_position import Side

CONTACT = np.array([1.0])


def stretch(phi: list[float], gear: list[float]) -> Recording:
    """One joint, one millisecond per tick, half-gap 0.02 rad."""
    n = len(phi)
    return Recording(
        time_s=0.001 * np.arange(1, n + 1),
        samples=np.zeros((n, 4, 1)),
        phi=np.array(phi)[:, np.newaxis],
        gear_torque=np.array(gear)[:, np.newaxis],
        external=np.zeros((n, 1)),
        half_gap=np.array([0.02]),
        breakaway=np.zeros(1),
    )


def said(side: list[Side], phi: list[float], residual: float = 0.1) -> Estimates:
    n = len(side)
    return Estimates(
        residuals={"backlash": np.linspace(0.0, -residual, n)[:, np.newaxis]},
        threshold=np.ones((n, 1)),
        phi=np.array(phi)[:, np.newaxis],
        phi_sigma=np.full((n, 1), 0.001),
        side=np.array(side, dtype=np.int8)[:, np.newaxis],
        touched_link=np.full(n, -1),
        delay_s=0.0,
    )


@pytest.fixture
def counted() -> Tally:
    """In the gap three times, recognised twice; called gap under load once."""
    truth = stretch([0.0, 0.01, -0.01, 0.02, -0.021], [0.0, 0.0, 0.0, -0.4, 0.6])
    sides = [Side.GAP, Side.GAP, Side.UNKNOWN, Side.GAP, Side.GAP]
    estimate = said(sides, [0.0, 0.014, -0.01, 0.02, -0.019], residual=0.5)
    return tally(truth, estimate, said(sides, [0.0] * 5, residual=0.4), CONTACT)


def test_samples_are_counted_for_what_they_are(counted: Tally) -> None:
    expected = {
        "samples": 5, "in_gap": 3, "recognised": 2, "called_gap": 4, "false_gap": 1,
        "unknown": 1, "overconfident": 1, "largest_integrated": 0.5, "largest_exact": 0.4,
        "alarms": 0,
    }  # fmt: skip
    assert {name: getattr(counted, name)[0] for name in expected} == expected


def test_whatever_goes_beyond_its_threshold_is_a_false_alarm() -> None:
    truth = stretch([0.0] * 5, [0.0] * 5)
    quiet, loud = (said([Side.LEFT] * 5, [0.0] * 5, residual) for residual in (0.9, 1.3))
    assert tally(truth, loud, quiet, CONTACT).alarms.tolist() == [1]
    assert tally(truth, quiet, loud, CONTACT).alarms.tolist() == [0]


def test_tallies_add_up(counted: Tally) -> None:
    worse = replace(counted, largest_integrated=np.array([0.7]))
    both = counted + worse
    assert both.samples[0] == 10
    assert both.false_gap[0] == 2
    assert both.largest_integrated[0] == 0.7
    assert both.largest_exact[0] == 0.4
    assert len(both.errors) == 2 * len(counted.errors)


@pytest.mark.parametrize(
    ("largest", "expected"), [(0.5, 1.25), (0.31, 0.775), (0.3, 1.0), (0.01, 1.0)]
)
def test_a_residual_small_against_its_threshold_is_good_enough(
    counted: Tally, largest: float, expected: float
) -> None:
    changed = replace(counted, largest_integrated=np.array([largest]))
    assert ratio(changed, CONTACT)[0] == pytest.approx(expected)


def test_targets_are_those_of_the_project_and_the_worst_arm_counts(counted: Tally) -> None:
    c = load_robot(ROMEO).configuration

    def of(largest: list[float], recognised: int = 400, false: int = 0) -> Tally:
        n = np.ones(7, dtype=np.int64)
        return replace(
            counted,
            samples=10_000 * n,
            largest_integrated=np.array(largest),
            largest_exact=np.ones(7),
            in_gap=1000 * n,
            recognised=recognised * n,
            false_gap=false * n,
            errors=np.zeros((2, 7)),
        )

    # On the second arm the fourth joint is worse, but the first arm's residual was larger.
    other = replace(of([1.0] * 3 + [1.2] + [1.0] * 3), largest_exact=np.ones(7))
    first = replace(of([1.4] * 7), largest_exact=np.full(7, 1.3))
    found = {t.name: t for t in targets({"smooth": [first, other]}, c)}
    pooled, worst = (
        found.pop("largest |r|, integrated over exact theta, smooth"),
        found.pop("the same of the worst arm alone, smooth"),
    )
    assert (pooled.met, worst.met) == (True, False)
    assert (pooled.value, worst.value) == (pytest.approx(1.4 / 1.3), pytest.approx(1.2))
    for limit in (pooled.limit, worst.limit):
        assert limit == 1.15
    assert all(t.met for t in found.values())
    alarms, recognised, under_load = found.values()
    assert (alarms.limit, recognised.limit, under_load.limit) == (0, 40, 0.01)
    for wrong in (
        of([1.0] * 7, recognised=399),
        of([1.0] * 7, false=2),
        replace(first, alarms=np.array([0, 0, 1, 0, 0, 0, 0])),
    ):
        assert sum(not t.met for t in targets({"smooth": [wrong]}, c)) == 1


def test_sensors_are_as_wrong_as_is_said(monkeypatch) -> None:
    seen: list[Subject] = []

    def recordings(subject: Subject, *_: object) -> None:
        seen.append(subject)
        raise RuntimeError

    monkeypatch.setattr("bench.motor_position.recordings", recordings)
    with pytest.raises(RuntimeError):
        run(Job(ROMEO, "lugre", 8, 4.0))
    settings = seen[0].settings
    assert settings.link_latency_ms == 1.0
    assert abs(settings.velocity_scale_error) == 0.002
    assert abs(settings.velocity_bias) == 0.001
    assert settings.stribeck > 1.0


def test_only_wide_gaps_must_be_recognised(counted: Tally) -> None:
    assert recall(counted, np.array([0.010])) == pytest.approx(2 / 3)
    assert recall(counted, np.array([0.009])) == 0.0


def test_trend_is_the_slope_of_the_errors() -> None:
    time_s = 0.1 * np.arange(50)
    errors = np.stack([0.003 - 0.001 * time_s, np.zeros(50)], axis=1)
    assert trend(errors, 0.01) == pytest.approx([-0.001, 0.0], abs=1e-12)


def test_a_short_run_counts_every_sample() -> None:
    c = load_robot(ROMEO).configuration
    friction, found = run(Job(ROMEO, "smooth", 8, 4.0))
    assert friction == "smooth"
    assert found.samples.tolist() == [400] * 7
    assert (found.in_gap >= found.recognised).all()
    assert found.in_gap[[4, 5]].tolist() == [0, 0]  # joints without a gap
    assert (found.largest_exact > 0.0).all()
    assert set(rows_of(found, c)["phi off, p50 [mrad]"]) != {0.0}
