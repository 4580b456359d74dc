"""Samples that are late, missing or not finite, through the whole chain."""

import numpy as np
import pytest

from common.errors import ModelError
from estimator.estimate import Flag
from estimator.settings import Variant

T = 0.01
BESIDE = (
    Variant(kind="classical", friction=False, rotor_inertia=False),
    Variant(kind="two_mass"),
    Variant(rotor_inertia=False),
)


def residuals(estimates: list) -> np.ndarray:
    return np.array([estimate.residual for estimate in estimates])


def test_started_in_motion_nothing_jumps(make_estimator, sine_motion) -> None:
    for start in range(400, 1200, 37):
        estimates = sine_motion.replay(make_estimator(), slice(start, start + 60))
        first = residuals(estimates[:4])
        assert np.all(first[:3] == 0.0)
        assert not any(estimate.thresholded.any() for estimate in estimates)


def test_a_missed_tick_uses_the_true_interval(make_estimator, sine_motion) -> None:
    whole, holed, lied_to = make_estimator(), make_estimator(), make_estimator()
    missed = range(700, 900, 7)
    results = []
    for k in range(1000):
        row = (sine_motion.current[k], sine_motion.q[k], sine_motion.theta_dot[k], None)
        everything = whole.step(*row, T)
        if k not in missed:
            late = k - 1 in missed
            estimate = holed.step(*row, 2 * T if late else T)
            wrong = lied_to.step(*row, T)
            assert (Flag.LATE in estimate.flags) == late
            assert Flag.RESTARTED not in estimate.flags
            results.append((everything.residual, estimate.residual, wrong.residual))
    everything, estimate, wrong = np.array(results[650:]).transpose(1, 0, 2)
    error, lie = np.abs(estimate - everything).max(), np.abs(wrong - everything).max()
    assert error < 0.18
    assert lie > 5 * error


@pytest.mark.parametrize(
    ("periods", "restarts"),
    [(2.0, False), (2.4, False), (3.0, False), (4.0, False), (5.4, False), (5.6, True)],
)
def test_a_gap_of_some_samples_costs_nothing(
    make_estimator, pushed_motion, periods: float, restarts: bool
) -> None:
    estimator = make_estimator()
    before = pushed_motion.replay(estimator, slice(0, 900))[-1]
    k = 899 + round(periods)
    row = (pushed_motion.current[k], pushed_motion.q[k], pushed_motion.theta_dot[k], None)
    estimate = estimator.step(*row, periods * T)
    assert (Flag.RESTARTED in estimate.flags) == restarts
    kept = np.abs(estimate.residual - before.residual).max() < 0.2
    assert kept != restarts


def test_where_five_samples_are_missing_it_starts_anew(make_estimator, pushed_motion) -> None:
    estimator = make_estimator()
    before = pushed_motion.replay(estimator, slice(0, 900))[-1]
    assert np.any(before.residual > 0.2)
    row = (pushed_motion.current[905], pushed_motion.q[905], pushed_motion.theta_dot[905], None)
    estimate = estimator.step(*row, 6 * T)
    assert estimate.flags == Flag.LATE | Flag.RESTARTED | Flag.STARTING
    np.testing.assert_array_equal(estimate.residual, 0.0)
    after = pushed_motion.replay(estimator, slice(906, 962))
    assert [bool(e.flags) for e in after[:4]] == [True, True, False, False]
    external = pushed_motion.true_external[-1]
    assert np.all(np.abs(after[-1].residual - external) < 0.5 * external)


def test_reset_makes_no_transient(make_estimator, sine_motion) -> None:
    estimator = make_estimator()
    sine_motion.replay(estimator, slice(0, 700))
    estimator.reset()
    after = sine_motion.replay(estimator, slice(700, 1000))
    assert not after[0].flags
    untouched = sine_motion.replay(make_estimator(), slice(0, 1000))[700:]
    reach = np.abs(residuals(untouched)).max(axis=0)
    assert np.all(np.abs(residuals(after)) <= reach + 0.1)
    np.testing.assert_allclose(residuals(after[-1:]), residuals(untouched[-1:]), atol=1e-9)


