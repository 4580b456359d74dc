"""Letting go of what the arm collided with: when it begins, how it ends, and what it leaves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.modes.contact_reactions import ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from daemon.motion.hand_witness import IndependentResidual
from tests.ideal_arm import LIMITS, MANNER, IdealArm, T, holding_arm, tracking_arm

M, R = Mode, ContactReaction
SPEED, DISTANCE = MANNER.release.velocity, MANNER.release.distance
HOLDS = (Finding(Condition.OVERRUN, figures="30 ms"),)


def tracking(*, armed: bool = False, **changes: Any) -> IdealArm:
    arm = tracking_arm(**changes)
    if not armed:
        arm.request(Event.DISARM)
    return arm


def released(arm: IdealArm, torque: float = 2.0, seconds: float = 0.3) -> IdealArm:
    """Hit, and pressed for a while."""
    arm.hit(torque)
    assert arm.mode is M.RELEASING
    arm.run(seconds, **arm.press(torque))
    assert arm.mode is M.RELEASING
    return arm


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("armed", [False, True])
def test_it_gives_way_slowly_as_long_as_it_is_pressed(armed: bool, sign: float) -> None:
    arm = tracking(armed=armed)
    start, begun = arm.q.copy(), len(arm.decisions)
    released(arm, sign * 2.0, 0.5)
    arm.step()
    assert (arm.mode, arm.cause) == (M.STOPPING, f"let go of contact at a ({2.0 * sign:+.1f} Nm)")
    arm.run_until(M.HOLDING, 0.3)
    assert sign * (arm.q - start)[0] == pytest.approx(0.5 * SPEED, abs=0.06)
    assert abs(arm.q - start)[1] < 1e-3
    velocity = np.array([decision.velocity for decision in arm.decisions[begun:]])
    assert (sign * velocity[:, 0] <= SPEED + 1e-9).all()
    assert (np.abs(np.diff(velocity, axis=0)) <= LIMITS.acceleration * T + 1e-9).all()
    assert arm.armed is armed
    assert arm.controller.machine.trajectory == "paused"
    assert arm.request(Event.START) == []


def test_pressed_for_ever_it_ends_at_its_distance_and_is_disarmed() -> None:
    arm = tracking(armed=True)
    start = arm.q[0]
    arm.hit(2.0)
    arm.run_until(M.HOLDING, 4.0, **arm.press(2.0))
    assert arm.cause == "still pressed with +2.0 Nm at a after giving way by 0.29 rad"
    assert DISTANCE - 0.02 < arm.q[0] - start <= DISTANCE
    assert not arm.armed


def test_pressed_against_its_limit_it_stays_where_it_is() -> None:
    arm = holding_arm()
    arm.q[0] = 0.995
    arm.request(Event.STOP)
    arm.run_until(M.HOLDING)
    arm.run(1.0, **arm.press(2.0))
    assert arm.mode is M.HOLDING


@pytest.mark.parametrize("felt", [(-0.2, 0.0), (2.0, 0.2), (2.0, -0.2)])
def test_a_person_on_the_other_side_stops_it(felt: tuple[float, float]) -> None:
    arm = released(tracking(armed=True))
    where = arm.q.copy()
    arm.run_until(M.STOPPING, 0.05, thresholded=np.array(felt), touched="b feels it")
    arm.run_until(M.HOLDING, 0.3)
    assert np.abs(arm.q - where).max() < SPEED * 0.05 + SPEED**2 / 4.0


def test_between_two_obstacles_it_lets_go_once() -> None:
    arm = released(tracking())
    arm.run(0.03, **arm.press(-2.0))
    assert arm.mode is M.STOPPING
    arm.hit(-2.0)  # while it stops, and as long as it lasts
    arm.run(1.0, **arm.press(-2.0))
    assert arm.mode is M.HOLDING
    assert arm.request(Event.START) == ["a was hit: free it first"]
    arm.run(0.5, **arm.push(-0.2))  # below the collision level: not yet
    arm.run(0.5, **arm.press(-2.0))
    assert arm.mode is M.HOLDING
    arm.run(0.1)
    arm.step(**arm.press(-2.0))
    assert arm.mode is M.RELEASING


@pytest.mark.parametrize(
    ("event", "mode"),
    [
        (Event.STOP, M.STOPPING),
        (Event.DISABLE, M.STOPPING),
        (Event.DISARM, M.RELEASING),
        (Event.PAUSE, M.RELEASING),
    ],
)
def test_a_command_on_the_way(event: Event, mode: Mode) -> None:
    arm = released(tracking(armed=True))
    assert arm.request(event) == []
    assert arm.mode is mode


def test_stopped_by_a_person_it_does_not_begin_again() -> None:
    arm = released(tracking())
    arm.request(Event.STOP)
    arm.run(1.0, **arm.press(2.0))
    assert arm.mode is M.HOLDING


@pytest.mark.parametrize(
    ("condition", "mode"), [(Condition.OVERRUN, M.STOPPING), (Condition.DRIVE_FAULT, M.FAULTED)]
)
def test_a_finding_on_the_way(condition: Condition, mode: Mode) -> None:
    arm = released(tracking())
    arm.step(**arm.press(2.0), findings=(Finding(condition, "b"),))
    assert arm.mode is mode


def test_a_collision_that_lasts_while_it_holds_is_let_go_of() -> None:
    arm = holding_arm()
    arm.step(**arm.press(2.0))
    assert (arm.mode, arm.cause) == (M.RELEASING, "a was hit")


def test_a_collision_that_lasts_stops_a_trajectory() -> None:
    """One that began when nothing came of it."""
    arm = tracking(reactions=Reactions(collision=R.HOLD))
    arm.step(**arm.press(2.0))
    assert arm.mode is M.STOPPING
    arm.run(1.0, **arm.press(2.0))
    assert arm.mode is M.HOLDING
    assert arm.request(Event.START) == ["a was hit: free it first"]
    arm.step(**arm.push(1.0))
    assert arm.request(Event.START) == []


@pytest.mark.parametrize("seen", [{"sure": False}, {"findings": HOLDS}])
def test_a_collision_with_doubted_sensing_stops_the_arm(seen: dict[str, Any]) -> None:
    arm = tracking()
    arm.step(**arm.press(2.0), struck=True, **seen)
    assert arm.mode is M.STOPPING
    arm.run(0.5, **arm.press(2.0), **seen)
    assert arm.mode is M.HOLDING


def test_a_blow_stops_an_arm_whose_links_are_not_trusted() -> None:
    arm = tracking()
    arm.controller.motion.blind = True
    arm.step(**arm.press(2.0))
    assert arm.mode is M.TRACKING
    arm.hit(2.0)
    assert arm.mode is M.STOPPING
    arm.run(1.0, **arm.press(2.0))
    assert arm.mode is M.HOLDING


def test_while_the_sensing_is_doubted_it_stands_and_then_goes_on() -> None:
    arm = released(tracking())
    slows = (SPEED / LIMITS.acceleration[0]) + 2 * T
    arm.run(slows, **arm.press(2.0), sure=False)
    stood = arm.q.copy()
    arm.run(0.2, sure=False)  # as if nothing pressed any more
    assert arm.mode is M.RELEASING
    np.testing.assert_allclose(arm.q, stood, atol=1e-9)
    arm.run(0.2, **arm.press(2.0))
    assert arm.mode is M.RELEASING
    assert arm.q[0] > stood[0] + 0.5 * SPEED * 0.2


@pytest.mark.parametrize("by", ["sensing", "finding"])
def test_ended_for_a_doubt_it_begins_again_within_the_same_distance(by: str) -> None:
    arm = tracking()
    start = arm.q[0]
    released(arm)
    if by == "sensing":
        arm.run_until(M.STOPPING, 0.6, **arm.press(2.0), sure=False)
        assert arm.cause == "sensing was not reliable for 0.5 s while it let go"
    else:
        arm.step(**arm.press(2.0), findings=HOLDS)
    arm.run(0.5, **arm.press(2.0), sure=False)
    assert arm.mode is M.HOLDING
    arm.run_until(M.RELEASING, 0.02, **arm.press(2.0))
    arm.run_until(M.HOLDING, 4.0, **arm.press(2.0))
    assert "still pressed" in arm.cause
    assert DISTANCE - 0.02 < arm.q[0] - start <= DISTANCE
    arm.run(1.0, **arm.press(2.0))
    assert arm.mode is M.HOLDING, "once, where it ended at a bound"


def test_a_setpoint_that_a_blocked_motor_does_not_reach_is_taken_back() -> None:
    arm = tracking()
    before = arm.decisions[-1].velocity[0]
    assert abs(before) > 2.0 * LIMITS.acceleration[0] * T
    arm.step(**arm.press(-np.sign(before) * 2.0), struck=True, motor_velocity=np.zeros(2))
    assert arm.mode is M.RELEASING
    assert abs(arm.decisions[-1].velocity[0]) <= LIMITS.acceleration[0] * T + 1e-9


def test_a_motor_that_goes_as_it_was_commanded_is_braked_within_its_acceleration() -> None:
    arm = tracking()
    before = arm.decisions[-1].velocity[0]
    arm.hit(-np.sign(before) * 2.0)
    step = abs(arm.decisions[-1].velocity[0] - before)
    assert step == pytest.approx(LIMITS.acceleration[0] * T)


def test_it_holds_away_from_the_released_obstacle() -> None:
    """A link that falls back through its gap meanwhile is not pressed on to it."""
    arm = released(tracking())
    arm.step()
    left = arm.q[0]
    arm.run_until(M.HOLDING, q=np.array([left - 0.02, arm.q[1]]))
    assert arm.decisions[-1].reference[0] == pytest.approx(left, abs=5e-3)


def test_disabled_on_the_way_it_lets_go_of_the_drives_when_it_stands() -> None:
    arm = released(tracking())
    arm.request(Event.DISABLE)
    arm.run(0.5)
    assert arm.mode is M.OFF


def test_the_distance_of_a_release_counts_towards_the_allowance() -> None:
    arm = tracking(armed=True)
    arm.controller._allowance.renew()
    released(arm, 2.0, 0.6)
    arm.run_until(M.HOLDING)
    assert arm.controller._allowance._moved[0] > 0.1


@pytest.mark.parametrize("velocity", [0.1, 0.5])
def test_it_brakes_before_the_end_of_its_distance(velocity: float) -> None:
    bounds = replace(MANNER.release, velocity=velocity, distance=0.1)
    arm = tracking(manner=replace(MANNER, release=bounds))
    start = arm.q[0]
    arm.hit(2.0)
    arm.run_until(M.HOLDING, 4.0, **arm.press(2.0))
    assert 0.08 < arm.q[0] - start <= 0.1 + 1e-9


def test_a_lasting_pressure_is_reported_as_long_as_it_lasts() -> None:
    arm = tracking()
    arm.hit(2.0)
    assert arm.controller.pressed == "", "it lets go"
    arm.run_until(M.HOLDING, 4.0, **arm.press(2.0))
    assert arm.controller.pressed == "a was hit"
    arm.step(**arm.push(1.0))
    assert arm.controller.pressed == "a feels it"
    arm.step()
    assert arm.controller.pressed == ""
    arm.step(**arm.push(1.0))
    assert arm.controller.pressed == "", "a person touches an arm that holds"


def test_configured_to_hold_it_reports_what_presses() -> None:
    arm = tracking(reactions=Reactions(collision=R.HOLD))
    arm.run(1.0, **arm.press(2.0))
    assert (arm.mode, arm.cause, arm.controller.pressed) == (M.HOLDING, "a was hit", "a was hit")
    arm.controller.motion.blind = True
    assert arm.controller.pressed == ""


def without_learning(torque: float) -> dict[str, Any]:
    """Stated levels of 0.8 Nm, those in force lower; so much of joint a is there without learned
    friction, too."""
    levels = np.array([0.8, 0.8])
    agreed = np.array([torque, 0.0])
    return {"independent": IndependentResidual(agreed, 0.2 * levels, levels, levels)}


def test_learned_friction_begins_no_release_and_goes_on_with_none() -> None:
    """It may explain a part of a push that is there without it."""
    arm = tracking()
    arm.step(**arm.press(2.0), **without_learning(0.5), struck=True)
    assert arm.mode is M.STOPPING
    arm = tracking()
    arm.step(**arm.press(2.0), **without_learning(2.0), struck=True)
    arm.run(0.3, **arm.press(2.0), **without_learning(0.5))
    assert arm.mode is M.RELEASING
    arm.run(0.05, **arm.press(2.0), **without_learning(0.0))
    assert arm.mode is M.STOPPING
    assert arm.cause.startswith("let go of contact at a")
