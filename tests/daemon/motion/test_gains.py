"""Gain of a joint, changed while it yields."""

import numpy as np
import pytest

from daemon.modes.contact_reactions import ContactReaction, Reactions
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.hand_witness import HandWitness, IndependentResidual
from tests.ideal_arm import T, tracking_arm

SOFT = Reactions(ContactReaction.ADMITTANCE, ContactReaction.ADMITTANCE)
FAR = AllowanceSettings(max_duration_s=100.0, max_excursion=3.0)


def test_a_gain_changes_while_it_acts_without_a_bump() -> None:
    arm = tracking_arm(reactions=SOFT, bounds=FAR)
    arm.run(0.5, **arm.push(0.2))
    assert arm.decisions[-1].velocity[0] == pytest.approx(0.1, rel=1e-3)
    assert arm.controller.leading.set_gain("a", 2.0, "me") == []
    changes = [(change.text, change.cause) for change in arm.controller.machine.changes]
    assert changes[-1] == ("gain of a 0.5 -> 2 rad/s per Nm", "by me")
    begun = len(arm.decisions)
    arm.run(1.0, **arm.push(0.2))
    velocity = np.array([decision.velocity[0] for decision in arm.decisions[begun:]])
    assert velocity[-1] == pytest.approx(0.4, rel=1e-3)
    # 0.3 rad/s in half a second; at once it would be 0.04 in the first tick.
    assert (np.diff(velocity, prepend=0.1) <= 0.3 / 0.5 * T + 1e-9).all()


@pytest.mark.parametrize(
    ("joint", "gain", "words"),
    [
        ("c", 1.0, "no joint 'c'; there are: a, b"),
        ("a", -0.1, "-0.1 is not a gain"),
        ("a", 5.1, "5.1 is not a gain: 0, or 0.0001 to 5 rad/s per Nm"),
        ("a", float("nan"), "nan is not a gain"),
        ("a", float("inf"), "inf is not a gain"),
    ],
)
def test_what_is_no_gain_is_refused_and_changes_nothing(
    joint: str, gain: float, words: str
) -> None:
    arm = tracking_arm(reactions=SOFT)
    assert words in arm.controller.leading.set_gain(joint, gain, "me")[0]
    arm.run(1.0)
    np.testing.assert_array_equal(arm.controller.motion.gains.value, [0.5, 0.5])


@pytest.mark.parametrize(("sure", "assists", "gain"), [(True, True, 3.5), (False, True, 1.0),
                                                       (True, False, 1.0)])  # fmt: skip
def test_only_a_hand_beyond_doubt_is_assisted(sure: bool, assists: bool, gain: float) -> None:
    """Led by 0.2 Nm at a level of 0.1 Nm, without friction."""
    arm = tracking_arm(reactions=SOFT, bounds=FAR, assists=assists)
    arm.controller._witness = HandWitness(np.zeros(2), np.zeros(2))
    felt, level = np.array([0.2, 0.0]), np.full(2, 0.1)
    independent = IndependentResidual(felt, level, level, level)
    led = {**arm.push(0.1), "independent": independent, "sure": sure}
    arm.run(3.0, **led)
    assert arm.decisions[-1].velocity[0] == pytest.approx(gain * 0.5 * 0.1, rel=1e-2)
    arm.run(1.0, **arm.push(0.1))  # it is not known whose push it is
    assert arm.decisions[-1].velocity[0] == pytest.approx(0.5 * 0.1, rel=1e-2)
