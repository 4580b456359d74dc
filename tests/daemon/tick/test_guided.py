"""Chosen in the configuration, done by the whole program and the plant: retract and return."""

from itertools import pairwise

import msgspec
import numpy as np

from bench.rigs.lockstep import lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes.contact_reactions import AfterQuiet, ContactReaction
from daemon.modes.table import Event, Mode

ELBOW = 2


def cautious(c: Configuration) -> Configuration:
    """Reports a touch, backs away from a blow, and goes back to its trajectory."""
    reactions = msgspec.structs.replace(
        c.reactions, contact=ContactReaction.REPORT, collision=ContactReaction.RETRACT
    )
    admittance = msgspec.structs.replace(c.admittance, quiet_s=0.5, after_quiet=AfterQuiet.RETURN)
    return msgspec.structs.replace(c, reactions=reactions, admittance=admittance)


def test_it_backs_away_from_a_blow_and_goes_back_to_its_trajectory() -> None:
    with lockstep_rig(configure=cautious) as rig:
        rig.enable()
        rig.request(Event.START)
        rig.run(1.0)
        assert rig.permit("the test") == []
        rig.arm.external_torque[ELBOW] = 1.0  # a touch
        states = rig.states(0.3)
        assert {state.mode for state in states} == {Mode.TRACKING}
        rig.arm.external_torque[ELBOW] = -5.0  # a blow
        states += rig.states(0.15)
        rig.arm.external_torque[ELBOW] = 0.0
        states += rig.states(3.0)
    modes = [b.mode for a, b in pairwise(states) if a.mode != b.mode]
    assert modes == [Mode.RETRACTING, Mode.RETURNING, Mode.TRACKING]
    elbow = [s.link_position[ELBOW] for s in states if s.mode == Mode.RETRACTING]
    assert -0.17 < elbow[-1] - elbow[0] < -0.13  # retract_distance is 0.15
    when = next(i for i, s in enumerate(states) if s.mode == Mode.RETRACTING)
    taken, back = states[when - 1], next(s for s in states[when:] if s.mode == Mode.TRACKING)
    np.testing.assert_allclose(back.link_position, taken.reference, atol=0.011)
    assert back.cause == "back where the trajectory goes on"
    way = np.array([s.link_position for s in states if s.mode == Mode.RETURNING])
    assert (
        np.abs(np.diff(way, axis=0)).max() < 1.6 * 0.2 * 0.01
    )  # return_velocity, and gear and drive
