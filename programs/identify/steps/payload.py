"""Step `payload`: mass and centre of mass of a load in the hand."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from common.errors import ConfigurationError
from programs.command_line.options import Range
from programs.identify.step import Line, Outcome, now, step

if TYPE_CHECKING:
    from daemon.config.load import Robot
    from identification.payload_fit import PayloadFit
    from programs.identify.identification import Identification
    from programs.identify.live_arm import LiveArm
    from programs.identify.measured import Measured

_BY_URDF, _IDENTIFIED = 0.05, 0.01
"""Relative errors of the bodies' masses that are assumed when a load is identified."""


@step(
    click.argument("name"),
    click.option("--seconds", default=10.0, show_default=True, type=Range(8, 120)),
    quality=lambda entry: f"{entry.mass:.3g} +- {entry.mass_error:.2g} kg",
    order=5,
)
def payload(identification: "Identification", name: str, seconds: float) -> bool:
    """Identify a load in the hand, for `contactctl payload NAME`: all joints move with it.

    Announce a load heavy enough to count as a collision roughly before: `contactctl payload MASS`.
    """
    _refuse(name)
    measured = identification.measured(lambda arm: _carried(arm, name, seconds))
    outcome = _outcome(identification.robot, measured, name, now())
    return identification.conclude("payload", outcome)


def _refuse(name: str) -> None:
    """Raise ConfigurationError for a name that `contactctl payload` would not accept."""
    from daemon.config.checks import names_payload

    if not names_payload(name) or not name.isprintable() or not 0 < len(name) <= 64:
        raise ConfigurationError(
            f"{name!r} is no payload name: it must be a word of at most 64 characters, neither a "
            "number nor `none`"
        )


def _carried(arm: "LiveArm", name: str, seconds: float) -> "Measured":
    """Move all joints along a short excitation, with the load in the hand."""
    from programs.identify.motions import bounds_of, excitation

    arm.forget("payload")  # recordings may be of another load
    c = arm.configuration
    motion = excitation(bounds_of(c), arm.model, c.period_s, 4, seconds, seconds)
    path = motion.path(arm.link_position(), seconds)
    text = f"all joints move with {name}, hands off"
    # A load causes contacts until it is announced, so there is no warning.
    again = "The same command starts afresh"
    arm.move("payload", text, path, warning=lambda event: "", to_go_on=again)
    return arm.read("payload")


def _outcome(robot: "Robot", measured: "Measured", name: str, date: str) -> Outcome:
    """Outcome with the load in the hand, from contact-free motion. Raises LogError for implausible
    measurements."""
    from daemon.assembly import build_transmission
    from daemon.config.digests import digests
    from daemon.config.identified import IdentifiedPayload
    from daemon.config.vectors import row
    from daemon.config.worst_loads import PayloadCapacity
    from estimator.payload import Payload
    from identification.log_checks import refuse_implausible
    from identification.payload_fit import PayloadVerdict, identify_payload

    c = robot.configuration
    limit = row(c, lambda j: j.wiring.max_current_A)
    refuse_implausible(measured.log, limit)
    model = robot.model
    identified = c.joints[model.hand_joint].body is not None
    off = _IDENTIFIED if identified else _BY_URDF
    fit = identify_payload(measured.log, model, build_transmission(c), c.estimator, limit, off)
    notes, payloads = list(measured.notes), dict[str, IdentifiedPayload]()
    if fit.touched:
        notes.append(f"{fit.discarded_s:.1f} s discarded: {', '.join(fit.touched)} was touched, or "
                     "hit something")  # fmt: skip
    good = fit.verdict is PayloadVerdict.GOOD
    line = Line(name, fit.verdict.value, good, _figures(fit, model.hand), fit.reason)
    if line.good:
        load = Payload.of(round(fit.mass, 4), [round(float(x), 4) for x in fit.com])
        if weak := PayloadCapacity(c, model).too_heavy(load):
            line = replace(line, verdict="too heavy", good=False, reason="; ".join(weak))
        else:
            payloads[name] = IdentifiedPayload(
                date=date,
                log=measured.sha256,
                of=digests(c, robot.urdf)[IdentifiedPayload.depends],
                mass=load.mass,
                com=(load.com[0], load.com[1], load.com[2]),
                mass_error=float(f"{fit.mass_error:.3g}"),
                com_error=float(f"{fit.com_error:.3g}"),
            )
            place = " ".join(f"{x:g}" for x in load.com)
            notes.append(f"`contactctl payload {name}` once the daemon has taken it up; until then "
                         f"`contactctl payload {load.mass:g} --com {place}`")  # fmt: skip
            if not identified:
                notes.append("the arm's masses are the URDF's, assumed accurate to 5 %: "
                             "`contactd identify masses` makes this more certain")  # fmt: skip
    return Outcome(lines=[line], notes=tuple(notes), payloads=payloads)


def _figures(fit: "PayloadFit", hand: str) -> str:
    if not math.isfinite(fit.mass_error):
        return ""
    place = " ".join(f"{x:.3f}" for x in fit.com)
    return (f"{fit.mass:.3g} +- {fit.mass_error:.2g} kg at ({place}) m of {hand}, "
            f"+- {1e3 * fit.com_error:.0f} mm")  # fmt: skip
