"""An arm whose links are not to be trusted: it closes no loop over them."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.assembly import check_identification
from daemon.config.load import Robot
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode
from daemon.protocol.replies import Check

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
def test_no_loop_is_closed_over_links_that_were_not_checked(
    configure: Change, serials: list[int | None], known: bool, why: str
) -> None:
    def checked(robot: Robot, answered: list[int | None]) -> Check:
        assert answered == [1]
        return check_identification(robot if known else replace(robot, identified=None), serials)

    with lockstep_rig(SINGLE_JOINT, configure=configure, identification=checked) as rig:
        trusted = why == "is of these drives"
        rig.run(0.1)
        checks = {check.name: check for check in rig.arming.run(rig.time_s).checks}
        assert why in checks["identification"].text
        assert checks["identification"].passed == trusted
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
