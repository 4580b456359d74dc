"""What is said of currents that are off all the time, and of torque constants that may be off."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot
from daemon.identify.steps import off_scale, offsets
from estimator.identification.friction_verdict import Verdict


@pytest.mark.parametrize("share", [0.0, 0.005, 0.025, -0.025])
def test_who_is_off_is_told_in_amperes(share) -> None:
    c = load_robot(ROMEO).configuration
    by = np.zeros(len(c.joints))
    ampere = share * c.joints[2].wiring.max_current_A
    by[2] = ampere * c.joints[2].torque_constant
    notes = offsets(c, by)
    assert len(notes) == (abs(share) > 0.01)
    assert all(f"{c.joints[2].name} by {ampere:+.2f} A" in note for note in notes)


@pytest.mark.parametrize(
    ("scale", "verdict", "says"),
    [
        (1.0, Verdict.GOOD, None),
        (1.09, Verdict.GOOD, None),
        (float("nan"), Verdict.GOOD, None),
        (1.25, Verdict.GOOD, "masses are off: elbow by +25 %"),
        (0.85, Verdict.GOOD, "masses are off: elbow by -15 %"),
        (1.4, Verdict.WRONG_GRAVITY, None),  # its own reason says it
    ],
)
def test_gravity_that_does_not_fit_is_told(scale, verdict, says) -> None:
    fit = SimpleNamespace(joint="elbow", gravity_scale=scale, verdict=verdict)
    notes = off_scale([fit])
    assert len(notes) == (says is not None)
    assert all(says in note for note in notes)
