"""Notes on currents that are off all the time, and on late link encoders."""

import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot
from programs.identify.log_notes import late_encoders, offsets


@pytest.mark.parametrize("share", [0.0, 0.005, 0.025, -0.025])
def test_an_offset_is_given_in_amperes(share) -> None:
    c = load_robot(ROMEO).configuration
    by = np.zeros(len(c.joints))
    ampere = share * c.joints[2].wiring.max_current_A
    by[2] = ampere * c.joints[2].torque_constant
    notes = offsets(c, by)
    assert len(notes) == (abs(share) > 0.01)
    assert all(f"{c.joints[2].name} by {ampere:+.2f} A" in note for note in notes)


@pytest.mark.parametrize(
    ("late", "says"),
    [([0.0, 0.0005], ()), ([0.0, 0.0049], ("elbow by 4.9 ms",)),
     ([0.002, 0.0049], ("shoulder by 2.0 ms", "elbow by 4.9 ms"))],
)  # fmt: skip
def test_late_encoders_are_named_with_what_to_set(late, says) -> None:
    notes = late_encoders(("shoulder", "elbow"), np.array(late))
    assert len(notes) == bool(says)
    assert all(name in notes[0] for name in (*says, *(("link_position_delay_ms",) if says else ())))
