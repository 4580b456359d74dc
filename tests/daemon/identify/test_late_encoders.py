"""What is said of link encoders that are late."""

import numpy as np
import pytest

from daemon.identify.steps import late_encoders


@pytest.mark.parametrize(
    ("late", "says"),
    [
        ([0.0, 0.0005], ()),
        ([0.0, 0.0049], ("elbow by 4.9 ms",)),
        ([0.002, 0.0049], ("shoulder by 2.0 ms", "elbow by 4.9 ms")),
    ],
)
def test_who_is_late_is_told_with_what_to_set(late, says) -> None:
    notes = late_encoders(("shoulder", "elbow"), np.array(late))
    assert len(notes) == bool(says)
    assert all(name in notes[0] for name in (*says, *(("link_position_delay_ms",) if says else ())))
