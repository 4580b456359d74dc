"""Reactions to contact, per level, and the continuation after the quiet time."""

import numpy as np
import pytest

from daemon.modes.contact_reactions import AfterQuiet, ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import AllowanceSettings
from tests.fake_daemon import MakeArm as Make
from tests.ideal_arm import MANNER, IdealArm, holding_arm

R, M = ContactReaction, Mode
AFTER = {
    R.REPORT: M.TRACKING,
    R.ADMITTANCE: M.ADMITTANCE,
    R.RETRACT: M.RETRACTING,
    R.RELEASE: M.RELEASING,
    R.HOLD: M.STOPPING,
    R.QUICK_STOP: M.FAULTED,
}
NEAR = AllowanceSettings(max_duration_s=100.0, max_excursion=0.4)
FAR = AllowanceSettings(max_duration_s=100.0, max_excursion=3.0)


# --- each reaction to each level ------------------------------------------------------------


@pytest.mark.parametrize("reaction", ContactReaction)
@pytest.mark.parametrize("armed", [True, False], ids=["armed", "unarmed"])
def test_the_reaction_to_a_contact(tracking: Make, armed: bool, reaction: ContactReaction) -> None:
    arm = tracking(contact=reaction)
    if armed:
        arm.touch()
        assert arm.cause == "a feels it" or reaction is R.REPORT
        assert arm.armed is (reaction is not R.QUICK_STOP)
    else:
        arm.request(Event.DISARM)
        arm.run(0.5, **arm.push(0.5))
    assert arm.mode is (AFTER[reaction] if armed else M.TRACKING)


@pytest.mark.parametrize("reaction", ContactReaction)
@pytest.mark.parametrize("armed", [True, False], ids=["armed", "unarmed"])
def test_a_collision_leads_to_its_reaction_or_unarmed_to_a_stop_or_release(
    tracking: Make, armed: bool, reaction: ContactReaction
) -> None:
    arm = tracking(collision=reaction, **({"contact": R.REPORT} if armed else {}))
    if not armed:
        arm.request(Event.DISARM)
    arm.hit()
    unarmed = {R.QUICK_STOP: M.FAULTED, R.RELEASE: M.RELEASING}.get(reaction, M.STOPPING)
    assert arm.mode is (AFTER[reaction] if armed else unarmed)
    assert armed or arm.cause == "a was hit"


def test_to_hold_means_to_stay_where_it_stopped(tracking: Make) -> None:
    arm = tracking(contact=R.HOLD)
    arm.run(1.0, **arm.push(0.5))
    assert arm.mode is M.HOLDING
    assert arm.armed
    where = arm.q.copy()
    arm.run(5.0, **arm.push(0.5))
    np.testing.assert_allclose(arm.q, where, atol=1e-3)
    arm.request(Event.START)  # the contact lasts: not a step
    arm.run(0.5, **arm.push(0.5))
    assert arm.mode is M.HOLDING


@pytest.mark.parametrize(
    ("collision", "mode"),
    [
        (R.REPORT, M.ADMITTANCE),
        (R.ADMITTANCE, M.ADMITTANCE),
        (R.RETRACT, M.RETRACTING),
        (R.RELEASE, M.ADMITTANCE),  # it yields already
        (R.HOLD, M.STOPPING),
        (R.QUICK_STOP, M.FAULTED),
    ],
)
def test_a_collision_in_admittance(tracking: Make, collision: ContactReaction, mode: Mode) -> None:
    arm = tracking(collision=collision)
    arm.run(0.3, **arm.push(0.5))
    arm.hit(3.0)
    assert arm.mode is mode


@pytest.mark.parametrize(
    ("collision", "mode"), [(R.ADMITTANCE, M.ADMITTANCE), (R.RETRACT, M.RETRACTING)]
)
def test_a_contact_to_stop_at_that_becomes_a_collision(
    tracking: Make, collision: ContactReaction, mode: Mode
) -> None:
    arm = tracking(contact=R.HOLD, collision=collision)
    arm.touch()
    assert arm.mode is M.STOPPING
    arm.hit()
    assert arm.mode is mode
    arm.run(1.0, **arm.push(0.5))  # and what stops a moving arm does not interrupt this
    assert arm.mode is (M.ADMITTANCE if mode is M.ADMITTANCE else M.HOLDING)


# --- after the quiet time -------------------------------------------------------------------


def guided(arm: IdealArm, torque: float = 0.6) -> None:
    """Led for a second, some 0.2 rad."""
    arm.run(1.0, **arm.push(torque))
    assert arm.mode is M.ADMITTANCE


def test_an_arm_that_holds_after_the_quiet_time_needs_a_new_start(tracking: Make) -> None:
    arm = tracking(after_quiet=AfterQuiet.HOLD)
    guided(arm)
    assert not arm.controller.machine.moving  # as `watch` shows it
    arm.run_until(M.HOLDING)
    assert arm.armed
    left = arm.q.copy()
    arm.run(3.0)
    np.testing.assert_allclose(arm.q, left, atol=1e-3)


