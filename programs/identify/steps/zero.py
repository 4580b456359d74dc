"""Zero and sign of a joint's link encoder: from its stated position and the way it was pushed.

Both are seen at the arm alone: no data sheet has them, and no motion of the motor separates them
from the motor's own. A person who states the link's position and which way it went gives both at
once.
"""
# ruff: noqa: PLC0415 - what a step needs is imported when it runs, so that `--help` starts at once

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from hashlib import sha256
from math import radians
from typing import TYPE_CHECKING

import click

from common.errors import ConfigurationError
from programs.command_line.destination import destination
from programs.command_line.options import SOCKET
from programs.identify.step import CONFIG, Line, Outcome, now, step

if TYPE_CHECKING:
    from common.arrays import Vector
    from daemon.config.load import Robot
    from daemon.protocol.state import State
    from drivers.settings import Sign
    from programs.identify.identification import Identification
    from programs.identify.live_arm import LiveArm

_BEYOND = 0.2  # [rad]: a link may lean on a stop that the URDF's limits lie before
_PLUS = (
    "Where the right thumb lies along a joint's axis, as the URDF has it, the fingers point to +."
)


def _stated(
    context: click.Context, parameter: click.Parameter, words: Sequence[str]
) -> dict[str, float]:
    """Positions [rad] by joint, as they were typed. Raises UsageError."""
    pose, stated = destination(words)
    if pose:
        raise click.UsageError(f"{pose!r}: JOINT=ANGLE for each joint whose encoder is to be set")
    return stated


@step(
    click.argument("angles", nargs=-1, required=True, metavar="JOINT=ANGLE...", callback=_stated),
    CONFIG,
    click.option("--dry-run", is_flag=True, help="Write no results."),
    SOCKET,
    shared=(),
    order=1,
)
def zero(identification: "Identification", angles: Mapping[str, float]) -> bool:
    """Push links while the drives are off: signs and zeros of their encoders.

    ANGLE is the position of the link by the URDF [rad]. You push each a little, either way, and
    enter which way it went while you hold it. The results replace `link_sign` and `link_offset`.
    """
    names = identification.joints(tuple(angles))
    if nowhere := not_possible(identification.robot, angles):
        raise ConfigurationError("; ".join(nowhere))
    if identification.arm is None:
        raise ConfigurationError("a log does not say where the links stood: `identify zero` asks")
    outcomes = []
    identification.show(_PLUS)
    for name in names:
        seen, upward = _pushed(identification.arm, name, partial(_upward, identification, name))
        outcome = zero_outcome(
            identification.robot, name, seen, angles[name], upward=upward, date=now()
        )
        outcomes.append(identification.conclude("zero", outcome))
    return all(outcomes)


def _upward(identification: "Identification", name: str) -> bool:
    """Have a person push a link, and answer whether it went upward."""
    from programs.command_line.questions import choice

    identification.show(f"{name} stands. Push its link a little, either way, and hold it there.")
    return choice("Which way did it go", ["+", "-"]) == "+"


def _pushed(arm: "LiveArm", name: str, ask: Callable[[], bool]) -> "tuple[Vector, bool]":
    """Positions (N,) [rad] of a link from its rest on, until `ask`, which has a person push it,
    returns whether it went upward."""
    import numpy as np

    from identification.resting_link import resting_samples, stands

    c = arm.configuration
    i, rest = c.joint_names.index(name), resting_samples(c.period_s)

    def positions(states: "Sequence[State]") -> "Vector":
        return np.array([s.link_position[i] for s in states if all(s.fresh)])

    def settled(states: "Sequence[State]") -> bool:
        return stands(positions(states[-rest:]), rest)

    with arm.session.watched(settled) as states:
        begun = len(states) - rest
        upward = ask()
    return positions(states[begun:]), upward


def not_possible(robot: "Robot", stated: Mapping[str, float]) -> list[str]:
    """Angles [rad] at which no link stands, well outside the URDF's limits, in words."""
    from daemon.config.problem import figure

    model = robot.model
    reasons = []
    for name, angle in stated.items():
        i = robot.configuration.joint_names.index(name)
        lower, upper = float(model.lower[i]), float(model.upper[i])
        if not lower - _BEYOND <= angle <= upper + _BEYOND:
            within = lower <= radians(angle) <= upper
            meant = f"; in degrees? then {name}={figure(radians(angle))}" if within else ""
            reasons.append(
                f"{name}={figure(angle)}: by the URDF it stands within "
                f"[{lower:g}, {upper:g}] rad{meant}"
            )
    return reasons


def zero_outcome(
    robot: "Robot", joint: str, seen: "Vector", stood: float, *, upward: bool, date: str
) -> Outcome:
    """Sign and zero of one link encoder, by the positions (N,) [rad] that the daemon showed; the
    link stood at `stood` [rad], and went `upward` or the other way, by the URDF."""
    from daemon.config.identified import ZeroEntry
    from identification.resting_link import MOVED, departure

    c = robot.configuration
    wiring = c.joints[c.joint_names.index(joint)].wiring
    rest, went = departure(seen, c.period_s)
    if went == 0.0:
        ways = 1e3 * (seen - rest)
        least, most, last = ways.min(), ways.max(), ways[-1]
        by = f"it went from {least:+.1f} to {most:+.1f} mrad, to {last:+.1f} at last"
        reason = (
            f"{by if most - least > 0.5 else 'it did not move'}: push its link one way, by "
            f"{1e3 * MOVED:.0f} mrad or more, and hold it there until you have answered"
        )
        return Outcome(lines=[Line(joint, "not seen", good=False, reason=reason)])
    turned: Sign = -1 if wiring.link_sign > 0 else 1
    sign = wiring.link_sign if (went > 0.0) == upward else turned
    offset = round(stood - sign * wiring.link_sign * (rest - wiring.link_offset), 5)
    entry = ZeroEntry(
        date=date,
        log=sha256(seen.tobytes()).hexdigest(),
        link_sign=sign,
        link_offset=offset,
        motor_sign=sign if c.drives[wiring.profile].one_sign else None,
    )
    figures = (
        f"link_sign {sign:+d}, link_offset {offset:+.4g} rad; it went by {1e3 * went:+.1f} mrad"
    )
    verdict = "as it was" if sign == wiring.link_sign else "sign turned"
    line = Line(joint, verdict, good=True, figures=figures)
    return Outcome(lines=[line], entries={joint: entry})
