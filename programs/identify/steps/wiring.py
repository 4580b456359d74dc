"""Step `wiring`: check of each joint's signs and scales by a small motion."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

import math
from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING

from common.errors import ControlError
from programs.identify.step import JOINTS, Line, Outcome, now, step

if TYPE_CHECKING:
    from daemon.config.load import Robot
    from daemon.config.schema import Configuration
    from identification.wiring import WiringResult
    from programs.identify.identification import Identification
    from programs.identify.live_wiring import ApartError
    from programs.identify.measured import Measured

TO_GO_ON = "`contactd identify wiring` continues with the joints that have not passed"


@step(JOINTS, quality=lambda entry: f"link/motor {entry.follows:.3f}", order=2)
def wiring(identification: "Identification", joints: tuple[str, ...]) -> bool:
    """Check signs and scales by a small motion of each joint: those named, else those not checked
    since a change, or all."""
    from programs.identify.live_wiring import ApartError, move_to_and_fro

    c = identification.robot.configuration
    outcomes, left = list[bool](), identification.due("wiring", joints)
    wrong: dict[str, str] = {}
    follows: dict[str, float] = {}
    while left:
        name = left[0]
        try:
            measured = identification.measured(
                partial(move_to_and_fro, joint=name, to_go_on=TO_GO_ON)
            )
        except ApartError as error:
            new = {joint: why for joint, why in error.why.items() if joint not in wrong}
            left = [joint for joint in left if joint not in new]
            _report_apart(identification, wrong, new, left, error)
            wrong |= new
            outcomes.append(False)
        else:
            found = _checked(identification.robot, measured, name)
            follows[name] = found.follows
            outcome = _outcome(measured, name, found, c)
            outcomes.append(identification.conclude("wiring", outcome, f"wiring-{name}"))
            left = left[1:]
    _show_swapped(identification, follows)
    return all(outcomes)


def _show_swapped(identification: "Identification", follows: Mapping[str, float]) -> None:
    """Show pairs of joints whose node IDs or gears appear to be swapped."""
    from identification.wiring import swapped_pairs

    for a, b in swapped_pairs(follows):
        identification.show(
            f"{a} and {b}: their links move {follows[a]:.3f} and {follows[b]:.3f} times as far as "
            "their motors report, a product of 1: are their `wiring.node` swapped, or their gears?"
        )


def _report_apart(
    identification: "Identification",
    wrong: Iterable[str],
    new: Mapping[str, str],
    left: list[str],
    error: "ApartError",
) -> None:
    """Report joints whose motor and link came apart, and recover so that the others are checked.
    Raises `error` if the user had enabled the drives, ControlError if joints reported before fault
    again, which prevents checking the others."""
    if new:
        lines = [Line(joint, "wrong", good=False, reason=why) for joint, why in new.items()]
        identification.conclude("wiring", Outcome(lines=lines, unfinished=True))
    if identification.arm is None or not identification.arm.recover(on=bool(new and left)):
        raise error
    if not new:
        raise ControlError(
            f"motor and link of {', '.join(wrong)} disagree whenever the drives are enabled; they "
            f"are off now: correct this, then check the others ({', '.join(left)})"
        )


def _checked(robot: "Robot", measured: "Measured", name: str) -> "WiringResult":
    """Result of the check of a joint that was moved alone."""
    from drivers.robstride.settings import RobStrideProfile
    from identification.motor_torque import reported_by_asked
    from identification.wiring import check_wiring, with_torque_range

    c = robot.configuration
    i = c.joint_names.index(name)
    found = check_wiring(measured.log, i, robot.model, c.joints[i].torque_constant)
    profile = c.drives[c.joints[i].wiring.profile]
    if not (isinstance(profile, RobStrideProfile) and math.isfinite(found.follows)):
        return found
    loop = profile.stiffness, profile.damping, profile.Nm_per_A
    return with_torque_range(found, *reported_by_asked(measured.log, i, *loop))


def _outcome(measured: "Measured", name: str, found: "WiringResult", c: "Configuration") -> Outcome:
    """Outcome of a check, with an entry if it passed."""
    from daemon.config.identified import Entry, WiringEntry
    from identification.wiring import SCALE_TOLERANCE, in_Nm
    from programs.identify.contact_warnings import level_below_friction
    from programs.identify.live_wiring import would_fit

    figures = f"link/motor {found.follows:.3f}" if math.isfinite(found.follows) else ""
    if math.isfinite(found.held):
        figures += f", holds {in_Nm(found.held)} of {in_Nm(found.gravity)} gravity"
    off = found.problems and not found.undetermined and abs(found.follows - 1.0) > SCALE_TOLERANCE
    fits = would_fit(c, c.joint_names.index(name), found.follows) if off else ""
    reason = "; ".join([*found.problems, *found.undetermined, *found.notes]) + fits
    verdict = "good" if found.passed else "wrong" if found.problems else "undetermined"
    entries = dict[str, Entry]()
    if found.passed:
        follows = round(float(found.follows), 4)
        entries[name] = WiringEntry(date=now(), log=measured.sha256, follows=follows)
    line = Line(name, verdict, found.passed, figures, reason)
    joint = c.joints[c.joint_names.index(name)]
    notes = level_below_friction(joint, found.friction) if found.passed else ()
    return Outcome(lines=[line], entries=entries, notes=notes)