def test_a_return_is_slow_and_continues_the_same_path(tracking: Make) -> None:
    arm, alone = tracking(after_quiet=AfterQuiet.RETURN), tracking()
    left = arm.decisions[-1].reference.copy()
    guided(arm)
    assert abs(arm.q[0] - left[0]) > 0.15
    arm.run_until(M.RETURNING)
    begun = len(arm.decisions)
    arm.run_until(M.TRACKING)
    velocity = np.array([decision.velocity[0] for decision in arm.decisions[begun:]])
    assert 0.1 < np.abs(velocity).max() < MANNER.return_velocity + 0.02
    np.testing.assert_allclose(arm.q, left, atol=0.011)
    assert arm.cause == "back where the trajectory goes on"
    arm.run(4.0)
    alone.run(4.0)
    # The same path: it loses a second's ramp, so it is a little behind on it.
    behind = [np.abs(arm.decisions[-1].reference - d.reference).max() for d in alone.decisions]
    assert min(behind) < 2e-3


def test_a_contact_during_a_return_restarts_the_quiet_time(tracking: Make) -> None:
    arm = tracking(after_quiet=AfterQuiet.RETURN, bounds=FAR)
    left = arm.decisions[-1].reference.copy()
    guided(arm)
    arm.run_until(M.RETURNING)
    arm.run(0.4)
    guided(arm, 0.3)
    assert arm.run_until(M.RETURNING) == pytest.approx(2.0, abs=0.02)
    arm.run_until(M.TRACKING)
    np.testing.assert_allclose(arm.q, left, atol=0.011)  # where it was left at first


def test_touched_while_holding_it_does_not_return() -> None:
    arm = holding_arm(after_quiet=AfterQuiet.RETURN)
    arm.controller.arm("me")
    guided(arm)
    arm.run_until(M.HOLDING)
    assert arm.q[0] > 0.2


def test_an_arm_that_cannot_get_back_stops_and_is_disarmed(tracking: Make) -> None:
    arm = tracking(after_quiet=AfterQuiet.RETURN)
    guided(arm)
    arm.run_until(M.RETURNING)
    blocked = arm.q.copy()
    for _ in range(1000):
        arm.step(q=blocked)
        if arm.mode is not M.RETURNING:
            break
    assert arm.mode is M.STOPPING
    assert "did not get back" in arm.cause
    assert not arm.armed


# --- bounds ---------------------------------------------------------------------------------


@pytest.mark.parametrize("after", [AfterQuiet.RESUME, AfterQuiet.HOLD])
def test_a_biased_residual_moves_the_arm_to_its_bound_and_no_further(after: AfterQuiet) -> None:
    """A push is detected for half a second, then none for longer than the quiet time, and again."""
    arm = holding_arm(after_quiet=after, bounds=NEAR)
    start = arm.q.copy()
    assert arm.controller.arm("me") == []
    for _ in range(100):
        arm.run(0.5, **arm.push(0.1))
        arm.run(2.1)
        if not arm.armed:
            break
        assert arm.controller.arm("a program that renews") == []  # which renews no bound
    assert arm.cause == "led further than 0.4 rad since `arm` (admittance.max_excursion)"
    assert abs(arm.q[0] - start[0]) < 0.41
    arm.run(2.0, **arm.push(0.1))
    assert arm.mode is M.HOLDING  # unarmed it is only reported


def test_quiet_ticks_do_not_renew_the_duration(tracking: Make) -> None:
    """A push that lets go for a tick, or for a while, is one push."""
    arm = tracking(bounds=AllowanceSettings(max_duration_s=5.0, max_excursion=3.0))
    begun = arm.time_s
    while arm.armed and arm.time_s - begun < 10.0:
        arm.run(0.05, **arm.push(0.001))
        arm.run(0.01)
    assert "led for more than 5 s (admittance.max_duration_s)" in arm.cause
    assert arm.time_s - begun == pytest.approx(5.0, abs=0.1)


def test_backing_away_again_and_again_is_bounded_too() -> None:
    arm = holding_arm(reactions=Reactions(R.RETRACT, R.RETRACT), bounds=NEAR)
    start = arm.q.copy()
    arm.controller.arm("me")
    for _ in range(20):
        arm.touch(0.5)
        arm.run(2.5)
        if not arm.armed:
            break
    assert "further than 0.4 rad" in arm.cause
    assert arm.q[0] - start[0] == pytest.approx(0.4, abs=0.03)


def test_leading_to_and_fro_exceeds_no_bound() -> None:
    arm = holding_arm(bounds=NEAR)
    arm.controller.arm("me")
    for i in range(20):
        arm.run(1.0, **arm.push(0.6 if i % 2 == 0 else -0.6))
        arm.run_until(M.HOLDING)
    assert arm.armed
