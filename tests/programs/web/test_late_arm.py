"""A page whose machine is slow: the point of contact is sought in the last States alone."""

from pathlib import Path
from typing import Any

import pytest

from programs.web.arm import SOUGHT, Arm
from tests.fake_daemon import snapshot_at, state_at


@pytest.mark.parametrize("late", [1, 3, 300])
def test_the_point_is_computed_for_few_states_however_late_they_are(late: int) -> None:
    seen = list[int]()

    class Finder:
        def see(self, state: Any) -> None:
            seen.append(state.tick)

    greet: Any = None
    arm: Any = Arm(0, Path("x-view.sock"), greet)
    arm.snapshot, arm._finder, arm.audience = snapshot_at(99), Finder(), Audience()
    arm._publish([state_at(100 + k) for k in range(late)])
    assert seen == [100 + k for k in range(max(late - SOUGHT, 0), late)]
    assert arm.states == late


class Audience:
    """A browser."""

    def text(self, message: str) -> None:
        pass

    def frame(self, frame: bytes) -> None:
        pass
