"""Verdict on drives by what the changes of their setpoints explain of B."""

from dataclasses import replace

import numpy as np
import pytest

from identification.friction import identify_friction
from identification.friction_fit import adopt
from identification.setpoint_steps import NO_SETPOINTS, OR_MASSES, STEPS, hidden, stepping


@pytest.mark.parametrize(
    ("more", "error", "steps"),
    [
        ([0.0] * 7, 0.01, []),
        ([0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.01, [0, 1, 2, 3]),  # those of its make
        ([0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.1, []),  # not clear
        ([0.045, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.01, []),  # not large
        ([0.045, 0.045, 0.045, 0.0, 0.0, 0.0, 0.0], 0.01, range(7)),  # a third: all are of a make
        ([0.045, 0.045, 0.0, 0.0, 0.0, 0.0, 0.0], 0.01, []),
        ([-0.2, -0.2, -0.2, 0.0, 0.0, 0.0, 0.0], 0.01, []),  # a fast loop that ramps shows that
        ([-0.2, -0.2, -0.2, -0.2, 0.0, 0.0, 0.0], 0.01, range(7)),  # just before the sample
        ([-0.1, 0.13], 0.026, [0, 1]),  # one of two, and of three, is a third
        ([-0.1, 0.06, 0.0], 0.015, [0, 1, 2]),
        ([-0.1, 0.045, 0.0], 0.01, []),
        ([0.2], 0.01, [0]),
        ([-0.2], 0.01, []),
        ([0.0], np.inf, []),  # B was not fitted
    ],
)
def test_who_steps(more, error, steps):
    found = stepping(np.array(more), np.full(len(more), error), list("aaaabbb")[: len(more)])
    assert np.flatnonzero(found).tolist() == list(steps)


@pytest.mark.parametrize(
    ("more", "shares"),
    [
        ([0.0], [0.01]),
        ([0.04], [0.0806]),
        ([-0.04], [0.01]),
        ([0.04, 0.0, -0.1, 0.0], [0.0806, 0.01, 0.01, 0.01]),  # chance, or another make
        ([0.04, -0.1], [0.0806, 0.0806]),  # one of few
        ([0.04, 0.02, -0.1, 0.0], [0.0806, 0.0412, 0.0412, 0.0412]),  # two show it
    ],
)
def test_what_may_be_hidden_is_stated(more, shares):
    found = hidden(np.array(more), np.full(len(more), 0.01))
    assert found == pytest.approx(shares, rel=1e-2)


def test_a_log_without_setpoints_leaves_the_rotor_alone(moved, arm):
    log = replace(moved.filtered[0].select(slice(0, 1400)), setpoint=None)
    known = replace(arm.transmission, half_gap=moved.arms[0].half_gap)
    settings = arm.configuration.estimator
    fits, _ = identify_friction(log, arm.model, known, settings, arm.max_current)
    assert [fit.rotor_doubt for fit in fits] == [NO_SETPOINTS] * len(fits)
    adopted = adopt(arm.transmission, fits)
    assert (adopted.rotor_inertia == arm.transmission.rotor_inertia).all()


@pytest.mark.parametrize("weighed", [True, False])
def test_masses_that_no_one_identified_may_look_like_steps(moved, arm, monkeypatch, weighed):
    monkeypatch.setattr(
        "identification.friction.stepping", lambda more, *_: np.arange(len(more)) > 0
    )
    monkeypatch.setattr(
        "identification.friction.rotors_of_whole_periods", lambda log, *_: np.full(log.n, np.nan)
    )
    log = moved.filtered[0].select(slice(0, 1400))
    known = replace(arm.transmission, half_gap=moved.arms[0].half_gap)
    settings, most = arm.configuration.estimator, arm.max_current
    fits, _ = identify_friction(log, arm.model, known, settings, most, weighed=weighed)
    for fit in fits[1:]:
        assert STEPS in fit.rotor_doubt
        assert (OR_MASSES in fit.rotor_doubt) is not weighed
