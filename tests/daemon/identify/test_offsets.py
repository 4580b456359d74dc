"""What is said of currents that are off all the time."""

import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot
from daemon.identify.steps import offsets


@pytest.mark.parametrize("share", [0.0, 0.005, 0.025, -0.025])
def test_who_is_off_is_told_in_amperes(share) -> None:
    c = load_robot(ROMEO).configuration
    by = np.zeros(len(c.joints))
    ampere = share * c.joints[2].wiring.max_current_A
    by[2] = ampere * c.joints[2].torque_constant
    notes = offsets(c, by)
    assert len(notes) == (abs(share) > 0.01)
    assert all(f"{c.joints[2].name} by {ampere:+.2f} A" in note for note in notes)