# Bad samples


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("signal", [0, 1, 2, 3])
def test_what_is_not_a_number_never_gets_in(make_estimator, sine_motion, bad, signal) -> None:
    estimator = make_estimator(motor_position="measured")
    before = sine_motion.replay(estimator, slice(0, 300))[-1]
    memory = estimator.memory()
    row = [sine_motion.current[300], sine_motion.q[300], sine_motion.theta_dot[300],
           sine_motion.theta[300]]  # fmt: skip
    row[signal] = row[signal].copy()
    row[signal][4] = bad
    estimate = estimator.step(*row, T)
    assert estimate.flags == Flag.INVALID
    for name in ("residual", "q", "q_dot", "theta", "phi", "threshold", "thresholded"):
        np.testing.assert_array_equal(getattr(estimate, name), getattr(before, name))
    after = estimator.memory()
    # The interval of the lost samples is not lost.
    for field in ("since", "elapsed_s"):
        waited = np.array(after["kernel"].pop(field)) - memory["kernel"].pop(field)
        np.testing.assert_allclose(waited, T)
    assert after == memory
    assert Flag.LATE in sine_motion.replay(estimator, slice(301, 302))[0].flags


@pytest.mark.parametrize("huge", [1e200, -1e300])
def test_what_the_arithmetic_makes_no_number_of_never_gets_out(make_estimator, huge: float) -> None:
    samples = {
        "current": np.full(7, 0.1), "link_position": np.full(7, 0.3), "motor_velocity": np.zeros(7)
    }  # fmt: skip
    estimator = make_estimator(beside=BESIDE)
    for _ in range(20):
        before = estimator.step(**samples)
    assert np.abs(before.residual).max() > 0.1
    wrong = samples["link_position"].copy()
    wrong[2] = huge
    with np.errstate(all="ignore"):
        estimate = estimator.step(**{**samples, "link_position": wrong})
    assert estimate.flags == Flag.INVALID
    for field in (
        "q",
        "q_dot",
        "theta",
        "phi",
        "phi_sigma",
        "residual",
        "threshold",
        "thresholded",
    ):
        np.testing.assert_array_equal(getattr(estimate, field), getattr(before, field))
    # What it remembers is fit to be read back, and it starts anew.
    make_estimator(beside=BESIDE).restore(estimator.memory())
    flags = [estimator.step(**samples).flags for _ in range(5)]
    assert flags == [Flag.STARTING] * 3 + [Flag(0)] * 2
    assert np.isfinite(estimator.step(**samples).residual).all()


@pytest.mark.parametrize("dt", [0.0, -0.01, np.nan, np.inf])
def test_an_interval_that_is_none(make_estimator, sine_motion, dt: float) -> None:
    estimator = make_estimator()
    row = (sine_motion.current[0], sine_motion.q[0], sine_motion.theta_dot[0], None)
    assert estimator.step(*row, dt).flags == Flag.INVALID


def test_a_motor_position_that_is_missing(make_estimator, sine_motion) -> None:
    estimator = make_estimator(motor_position="measured")
    row = (sine_motion.current[0], sine_motion.q[0], sine_motion.theta_dot[0], None)
    assert estimator.step(*row, T).flags == Flag.INVALID


@pytest.mark.parametrize("shape", [(), (1,), (6,), (8,), (7, 1), (1, 7)])
@pytest.mark.parametrize("name", ["current", "link_position", "motor_velocity", "motor_position"])
def test_wrong_shapes_are_refused_by_name(make_estimator, name: str, shape: tuple) -> None:
    estimator = make_estimator(motor_position="measured")
    names = ("current", "link_position", "motor_velocity", "motor_position")
    samples = {each: np.zeros(7) for each in names} | {name: np.zeros(shape)}
    with pytest.raises(ModelError, match=f"^{name} is .*it must be an array of shape \\(7,\\)"):
        estimator.step(**samples)
    with pytest.raises(ModelError, match=f"^{name} is float"):
        estimator.step(**{**samples, name: 0.5})
    assert estimator.step(**{**samples, name: np.zeros(7)}).flags == Flag.STARTING
