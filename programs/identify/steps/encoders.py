"""Step `encoders`: periodic errors of link encoders."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

import math
from typing import TYPE_CHECKING

import click

from programs.command_line.options import Range
from programs.identify.step import JOINTS, Line, Outcome, now, step

if TYPE_CHECKING:
    from daemon.config.load import Robot
    from drivers.wiring import Harmonic
    from programs.identify.identification import Identification
    from programs.identify.measured import Measured

_TURNS_S = 60.0
"""Period of an excitation that moves links through most of their range [s]."""


@step(
    JOINTS,
    click.option("--seconds", default=120.0, show_default=True, type=Range(20, 600)),
    order=7,
)
def encoders(identification: "Identification", joints: tuple[str, ...], seconds: float) -> bool:
    """Identify periodic errors of the link encoders: all joints move slowly through their ranges.

    Optional: not required for arming. Once the daemon has loaded the errors, it subtracts them from
    the samples. Needs position encoders at the motors.
    """
    names = identification.joints(joints)
    turns_s = _TURNS_S, _TURNS_S
    measured = identification.measured(
        lambda arm: arm.excite("encoders", seconds, seed=1, turns_s=turns_s)
    )
    with identification.busy("fitting the encoders' errors"):
        outcome = _outcome(identification.robot, measured, names, now())
    return identification.conclude("encoders", outcome)


def _outcome(robot: "Robot", measured: "Measured", joints: list[str], date: str) -> Outcome:
    """Outcome with the periodic errors of the named joints' link encoders, added to the corrections
    in force; joints without a finding keep theirs."""
    from daemon.config.identified import EncodersEntry, Entry
    from identification.link_encoder import link_encoder

    lines, entries = [], dict[str, Entry]()
    for name in joints:
        joint = robot.configuration.joints[robot.configuration.joint_names.index(name)]
        wiring = joint.wiring
        found = link_encoder(measured.log, measured.log.joints.index(name), wiring.link_offset,
                             wiring.gear, joint.torque_constant,
                             (joint.limits.lower, joint.limits.upper))  # fmt: skip
        good, figures = bool(found.harmonics), ""
        if good:
            figures = ", ".join(
                f"{1e3 * math.hypot(cosine, sine):.2f} mrad {order} x per turn"
                for order, cosine, sine in found.harmonics
            )
            figures += (f"; leaves {found.left:.0%} of the scatter, accurate to "
                        f"{1e3 * found.interval:.1g} mrad")  # fmt: skip
            entries[name] = EncodersEntry(
                date=date,
                log=measured.sha256,
                link_correction=_together(wiring.link_correction, found.harmonics),
                left=round(found.left, 3),
            )
        lines.append(Line(name, "found" if good else "nothing found", good, figures, found.reason))
    return Outcome(lines=lines, entries=entries, notes=measured.notes)


def _together(
    old: "list[Harmonic]", found: tuple[tuple[int, float, float], ...]
) -> "list[Harmonic]":
    """Sum of the old harmonics and the remaining errors that were found."""
    from drivers.wiring import Harmonic

    table = {h.order: (h.cosine, h.sine) for h in old}
    for order, cosine, sine in found:
        before = table.get(order, (0.0, 0.0))
        table[order] = (before[0] + cosine, before[1] + sine)
    return [
        Harmonic(order=order, cosine=round(float(c), 7), sine=round(float(s), 7))
        for order, (c, s) in sorted(table.items())
    ]
