"""Step `zero`: zero and sign of a link encoder, from a stated position and the direction of a push.

Only observation of the arm gives both: no data sheet contains them, and motor motions cannot
distinguish them from the motor's own. The user states the link's position and its direction.
"""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

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

_BEYOND = 0.2  # [rad]: a link may rest on an end stop outside the URDF's limits
_PLUS = "Point your right thumb along the joint's axis, as in the URDF: the fingers curl towards +."


def _stated(
    context: click.Context, parameter: click.Parameter, words: Sequence[str]
) -> dict[str, float]:
    """Positions [rad] by joint, as typed. Raises UsageError."""
    pose, stated = destination(words)
    if pose:
        raise click.UsageError(f"{pose!r}: give JOINT=ANGLE for each joint to be zeroed")
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
    """Identify signs and zeros of link encoders: you push links while the drives are off.

    ANGLE is the link's position in the URDF's terms [rad]. You push each link a little in either
    direction, hold it, and enter the direction. The results replace `link_sign` and `link_offset`.
    """
    names = identification.joints(tuple(angles))
    if nowhere := not_possible(identification.robot, angles):
        raise ConfigurationError("; ".join(nowhere))
    if identification.arm is None:
        raise ConfigurationError("zeros cannot be identified from a log: `identify zero` asks you")
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
    """Ask the user to push a link; True if they answer that it moved in positive direction."""
    from programs.command_line.questions import choice

    identification.show(
        f"{name} is at rest. Push its link a little, either way, and hold it there."
    )
    return choice("Which way did it go", ["+", "-"]) == "+"


def _pushed(arm: "LiveArm", name: str, ask: Callable[[], bool]) -> "tuple[Vector, bool]":
    """Positions (N,) [rad] of a link, from rest until `ask`, which makes the user push it, returns,
    and its answer whether the link moved in positive direction."""
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
    """Errors about stated angles [rad] that lie well outside the URDF's limits."""
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
                f"{name}={figure(angle)}: outside the URDF's limits "
                f"[{lower:g}, {upper:g}] rad{meant}"
            )
    return reasons


def zero_outcome(
    robot: "Robot", joint: str, seen: "Vector", stood: float, *, upward: bool, date: str
) -> Outcome:
    """Outcome with sign and zero of one link encoder, from the positions (N,) [rad] that the daemon
    showed; by the URDF the link stood at `stood` [rad] and moved `upward` (positive) or not."""
    from daemon.config.identified import ZeroEntry
    from identification.resting_link import MOVED, departure

    c = robot.configuration
    wiring = c.joints[c.joint_names.index(joint)].wiring
    rest, went = departure(seen, c.period_s)
    if went == 0.0:
        offsets = 1e3 * (seen - rest)
        least, most, last = offsets.min(), offsets.max(), offsets[-1]
        by = f"it moved between {least:+.1f} and {most:+.1f} mrad, and ended at {last:+.1f}"
        reason = (
            f"{by if most - least > 0.5 else 'it did not move'}: push its link in one direction, "
            f"by {1e3 * MOVED:.0f} mrad or more, and hold it there until you have answered"
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
        f"link_sign {sign:+d}, link_offset {offset:+.4g} rad; it moved by {1e3 * went:+.1f} mrad"
    )
    verdict = "sign unchanged" if sign == wiring.link_sign else "sign inverted"
    line = Line(joint, verdict, good=True, figures=figures)
    return Outcome(lines=[line], entries={joint: entry})
