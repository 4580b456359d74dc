"""Backing away from what the arm met: how far, from what again, and when not."""

from typing import Any

import numpy as np
import pytest

from daemon.modes.contact_reactions import ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.hand_witness import HandWitness, IndependentResidual
from tests.fake_daemon import MakeArm as Make
from tests.ideal_arm import MANNER, IdealArm, holding_arm

R, M = ContactReaction, Mode
FAR = AllowanceSettings(max_duration_s=100.0, max_excursion=3.0)


def hit_at(q: float, arm: IdealArm) -> IdealArm:
    """Paused, its first joint at q, and hit there."""
    arm.request(Event.PAUSE)
    arm.run_until(M.HOLDING)
    arm.q[0] = q
    arm.hit(2.0)
    return arm


def test_it_backs_away_the_way_it_was_pushed_and_no_further(tracking: Make) -> None:
    for sign in (-1.0, 1.0):
        arm = tracking(collision=R.RETRACT, contact=R.REPORT)
        start = arm.q.copy()
        arm.hit(sign * 2.0)
        arm.run(1.5)
        assert arm.mode is M.RETRACTING
        away = arm.q - start
        assert sign * away[0] == pytest.approx(MANNER.retract_distance, abs=2e-3)
        assert abs(away[1]) < 1e-3
        velocity = np.array([decision.velocity[0] for decision in arm.decisions[-150:]])
        assert np.abs(velocity).max() < MANNER.retract_velocity + 0.05


def test_it_goes_on_when_it_has_backed_away_and_is_quiet(tracking: Make) -> None:
    arm = tracking(collision=R.RETRACT, contact=R.REPORT)
    arm.hit(2.0)
    arm.run(0.5, **arm.push(0.5))
    assert arm.run_until(M.TRACKING) == pytest.approx(2.0, abs=0.02)


def test_pushed_against_while_backing_away_it_stops(tracking: Make) -> None:
    arm = tracking(collision=R.RETRACT, contact=R.REPORT)
    arm.hit(2.0)
    arm.run(0.1)
    arm.touch(-0.3)
    assert arm.mode is M.STOPPING
    assert arm.cause == "pushed against while retracting"
    assert arm.armed


def test_a_contact_that_lasts_when_it_has_backed_away_makes_it_yield(tracking: Make) -> None:
    arm = tracking(collision=R.RETRACT)
    arm.hit(2.0)
    took = arm.run_until(M.ADMITTANCE, **arm.push(0.3))
    assert 0.2 < took < 0.6


def test_from_a_contact_that_lasts_it_backs_away_again(tracking: Make) -> None:
    arm = hit_at(0.0, tracking(contact=R.RETRACT, collision=R.RETRACT, bounds=FAR))
    arm.run(4.0, **arm.push(0.3))
    assert arm.mode is M.RETRACTING
    assert arm.q[0] > 4 * MANNER.retract_distance
    arm.run(6.0, **arm.push(0.3))  # up to the limit, where it stands
    assert arm.q[0] == pytest.approx(1.0, abs=2e-3)
    references = {float(decision.reference[0]) for decision in arm.decisions[-100:]}
    assert references == {1.0}
    arm.run_until(M.HOLDING)


@pytest.mark.parametrize(
    ("bounds", "says"),
    [
        (AllowanceSettings(max_duration_s=100.0, max_excursion=0.4), "further than 0.4 rad"),
        (AllowanceSettings(max_duration_s=2.0, max_excursion=3.0), "for more than 2 s"),
    ],
)
def test_backing_away_from_a_bias_is_bounded(bounds: AllowanceSettings, says: str) -> None:
    arm = holding_arm(reactions=Reactions(R.RETRACT, R.RETRACT), bounds=bounds)
    assert arm.controller.arm("me") == []
    start = arm.q[0]
    arm.run(10.0, **arm.push(0.3))
    assert not arm.armed
    assert says in arm.cause
    assert arm.mode is M.HOLDING
    furthest = min(bounds.max_excursion, 2.0 * MANNER.retract_velocity)
    assert 0.3 < arm.q[0] - start < furthest + 0.05
    assert not arm.decisions[-1].velocity.any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_from_a_second_blow_it_backs_away_too(tracking: Make, sign: float) -> None:
    arm = hit_at(0.0, tracking(contact=R.REPORT, collision=R.RETRACT, bounds=FAR))
    arm.run(1.0)
    between = arm.q[0]
    assert between == pytest.approx(MANNER.retract_distance, abs=2e-3)
    arm.hit(sign * 2.0)
    arm.run(1.0)
    assert arm.mode is M.RETRACTING
    assert sign * (arm.q[0] - between) == pytest.approx(MANNER.retract_distance, abs=4e-3)


