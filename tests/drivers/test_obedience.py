"""When a drive counts as one that does not stop."""

import pytest

from drivers.cia402 import DriveState, PowerTarget
from drivers.events import Disobedient, Unstoppable
from drivers.obedience import PATIENCE_S, PATIENCE_TICKS, ObedienceWatch

ON = DriveState.OPERATION_ENABLED
STOP, OFF = PowerTarget.QUICK_STOP, PowerTarget.OFF


def told(watch: ObedienceWatch, target: PowerTarget, period_s: float, ticks: int) -> list[object]:
    """(tick, event) of a drive that stays in operation; it is told in tick 0."""
    found = [(k, watch.check(ON, target, k * period_s)) for k in range(ticks)]
    return [(k, event) for k, event in found if event]


@pytest.mark.parametrize(
    ("target", "period_s", "after"),
    [
        (STOP, 0.00101, 50),
        (STOP, 0.0101, PATIENCE_TICKS),
        (STOP, 0.05, PATIENCE_TICKS),
        (STOP, 10.0, PATIENCE_TICKS),
        (OFF, 0.0101, 100),
    ],
)
def test_first_an_nmt_stop_then_silence(target: PowerTarget, period_s: float, after: int) -> None:
    found = told(ObedienceWatch(3), target, period_s, 3 * after + 3)
    again = 2 * after + 1
    assert found == [
        (after, Disobedient(3)),
        (again, Unstoppable(3)),
        (again + after + 1, Unstoppable(3)),
    ]


@pytest.mark.parametrize("state", set(DriveState) - {ON})
def test_a_drive_that_has_left_operation_obeys(state: DriveState) -> None:
    watch = ObedienceWatch(3)
    assert told(watch, STOP, 0.02, PATIENCE_TICKS) == []
    assert watch.check(state, STOP, 1.0) is None
    # What it does later is counted anew, from the NMT stop on.
    assert told(watch, STOP, 0.02, PATIENCE_TICKS + 1) == [(PATIENCE_TICKS, Disobedient(3))]
    assert watch.check(state, STOP, 1.0) is None
    assert told(watch, STOP, 0.02, PATIENCE_TICKS + 1) == [(PATIENCE_TICKS, Disobedient(3))]


def test_a_drive_that_is_to_run_obeys_by_running() -> None:
    watch = ObedienceWatch(3)
    assert told(watch, PowerTarget.ON, 0.02, 100) == []
    told(watch, STOP, 0.02, PATIENCE_TICKS)
    assert watch.check(ON, PowerTarget.ON, 1.0) is None
    assert told(watch, STOP, 0.02, PATIENCE_TICKS) == []


def test_the_bounds_are_those_of_the_documentation() -> None:
    assert ({STOP: 0.05, OFF: 1.0}, 5) == (PATIENCE_S, PATIENCE_TICKS)
