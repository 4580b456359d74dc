"""A trajectory goes on after a contact only where no shape is in its way, and an arm that holds has
no reference inside a wall."""

import numpy as np
import pytest

from daemon.modes.contact_reactions import AfterQuiet, ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from estimator.clearance import Clearance
from estimator.shapes import Plane
from estimator.walls import Walls
from tests.daemon.motion.test_walls import ACCELERATION, links_of
from tests.ideal_arm import IdealArm, holding_arm, tracking_arm

HIGH, LOW = 0.9, 0.79
"""heights of a ceiling [m] that is out of reach, and one that the swing meets from further up"""


def below(ceiling: float) -> Walls:
    bodies, links = links_of()
    plane = Plane("ceiling", np.array([0, 0, -1.0]), -ceiling)
    clearance = Clearance(bodies[:2], links[:2], [(link, plane) for link in links[:2]])
    return Walls(clearance, ACCELERATION[:2], 0.025, 0.005)


def led(arm: IdealArm) -> float:
    """Lead joint a up, and let go of it; returns how long it is quiet before the arm leaves."""
    arm.touch(0.5)
    assert arm.mode is Mode.ADMITTANCE
    arm.run(1.0, **arm.push(0.5))
    begun = arm.tick
    while arm.mode is Mode.ADMITTANCE:
        arm.step()
    return 0.01 * (arm.tick - begun)


@pytest.mark.parametrize(
    ("ceiling", "mode"), [(None, Mode.TRACKING), (HIGH, Mode.TRACKING), (LOW, Mode.HOLDING)]
)
def test_it_goes_on_only_if_its_way_is_clear(ceiling: float | None, mode: Mode) -> None:
    walls = None if ceiling is None else below(ceiling)
    arm = tracking_arm(walls=walls)
    quiet = led(arm)
    assert arm.mode is mode
    assert ("leads link 1 through ceiling" in arm.cause) is (mode is Mode.HOLDING)
    assert quiet < (2.05 if walls is None else 2.2)  # not all of it between two ticks


@pytest.mark.parametrize(("ceiling", "mode"), [(HIGH, Mode.TRACKING), (0.6, Mode.STOPPING)])
def test_a_way_back_ends_where_the_trajectory_would_lead_through(ceiling, mode) -> None:
    arm = tracking_arm(walls=below(HIGH), after_quiet=AfterQuiet.RETURN)
    led(arm)
    assert arm.mode is Mode.RETURNING
    arm.controller.motion.walls = below(ceiling)
    arm.run_until(mode)
    assert ("through ceiling" in arm.cause) is (mode is Mode.STOPPING)


def test_an_arm_that_holds_has_no_reference_inside_a_wall() -> None:
    arm = holding_arm(walls=below(LOW))
    motion = arm.controller.motion
    beyond, clear = (arm.q + np.array([away, 0.0]) for away in (0.6, 0.2))
    motion.hold(clear)
    arm.run(2.0)
    np.testing.assert_allclose(arm.q, clear, atol=1e-3)
    motion.hold(beyond)
    arm.run(4.0)
    assert not motion.walls.touch(motion.reference)
    motion.walls = None  # as if the ceiling were gone
    stood = arm.q.copy()
    arm.run(2.0)
    np.testing.assert_allclose(arm.q, stood, atol=1e-3)


def test_a_finger_below_a_ceiling_stops_the_gap_from_closing() -> None:
    """Led up to 15 mm below the ceiling, joint a yields to a finger there at once. A hand that
    pushes it up on that gets no further than the margin."""
    arm = tracking_arm(walls=below(LOW))
    walls = arm.controller.motion.walls

    def gap() -> float:
        walls.clearance.at(arm.q)
        return float(np.min(walls.clearance.gap))

    while gap() > 0.015:
        arm.step(**arm.push(0.4))
    caught = gap()
    arm.touch(-0.4)
    assert arm.mode is Mode.ADMITTANCE
    arm.run(0.3, **arm.push(-0.4))
    assert gap() > caught + 0.005
    for _ in range(200):
        arm.step(**arm.push(0.6))
        assert gap() > 0.0045
    assert arm.mode is Mode.ADMITTANCE
    assert gap() < 0.006


def test_the_path_is_checked_again_after_a_stop() -> None:
    """Stopped as it looked along a way that is clear, it backs away later for longer than the quiet
    time, below a ceiling that the rest of the trajectory meets."""
    both = Reactions(ContactReaction.ADMITTANCE, ContactReaction.RETRACT)
    arm = tracking_arm(walls=below(2.0), quiet_s=0.2, reactions=both)
    arm.touch(0.5)
    arm.run(0.25)
    assert arm.mode is Mode.ADMITTANCE  # it looks
    assert arm.request(Event.STOP) == []
    arm.run_until(Mode.HOLDING)
    assert arm.request(Event.START) == []
    arm.controller.motion.walls = below(0.85)
    arm.run(0.1)
    assert arm.controller.arm("me") == []
    arm.hit(-0.4)
    assert arm.mode is Mode.RETRACTING
    while arm.mode is Mode.RETRACTING:
        arm.step()
    assert arm.mode is Mode.HOLDING
