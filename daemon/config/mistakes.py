"""Likely mistakes: values that are possible, but most likely not intended.

`bounds` refuses values that no arm can have. The remaining mistakes are values in other units, on
the wrong side of a gear, or copied from the line above: each within its bounds, but implausible
together. They are recognised by a second source for the same quantity (the URDF, the EDS, another
scale), or by the usual properties of drives, motors and bodies. Each is reported with the value
that was probably intended. They are warnings, not errors, as an unusual arm is not a wrong one;
`contactd identify wiring` decides.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from daemon.config.drive_mistakes import DEGREE, TURN, drive_mistakes
from daemon.config.problem import Problem, agree, at, figure
from daemon.config.schema import Configuration, Joint
from drivers.canopen.boot.data_sheet import DataSheet
from drivers.drive import Drive
from drivers.makes import make_of
from estimator.urdf import JointRange, MovedLink, joint_ranges, moved_links

FASTEST_MOTOR = 1300.0  # [rad/s], 12000 rpm: highest speed of small motors with gears
LARGEST_GEAR = 400.0
FASTEST_JOINT = 10.0  # [rad/s]
HARDEST = 100.0  # [rad/s2]: largest acceleration of arms with low-cost gears
DENSEST = 20_000.0  # [kg/m3], tungsten: bounds the size of a body of given mass from below
LIGHTEST_ROTOR = 6e-6  # smallest rotor inertia over torque^(5/3), at the shaft
GEARED = 10.0  # gear ratio above which a high-speed motor is assumed
WEAKEST, STRONGEST = 3e-3, 0.5  # torque constants of such motors, at the shaft [Nm/A]
NOISE_COUNTS = 4.0  # smallest contact level in counts of the drive's current


def likely_mistakes(c: Configuration, urdf: str, sheets: Mapping[str, DataSheet]) -> list[Problem]:
    """Likely mistakes in a configuration whose types and ranges are valid.
    sheets: the EDS of each profile that has one, by profile name."""
    ranges = {one.joint: one for one in joint_ranges(urdf)}
    return [
        *(problem for name in sheets for problem in drive_mistakes(c, name, sheets[name])),
        *(
            problem
            for i, joint in enumerate(c.joints)
            for problem in _joint(i, joint, c.joint_drives[i], ranges[joint.name])
        ),
        *(
            Problem(["urdf"], f"urdf ({c.urdf}), {place}", what)
            for place, what in urdf_mistakes(urdf)
        ),
    ]


def urdf_mistakes(urdf: str) -> list[tuple[str, str]]:
    """Likely mistakes in the text of a URDF: line and element of each, and its description."""
    return [
        *(found for link in moved_links(urdf) for found in _link(link)),
        *(found for one in joint_ranges(urdf) for found in _range(one)),
    ]


# --- joints ---------------------------------------------------------------------------------------


def _joint(i: int, joint: Joint, drive: Drive[Any], span: JointRange) -> Iterator[Problem]:
    yield from _gear(i, joint)
    yield from _torque(i, joint)
    yield from _limits(i, joint, span)
    wiring = joint.wiring
    if wiring.max_current_A < 0.5 * wiring.rated_current_A:
        yield Problem(
            *at(i, joint, "wiring", "max_current_A"),
            f"{wiring.max_current_A:g} A is less than half of rated_current_A "
            f"({wiring.rated_current_A:g} A): are the two swapped?",
        )
    if abs(wiring.link_offset) > TURN:
        yield Problem(
            *at(i, joint, "wiring", "link_offset"),
            f"{figure(wiring.link_offset)} rad is more than a turn: in degrees? then it is "
            f"{figure(wiring.link_offset * DEGREE)} rad",
        )
    count = abs(make_of(drive.profile).counts(drive, "effort").gain) * joint.torque_constant
    if joint.thresholds.contact < NOISE_COUNTS * count:
        yield Problem(
            *at(i, joint, "thresholds", "contact"),
            f"{joint.thresholds.contact:.4g} Nm is less than {NOISE_COUNTS:g} counts of the "
            f"drive's effort ({figure(count)} Nm each): its noise would be detected as a contact",
        )


def _gear(i: int, joint: Joint) -> Iterator[Problem]:
    gear, place = joint.wiring.gear, at(i, joint, "wiring", "gear")
    fastest = joint.limits.velocity * gear
    if gear < 1.0:
        yield Problem(
            *place,
            f"{gear:g} turns of the motor per turn of the joint: such a gear would speed up; is "
            f"the ratio inverted? then it is {figure(1.0 / gear)}",
        )
    elif gear > LARGEST_GEAR:
        yield Problem(*place, f"{gear:g} is more than gears of arms have: a digit too many?")
    elif fastest > FASTEST_MOTOR and joint.limits.velocity <= FASTEST_JOINT:
        yield Problem(
            *place,
            f"{gear:g}: at limits.velocity the motor would turn with {figure(fastest)} rad/s "
            f"({fastest * 60.0 / TURN:.0f} rpm), faster than motors of arms turn",
        )


def _torque(i: int, joint: Joint) -> Iterator[Problem]:
    wiring, constant = joint.wiring, joint.torque_constant
    shaft = constant * wiring.rated_current_A / wiring.gear
    place = at(i, joint, "torque_constant")
    rated = wiring.rated_torque_Nm
    if rated is not None and agree(shaft, rated / 1000.0, 1.5):
        yield Problem(
            *at(i, joint, "wiring", "rated_torque_Nm"),
            f"{figure(rated)} Nm: in mNm? torque_constant and rated_current_A give {figure(shaft)} "
            "Nm at the shaft",
        )
    elif rated is not None and not agree(shaft, rated, 1.5):
        meant = rated * wiring.gear / wiring.rated_current_A
        yield Problem(
            *place,
            f"{figure(constant)} Nm/A gives {figure(shaft)} Nm at the shaft at rated current, and "
            f"rated_torque_Nm is {figure(rated)}: by that it is {figure(meant)} Nm/A at the link",
        )
    elif wiring.gear > GEARED and not WEAKEST <= constant / wiring.gear <= STRONGEST:
        weak = constant / wiring.gear < WEAKEST
        yield Problem(
            *place,
            f"{figure(constant)} Nm/A at the link is {figure(constant / wiring.gear)} Nm/A at the "
            f"shaft, {'less' if weak else 'more'} than motors behind a gear have: "
            + (f"is it the shaft's? times the gear it is {figure(constant * wiring.gear)}" if weak
               else f"is the gear included twice? over it it is {figure(constant / wiring.gear)}"),
        )  # fmt: skip
    rotor, least = joint.rotor_inertia, LIGHTEST_ROTOR * shaft ** (5.0 / 3.0) * wiring.gear**2
    if 0.0 < rotor < least:
        yield Problem(
            *at(i, joint, "rotor_inertia"),
            f"{figure(rotor)} kg m2 is less than a motor of {figure(shaft)} Nm has, seen from the "
            f"link ({figure(least)} at least): is it that at the shaft? times gear^2 it is "
            f"{figure(rotor * wiring.gear**2)}",
        )


def _limits(i: int, joint: Joint, span: JointRange) -> Iterator[Problem]:
    limits = joint.limits
    if span.velocity > 0.0 and limits.velocity > span.velocity * 1.001:
        yield Problem(
            *at(i, joint, "limits", "velocity"),
            f"{figure(limits.velocity)} rad/s is beyond the URDF's {figure(span.velocity)} (line "
            f"{span.line}); from degrees/s it would be {figure(limits.velocity * DEGREE)}",
        )
    elif limits.velocity > FASTEST_JOINT:
        yield Problem(
            *at(i, joint, "limits", "velocity"),
            f"{figure(limits.velocity)} rad/s is too fast beside a person: in degrees/s? then it "
            f"is {figure(limits.velocity * DEGREE)} rad/s",
        )
    for name in ("acceleration", "quick_stop"):
        value = getattr(limits, name)
        if value > HARDEST:
            yield Problem(
                *at(i, joint, "limits", name),
                f"{figure(value)} rad/s2 is more than arms with gears are made for: in degrees/s2? "
                f"then it is {figure(value * DEGREE)} rad/s2",
            )
    if limits.quick_stop < limits.acceleration:
        yield Problem(
            *at(i, joint, "limits", "quick_stop"),
            f"{figure(limits.quick_stop)} rad/s2 is less than limits.acceleration "
            f"({figure(limits.acceleration)}): a stop would be softer than usual motion",
        )


# --- the URDF -------------------------------------------------------------------------------------


def _link(link: MovedLink) -> Iterator[tuple[str, str]]:
    place = f"line {link.line}: link {link.name!r}"
    radius = (3.0 * link.mass / (4.0 * math.pi * DENSEST)) ** (1.0 / 3.0)
    least = 0.4 * link.mass * radius**2
    if 0.0 < link.moment < least:
        yield (
            place,
            f"its inertia of {figure(link.moment)} kg m2 is less than that of a tungsten ball of "
            f"{figure(link.mass)} kg ({figure(least)}): in other units than kg m2?",
        )
    if link.lever > 2.0:
        yield place, f"its centre of mass is {figure(link.lever)} m from its frame: in mm?"


def _range(one: JointRange) -> Iterator[tuple[str, str]]:
    place = f"line {one.line}: joint {one.joint!r}"
    if max(abs(one.lower), abs(one.upper)) > 2.0 * TURN:
        yield (
            place,
            f"its <limit> of {figure(one.lower)} to {figure(one.upper)} rad is more than two "
            f"turns: in degrees? then it is {figure(one.lower * DEGREE)} to "
            f"{figure(one.upper * DEGREE)} rad",
        )
    if one.velocity > 30.0:
        yield (
            place,
            f"its <limit velocity> of {figure(one.velocity)} rad/s: in degrees/s? then it is "
            f"{figure(one.velocity * DEGREE)}",
        )
    if one.offset > 3.0:
        yield place, f"its <origin> is {figure(one.offset)} m from the joint before it: in mm?"