@pytest.mark.parametrize(("sign", "mode"), [(1.0, M.RETRACTING), (-1.0, M.STOPPING)])
def test_a_second_blow_on_the_way(tracking: Make, sign: float, mode: M) -> None:
    """From the same side it changes nothing, and from the other one it stops, as any push does."""
    arm = tracking(contact=R.REPORT, collision=R.RETRACT)
    start = arm.q[0]
    arm.hit(2.0)
    arm.run(0.1)
    arm.hit(sign * 2.0)
    assert arm.mode is mode
    arm.run(1.0)
    assert arm.q[0] - start < MANNER.retract_distance + 2e-3


def test_it_backs_away_towards_a_limit_only_as_far_as_that(tracking: Make) -> None:
    arm = hit_at(0.97, tracking(collision=R.RETRACT, contact=R.REPORT, bounds=FAR))
    arm.run(1.0)
    assert arm.q[0] == pytest.approx(1.0, abs=2e-3)
    assert arm.q[0] <= 1.0
    assert arm.decisions[-1].reference[0] == 1.0


def test_a_joint_without_gain_does_not_back_away(tracking: Make) -> None:
    arm = tracking(contact=R.RETRACT)
    arm.controller.leading.set_gain("a", 0.0, "me")
    arm.run(0.6)
    arm.request(Event.PAUSE)
    arm.run_until(M.HOLDING)
    where = arm.q.copy()
    arm.touch(2.0)
    arm.run(0.5)
    np.testing.assert_allclose(arm.q, where, atol=1e-3)


def test_from_a_blow_in_motion_it_backs_away_as_far_as_from_one_at_rest(tracking: Make) -> None:
    arm = tracking(contact=R.REPORT, collision=R.RETRACT)
    arm.run(1.0)
    start, speed = arm.q[0], arm.decisions[-1].velocity[0]
    assert speed < -0.1
    arm.hit(2.0)
    arm.run(1.5)
    assert min(decision.velocity[0] for decision in arm.decisions[-150:]) >= speed
    assert arm.q[0] == pytest.approx(start + MANNER.retract_distance, abs=4e-3)


def test_it_backs_away_only_from_a_witnessed_hand(tracking: Make) -> None:
    arm = tracking(contact=R.RETRACT)
    arm.controller._witness = HandWitness(np.full(2, 0.5), np.zeros(2))

    def felt(torque: float) -> dict[str, Any]:
        """Fields of ControlInput at a level of 0.4 Nm, of which half is in force."""
        levels = np.full(2, 0.4)
        independent = IndependentResidual(np.array([torque, 0.0]), 0.5 * levels, levels, levels)
        return {**arm.push(torque - 0.2), "independent": independent}

    arm.run(0.3, **felt(0.6))
    assert arm.mode is M.RETRACTING
    start = arm.q[0]
    arm.run(0.3, **felt(0.6))
    arm.run(0.3, **felt(0.3))
    assert arm.mode is M.RETRACTING
    assert arm.q[0] == pytest.approx(start, abs=1e-3)
    arm.run(0.4, **felt(1.2))
    assert arm.q[0] - start > 0.8 * MANNER.retract_distance


def test_pushed_against_on_the_way_it_does_not_back_away_until_quiet(tracking: Make) -> None:
    arm = tracking(contact=R.RETRACT)
    arm.touch(2.0)
    arm.run(0.1)
    arm.touch(-0.3)
    arm.run(0.2)
    assert arm.mode is M.HOLDING
    start = arm.q[0]
    arm.run(1.0, **arm.push(-0.5))
    assert arm.mode is M.HOLDING
    assert arm.q[0] == pytest.approx(start, abs=1e-3)
    arm.run(2.1)
    arm.run(0.6, **arm.push(-0.5))
    assert arm.mode is M.RETRACTING
    assert arm.q[0] < start - 0.5 * MANNER.retract_distance
