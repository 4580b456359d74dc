"""Samples of single joints that are missing: bridged, without blinding the others."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimator.estimate import Estimate, Flag
from tests.estimator.conftest import CONTACT, Recording
from tests.examples import scaled

T = 0.01
N = len(CONTACT)
SHOULDER, ELBOW, WRIST = 0, 2, 6
Fresh = Callable[[int], np.ndarray]


def of(joint: int, comes: Callable[[int], bool]) -> Fresh:
    """All samples come, those of one joint in some ticks only."""

    def fresh(k: int) -> np.ndarray:
        came = np.ones(N, dtype=bool)
        came[joint] = comes(k)
        return came

    return fresh


def of_all(comes: Callable[[int], bool]) -> Fresh:
    return lambda k: np.full(N, comes(k))


def at_random(share: float) -> Fresh:
    rng = np.random.default_rng(7)
    return lambda _: rng.random(N) >= share


def run(recording: Recording, estimator, fresh: Fresh, ticks: slice) -> list[Estimate]:
    rows = zip(recording.current, recording.q, recording.theta_dot, strict=True)
    return [estimator.step(*row, dt=T, fresh=fresh(k)) for k, row in enumerate([*rows][ticks])]


def residuals(estimates: list[Estimate]) -> np.ndarray:
    return np.array([estimate.residual for estimate in estimates])


LOSSES = [
    ("wrist 2 of 5", of(WRIST, lambda k: k % 5 > 1), 0.5),
    ("shoulder 2 of 5", of(SHOULDER, lambda k: k % 5 > 1), 0.3),
    ("elbow 3 of 4", of(ELBOW, lambda k: k % 4 == 0), 0.4),
    ("all 1 of 3", of_all(lambda k: k % 3 > 0), 0.8),
    ("all 2 of 3", of_all(lambda k: k % 3 == 0), 1.6),
    ("1 % of each", at_random(0.01), 0.5),
    ("5 % of each", at_random(0.05), 0.9),
]


@pytest.mark.parametrize(
    ("fresh", "most"), [loss[1:] for loss in LOSSES], ids=[x[0] for x in LOSSES]
)
def test_nothing_is_restarted_invented_or_lost(
    make_estimator, sine_motion, pushed_motion, fresh: Fresh, most: float
) -> None:
    """Deviations in contact levels, in motion at up to 1 rad/s through gaps of up to 25 mrad."""
    whole = residuals(sine_motion.replay(make_estimator(), slice(0, 1500)))
    holed = run(sine_motion, make_estimator(), fresh, slice(0, 1500))
    assert not any(Flag.RESTARTED in estimate.flags for estimate in holed)
    assert not any(estimate.contacts for estimate in holed[200:])
    deviation = np.abs(residuals(holed) - whole)[200:] / CONTACT
    assert deviation.max() < most

    pushed = residuals(run(pushed_motion, make_estimator(), fresh, slice(0, 900)))
    beyond = np.abs(pushed[800:]) > CONTACT
    assert beyond.any(axis=0).all(), "every joint, pushed by twice its level"
    assert beyond.argmax(axis=0).max() <= 8


def test_who_is_without_samples_for_long_senses_nothing_and_begins_anew_alone(
    make_estimator, pushed_motion
) -> None:
    whole = pushed_motion.replay(make_estimator(), slice(0, 1000))
    lost = range(880, 890)
    holed = run(pushed_motion, make_estimator(), of(ELBOW, lambda k: k not in lost), slice(0, 1000))
    others = np.arange(N) != ELBOW
    for k, estimate in enumerate(holed):
        assert estimate.sensing[others].all() == (k > 2)
        missing = 882 <= k < 893 or k < 3
        assert estimate.sensing[ELBOW] != missing, k
        assert (Flag.RESTARTED in estimate.flags) == (k == 890)
        assert (Flag.BRIDGED in estimate.flags) == (k in lost)
    np.testing.assert_array_equal(
        [e.residual[ELBOW] for e in holed[880:890]], holed[879].residual[ELBOW]
    )
    np.testing.assert_array_equal([e.residual[ELBOW] for e in holed[890:893]], 0.0)
    deviation = np.abs(residuals(holed) - residuals(whole)) / CONTACT
    assert deviation[880:][:, others].max() < 0.6
    assert deviation[-1].max() < 0.3


def test_what_is_bridged_goes_on_and_not_for_ever(make_estimator, sine_motion) -> None:
    estimator = make_estimator()
    before = sine_motion.replay(estimator, slice(0, 700))[-1]
    row = (sine_motion.current[700], sine_motion.q[700] + 1.0, sine_motion.theta_dot[700])
    for k in range(1, 12):
        estimate = estimator.step(*row, dt=T, fresh=np.zeros(N, dtype=bool))
        went = estimate.q - before.q
        np.testing.assert_allclose(went, before.q_dot * T * min(k, 5), atol=1e-12)
        np.testing.assert_array_equal(estimate.residual, before.residual)
        assert estimate.sensing.all() == (k <= 2)
    assert not estimate.contacts


def test_a_memory_within_a_gap_goes_on_the_same(make_estimator, sine_motion) -> None:
    fresh = at_random(0.3)
    masks = [fresh(k) for k in range(400)]
    first = make_estimator()
    run(sine_motion, first, lambda k: masks[k], slice(0, 300))
    second = make_estimator()
    second.restore(first.memory())
    for k in range(300, 400):
        row = (sine_motion.current[k], sine_motion.q[k], sine_motion.theta_dot[k])
        a, b = (e.step(*row, dt=T, fresh=masks[k]) for e in (first, second))
        for name in ("q", "q_dot", "theta", "tau_M", "residual", "threshold", "sensing"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_debounce_counts_samples_not_ticks(make_estimator, pushed_motion) -> None:
    estimator = make_estimator(debounce=3)
    begins = []
    for k in range(900):
        row = (pushed_motion.current[k], pushed_motion.q[k], pushed_motion.theta_dot[k])
        # Of the elbow every second sample comes: three of them take six ticks.
        fresh = np.ones(N, dtype=bool)
        fresh[ELBOW] = k % 2 == 0
        contacts = estimator.step(*row, dt=T, fresh=fresh).contacts
        begins += [k for c in contacts if c.joint == "LElbowRoll" and c.level == "contact"]
    assert begins
    assert all(k % 2 == 0 for k in begins)
    assert begins[0] >= 800 + 2 + 4


@settings(
    max_examples=scaled(15),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 1.0), burst=st.integers(1, 12))
def test_whatever_was_missing_is_over_when_samples_come(
    make_estimator, sine_motion, seed: int, share: float, burst: int
) -> None:
    rng = np.random.default_rng(seed)
    masks = np.repeat(rng.random((200, N)) >= share, burst, axis=0)[:200]
    whole = sine_motion.replay(make_estimator(), slice(0, 500))
    holed = run(
        sine_motion,
        make_estimator(),
        lambda k: masks[k - 200] if 200 <= k < 400 else np.ones(N, dtype=bool),
        slice(0, 500),
    )
    assert np.isfinite(residuals(holed)).all()
    assert holed[-1].flags == Flag(0)
    assert holed[-1].sensing.all()
    after = np.abs(residuals(holed) - residuals(whole))[-1] / CONTACT
    assert after.max() < 1.0
