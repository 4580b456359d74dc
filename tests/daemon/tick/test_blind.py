"""An arm whose links are not to be trusted: it closes no loop over them."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.assembly import heed_identification
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode

Change = Callable[[Configuration], Configuration]


def as_it_was(c: Configuration) -> Configuration:
    return c


def encoder_turned_round(c: Configuration) -> Configuration:
    (joint,) = c.joints
    wiring = msgspec.structs.replace(joint.wiring, link_sign=-joint.wiring.link_sign)
    return msgspec.structs.replace(c, joints=(msgspec.structs.replace(joint, wiring=wiring),))


@pytest.mark.parametrize(
    ("configure", "serials", "known", "why"),
    [
        (as_it_was, [1], True, "is of these drives"),
        (as_it_was, [1], False, "was never checked"),
        (as_it_was, [99], True, "was identified on drive 1, this is drive 99"),
        (encoder_turned_round, [1], True, "belongs to another configuration"),
    ],
)
def test_it_closes_a_loop_over_its_links_only_as_they_were_checked(
    configure: Change, serials: list[int | None], known: bool, why: str
) -> None:
    with lockstep_rig(SINGLE_JOINT, configure=configure) as rig:
        robot = rig.robot if known else replace(rig.robot, identified=None)
        heed_identification(rig.tick, robot, serials)
        trusted = why == "is of these drives"
        assert why in rig.tick.prearm.identification.text
        rig.run(0.1)
        rig.enable()
        refused = rig.tick.controller.request(Event.START, "a test", rig.time_s)
        assert refused == [] if trusted else "the wiring was not checked" in refused[0]
        rig.arm.external_torque[0] = 0.15
        moved = []
        rig.run(1.0, lambda: moved.append(setpoint(rig)))
        assert any(moved) == trusted
        assert rig.mode is (Mode.TRACKING if trusted else Mode.HOLDING)


def setpoint(rig: Rig) -> float:
    return float(rig.decision.velocity[0])
