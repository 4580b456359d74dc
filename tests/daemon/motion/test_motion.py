"""Setpoints of single modes, near the limits."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.modes.contact_reactions import ContactReaction, Reactions
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.probe import PERIOD_S, SPEED, Probe
from tests.ideal_arm import MANNER, T, ideal_arm, tracking_arm

SOFT = Reactions(ContactReaction.ADMITTANCE, ContactReaction.ADMITTANCE)
FAR = AllowanceSettings(max_duration_s=100.0, max_excursion=3.0)


def test_a_joint_that_was_not_heard_of_has_moved_on() -> None:
    """Before a limit it is the slower for it."""
    speeds = []
    for age_s in (None, np.array([0.1, 0.0])):
        motion = ideal_arm().controller.motion
        push, q = np.array([2.0, 2.0]), np.array([0.98, 0.98])
        for _ in range(100):
            motion.step(Mode.ADMITTANCE, q, age_s, push, T)
        speeds.append(motion.velocity.tolist())
    (heard, other), (old, still) = speeds
    assert 0.0 < old < heard == other == still


def test_the_controller_passes_on_how_old_the_samples_are() -> None:
    """Yielding towards a limit, the joint whose samples are old brakes before the other."""
    arm = tracking_arm(reactions=SOFT, bounds=FAR)
    q, push = np.array([0.98, 0.98]), np.array([2.0, 2.0])
    felt = {"residual": push, "thresholded": push, "touched": "both feel it"}
    heard = [arm.step(q=q, **felt).velocity for _ in range(60)][-1]
    assert heard[0] == pytest.approx(heard[1], rel=1e-3)
    old = np.array([0.1, 0.0])
    commanded = [arm.step(q=q, age_s=old, **felt).velocity for _ in range(60)][-1]
    assert 0.0 < commanded[0] < 0.9 * commanded[1]
    assert commanded[1] == pytest.approx(heard[1], rel=1e-3)


def test_who_was_not_heard_of_does_not_stand_still_yet() -> None:
    arm = tracking_arm()
    arm.controller.request(Event.STOP, "me", arm.time_s)
    arm.run(1.0, age_s=np.array([0.0, 0.03]), recent=False)
    assert (arm.mode, arm.decisions[-1].velocity.any()) == (Mode.STOPPING, False)
    arm.step(age_s=np.array([0.0, 0.01]))
    assert arm.mode is Mode.HOLDING, "one sample may be missing"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_link_that_can_fall_past_its_limit_is_led_back_while_it_is_pushed(sign: float) -> None:
    """The first joint can fall 0.03 rad past the limit at which both stand, the second cannot."""
    q, can_fall, cannot = np.full(2, sign * 0.98), [0.05, 0.0], [0.0, 0.05]
    play = np.array((cannot, can_fall) if sign > 0 else (can_fall, cannot))
    motion = ideal_arm().controller.motion
    for _ in range(100):
        motion.step(Mode.ADMITTANCE, q, None, np.full(2, sign * 2.0), T, play)
    back, on = sign * motion.velocity
    assert back == pytest.approx(-0.03 * MANNER.position_gain)
    assert on > 0.0


def test_a_link_that_can_fall_past_its_limit_is_not_led_further_while_it_holds() -> None:
    play = np.array(([0.0, 0.05], [0.05, 0.0]))
    motion = ideal_arm().controller.motion
    motion.hold(np.ones(2))
    for _ in range(100):
        motion.step(Mode.HOLDING, np.full(2, 0.98), None, np.zeros(2), T, play)
    assert motion.velocity[0] == 0.0
    assert motion.velocity[1] > 0.0


@pytest.mark.parametrize("away", [0.0, 1e-3, 3e-3])
def test_a_swing_that_a_limit_bounds_pushes_a_heavy_arm_nowhere(away: float) -> None:
    """It goes no faster than it swings, and no further than one swing, to the free side."""
    motion, probe, q, way = ideal_arm().controller.motion, Probe(2, 2.0), np.ones(2) - away, []
    motion._law = replace(motion._law, virtual_mass_s=np.full(2, 0.5))
    for tick in range(200):
        probe.step(tick * T, np.zeros(2), np.ones(2))
        motion.probing = probe.velocity
        motion.step(Mode.ADMITTANCE, q, None, np.zeros(2), T)
        assert np.abs(motion.velocity).max() <= SPEED + 1e-9
        q = q + motion.velocity * T
        way.append(q)
    assert np.abs(np.array(way) - 1.0 + away).max() < 1.2 * SPEED * PERIOD_S / np.pi
