"""Motion to a pose: felt on the way, and led to its goal from wherever the arm was taken."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.modes.contact_reactions import AfterQuiet, ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.pose_path import PosePath
from tests.ideal_arm import LIMITS, IdealArm, T, holding_arm

GOAL = np.array([0.7, -0.4])
FAR = AllowanceSettings(max_duration_s=20.0, max_excursion=3.0)


def go(arm: IdealArm, goal: np.ndarray = GOAL) -> list[str]:
    path = PosePath.planned("the way to there", arm.q.copy(), goal, 0.2, LIMITS, 1.0)
    return arm.controller.request(Event.START, "me", arm.time_s, path)


def under_way(**changes: object) -> IdealArm:
    """An arm on its way to GOAL for 1.5 s, not armed."""
    arm = holding_arm(**changes)
    assert go(arm) == []
    arm.run(1.5)
    assert arm.mode is Mode.TRACKING
    return arm


def test_it_ends_at_the_goal_and_holds_there() -> None:
    arm = under_way()
    arm.run_until(Mode.HOLDING)
    assert arm.cause == "the way to there came to its end"
    np.testing.assert_array_equal(arm.decisions[-1].reference, GOAL)
    assert arm.controller.machine.trajectory == "ready"
    assert arm.controller.next_place().path.name == "sinusoids"  # of the next `start`
    assert go(arm) == []
    arm.run_until(Mode.HOLDING)  # it stands there
    np.testing.assert_allclose(arm.q, GOAL, atol=1e-3)


def test_not_armed_a_contact_halts_it_and_start_goes_on_to_the_goal() -> None:
    arm = under_way()
    arm.touch(0.01)
    assert (arm.mode, arm.cause) == (Mode.STOPPING, "a feels it")
    arm.run_until(Mode.HOLDING, 1.0)
    assert arm.controller.machine.trajectory == "paused"
    arm.q = arm.q + np.array([0.0, 0.3])  # a person moves it meanwhile
    arm.run(0.5)
    assert arm.request(Event.START) == []
    arm.run_until(Mode.HOLDING)
    np.testing.assert_allclose(arm.q, GOAL, atol=5e-3)


def test_halted_on_the_way_to_a_limit_it_goes_on_from_nearer_to_that_limit() -> None:
    """Displaced as other trajectories are, the rest of the way would lead beyond."""
    arm, corner = holding_arm(), np.array([1.0, -1.0])
    assert go(arm, corner) == []
    arm.run(2.0)
    arm.touch(0.01)
    arm.run_until(Mode.HOLDING, 1.0)
    arm.q = arm.q + np.array([0.05, -0.3])
    arm.run(0.5)
    assert arm.request(Event.START) == []
    arm.run_until(Mode.HOLDING)
    np.testing.assert_allclose(arm.q, corner, atol=5e-3)


def test_armed_and_led_towards_its_limit_it_goes_on_to_the_goal_without_a_way_back() -> None:
    arm = holding_arm(bounds=FAR)
    assert go(arm, np.array([1.0, -1.0])) == []
    arm.run(2.0)
    assert arm.controller.arm("me") == []
    arm.run(1.0, **arm.push(0.8))
    assert arm.mode is Mode.ADMITTANCE
    while arm.mode is Mode.ADMITTANCE:
        arm.step()
    assert (arm.mode, arm.cause) == (Mode.TRACKING, "quiet for 2.00 s")


@pytest.mark.parametrize("armed", [False, True])
def test_a_contact_that_is_only_reported_halts_it_too(armed: bool) -> None:
    arm = under_way(reactions=Reactions(contact=ContactReaction.REPORT))
    if armed:
        assert arm.controller.arm("me") == []
    arm.touch()
    assert arm.mode is Mode.STOPPING


def test_other_trajectories_go_on_through_a_contact_while_not_armed() -> None:
    arm = holding_arm()
    assert arm.request(Event.START) == []
    arm.run(1.0)
    arm.touch()
    assert arm.mode is Mode.TRACKING


@pytest.mark.parametrize("after", [AfterQuiet.RESUME, AfterQuiet.RETURN])
def test_armed_it_is_led_and_goes_on_to_the_goal(after: AfterQuiet) -> None:
    arm = under_way(bounds=FAR, after_quiet=after)
    assert arm.controller.arm("me") == []
    arm.run(1.0, **arm.push(-0.8))
    assert arm.mode is Mode.ADMITTANCE
    arm.run_until(Mode.TRACKING)
    arm.run_until(Mode.HOLDING)
    np.testing.assert_allclose(arm.q, GOAL, atol=5e-3)
    assert arm.armed


def test_paused_it_goes_on_and_stopped_it_is_forgotten() -> None:
    arm = under_way()
    arm.request(Event.PAUSE)
    arm.run_until(Mode.HOLDING)
    assert arm.request(Event.START) == []
    assert arm.cause.startswith("start of the way to there")
    arm.run(0.5)
    arm.request(Event.STOP)
    arm.run_until(Mode.HOLDING)
    assert arm.request(Event.START) == []
    assert arm.cause == "start of sinusoids by me"


def test_go_is_refused_during_a_contact() -> None:
    arm = holding_arm()
    arm.touch()
    assert go(arm) == ["a feels it: free it first"]
    arm.run(0.1)
    assert go(arm) == []


def test_led_a_little_beyond_a_limit_it_still_goes() -> None:
    arm = holding_arm(limits=replace(LIMITS, tolerance=0.05))
    arm.q = np.array([1.004, -0.2])
    arm.step()
    assert go(arm) == []
    arm.run_until(Mode.HOLDING)
    np.testing.assert_allclose(arm.q, GOAL, atol=5e-3)


def test_no_setpoint_exceeds_the_acceleration() -> None:
    arm = under_way()
    arm.run_until(Mode.HOLDING)
    velocities = np.array([decision.velocity for decision in arm.decisions])
    assert (np.abs(np.diff(velocities, axis=0)) <= LIMITS.acceleration * T + 1e-12).all()
