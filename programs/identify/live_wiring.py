"""Motion of one joint of a live arm for the check of its wiring."""

import math
import re
from collections.abc import Mapping
from contextlib import suppress

from common.arrays import Vector
from common.errors import ContactdError, ControlError
from daemon.config.problem import agree, figure
from daemon.config.schema import Configuration
from daemon.faults.conditions import Condition
from drivers.canopen.settings import CanopenProfile
from identification.wiring import OTHER_WAY, follows_both_ways, scale_uncertain, share_of_motor
from programs.identify.contact_warnings import wiring_touched
from programs.identify.live_arm import LiveArm
from programs.identify.measured import Measured
from programs.identify.motions import WIDEST_GUESS, WIRING_TRAVEL, wiring_motion
from programs.identify.session import InterruptedStepError

_FAULT = re.compile(f"({Condition.APART}|{Condition.FROZEN}): .*", re.DOTALL)
_TOO_FAR = "its gear or a scale is wrong, or its gap is larger than half_gap says"


class ApartError(InterruptedStepError):
    """Error of a step that ended because motor and link of a joint came too far apart."""

    def __init__(self, text: str, why: Mapping[str, str]) -> None:
        super().__init__(text)
        self.why = why
        """Most likely mistake, by joint."""


def move_to_and_fro(arm: LiveArm, joint: str, to_go_on: str) -> Measured:
    """Move one joint's motor to and fro, through its gap; `to_go_on` is shown if that is
    interrupted. Raises ApartError, and as `Session.run` does."""
    step = f"wiring-{joint}"
    c = arm.configuration
    i = c.joint_names.index(joint)
    half_gap = c.joints[i].half_gap
    repeated = False
    while True:
        try:
            here = arm.link_position(motors_only=True)
            arm.forget(step)  # the motion is so short that it starts afresh
            carried = repeated or _may_float(arm, i, here)
            path = wiring_motion(here, i, half_gap, c.period_s, speeding_up=carried)
            text, warning = f"{joint} moves a little", wiring_touched(joint)
            arm.move(step, text, path, warning=warning, motors_only=True, to_go_on=to_go_on)
        except (ControlError, InterruptedStepError) as error:
            if why := why_apart(arm, error):
                words = "".join(f". {name}: {words}" for name, words in why.items())
                raise ApartError(f"{error}{words}", why) from error
            raise
        measured = arm.read(step)
        both = follows_both_ways(measured.log, i)
        if both and not repeated and scale_uncertain(measured.log, i):
            repeated, more = True, "once more, accelerating all the way"
            seen = "moved its link by a different amount than its motor"
        elif both or half_gap >= WIDEST_GUESS:
            return measured
        else:  # The gap is larger than configured.
            before, half_gap = half_gap, min(2.0 * half_gap + 0.5 * WIRING_TRAVEL, WIDEST_GUESS)
            seen = "did not move its link in both directions"
            more = f"once more, {2e3 * (half_gap - before):.0f} mrad further"
        arm.show(f"{joint} {seen}: {more}")


def _may_float(arm: LiveArm, i: int, here: Vector) -> bool:
    """True if gravity at joint i is so small that its link may run ahead of its motor."""
    rub = arm.configuration.joints[i].friction
    weight = abs(float(arm.model.gravity(here)[i]))
    return weight < rub.motor_coulomb + rub.link_coulomb


def why_apart(arm: LiveArm, error: ContactdError) -> dict[str, str]:
    """Most likely mistake of each joint whose link and motor are too far apart, from the recorded
    motion, or both candidates if there is none; empty for any other error."""
    # The text before the fault names the motion that it ended, perhaps of another joint.
    found = _FAULT.search(str(error))
    fault, names = found[0] if found else "", enumerate(arm.configuration.joint_names)
    return {
        joint: _apart(arm, i, joint)
        for i, joint in names
        if re.search(rf"(?<![\w-]){re.escape(joint)}(?![\w-])", fault)
    }


def _apart(arm: LiveArm, i: int, joint: str) -> str:
    with suppress(ContactdError):
        log = arm.read(f"wiring-{joint}").log
        share, against = share_of_motor(log, i)
        words = f"{_TOO_FAR} (the link moved {share:.2f} times as far as the motor reports)"
        return OTHER_WAY if against else words + would_fit(arm.configuration, i, share)
    return f"{OTHER_WAY}; else {_TOO_FAR}"


def would_fit(c: Configuration, i: int, share: float) -> str:
    """Words on the gear or encoder scale with which link i would match its motor; empty if the link
    hardly moved, or the motors are not CANopen drives."""
    wiring = c.joints[i].wiring
    profile = c.drives[wiring.profile]
    if share < 0.03 or not isinstance(profile, CanopenProfile):
        return ""
    scale = profile.link_position.scale
    counts = math.tau / scale
    off = share if agree(share, 1.0, 2.5) else 2.0 ** round(math.log2(share))
    return (
        f"; then wiring.gear, {wiring.gear:g}, should be about {wiring.gear / share:.3g}, or "
        f"drives.{wiring.profile}.link_position.scale, {figure(scale)} ({counts:.0f} counts per "
        f"turn), {figure(scale / off)} ({counts * off:.0f} counts)"
    )
