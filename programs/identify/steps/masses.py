"""Step `masses`: masses and centres of mass of the bodies that the joints move."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

from dataclasses import replace
from math import dist
from typing import TYPE_CHECKING

import click

from programs.command_line.options import Range
from programs.identify.step import Line, Outcome, now, step

if TYPE_CHECKING:
    from daemon.config.load import Robot
    from estimator.body_inertia import BodyInertia
    from identification.masses import Masses, MassesFit
    from programs.identify.identification import Identification
    from programs.identify.measured import Measured

_SHORTEST_S = 20.0


@step(
    click.option("--seconds", default=60.0, show_default=True, type=Range(20, 600)),
    click.option("--shortest", default=_SHORTEST_S, show_default=True, type=Range(5, 600),
                 help="Motion that a log must contain [s]; below 20 at your own risk."),
    quality=lambda entry: (
        f"{entry.body.mass:.3g} kg, |r| {entry.by_urdf:.2g} -> {entry.by_this:.2g} Nm"
    ),
    order=4,
)  # fmt: skip
def masses(identification: "Identification", seconds: float, shortest: float) -> bool:
    """Identify masses and centres of mass: all joints move, without contact, with an empty hand.

    Needed if those of the URDF are wrong, which `friction` reports. They are used instead of the
    URDF's; the file is not changed. Identify friction and thresholds afterwards.
    """
    measured = identification.measured(lambda arm: arm.excite("masses", seconds, seed=3))
    with identification.busy("fitting masses"):
        outcome = masses_outcome(identification.robot, measured, now(), shortest)
    return identification.conclude("masses", outcome)


def masses_outcome(
    robot: "Robot", measured: "Measured", date: str, shortest_s: float = _SHORTEST_S
) -> Outcome:
    """Outcome with the bodies that the joints move, from contact-free motion of at least
    `shortest_s` with an empty hand; entries for all joints or none. Raises LogError for implausible
    measurements."""
    from daemon.assembly import build_transmission
    from daemon.config.identified import MassesEntry
    from daemon.config.vectors import row
    from estimator.body_inertia import BodyInertia
    from identification.limit_cycle import limit_cycles
    from identification.log_checks import refuse_implausible
    from identification.log_scale import refuse_other_scale
    from identification.masses import MassesVerdict, identify_masses
    from programs.identify.guesses import refuse_guessed_constants
    from programs.identify.limit_cycle_watch import limit_cycle_sentences
    from programs.identify.log_notes import late_encoders, offsets

    refuse_guessed_constants(robot)
    c = robot.configuration
    limit = row(c, lambda j: j.wiring.max_current_A)
    refuse_implausible(measured.log, limit)
    # The fit is regularised towards the URDF, not towards earlier results.
    model = (robot.by_hand or robot).model
    limits = row(c, lambda j: j.limits.lower), row(c, lambda j: j.limits.upper)
    found = identify_masses(
        measured.log, model, build_transmission(c), c.estimator, limit, limits, shortest_s
    )
    if measured.reference is None and found.usable:  # wiring is checked on the arm
        refuse_other_scale(measured.log, model, build_transmission(c), c.estimator, limit)
    half_gap, reference = row(c, lambda j: j.half_gap), measured.reference
    cycles = [] if reference is None else limit_cycles(measured.log, reference, half_gap)
    swings = limit_cycle_sentences(cycles, c.control.position_gain)
    fits = [
        replace(fit, verdict=MassesVerdict.SWINGS, reason=swings[fit.joint])
        if fit.joint in swings
        else fit
        for fit in found.fits
    ]
    found = replace(found, fits=fits)
    nominal = [BodyInertia.of(p) if p[0] > 0.0 else None for p in model.parameters()]
    lines = [
        Line(fit.joint, fit.verdict.value, fit.good, _figures(fit, before), fit.reason)
        for fit, before in zip(found.fits, nominal, strict=True)
    ]
    entries = {
        fit.joint: MassesEntry(
            date=date,
            log=measured.sha256,
            body=fit.body,
            by_urdf=float(f"{fit.by_urdf:.4g}"),
            by_this=float(f"{fit.by_this:.4g}"),
            errors=() if fit.errors is None else tuple(float(f"{e:.3g}") for e in fit.errors),
        )
        for fit in found.fits
        if found.usable and fit.body is not None
    }
    notes = measured.notes + late_encoders(c.joint_names, found.late) + offsets(c, found.offset)
    return Outcome(lines=lines, entries={**entries}, notes=notes + _notes(found))


def _figures(fit: "MassesFit", nominal: "BodyInertia | None") -> str:
    from identification.regression import NORMAL_95

    parts = [f"|r| {fit.by_urdf:.3g} Nm by the URDF, {fit.by_this:.3g} by this, held out"]
    if fit.body is not None and nominal is not None:
        half = "" if fit.errors is None else f" +- {NORMAL_95 * fit.errors[0]:.2g}"
        parts.append(f"{fit.body.mass:.3g}{half} kg of {nominal.mass:.3g}")
        parts.append(f"centre moved {1e3 * dist(fit.body.com, nominal.com):.0f} mm")
    return ", ".join(parts)


def _notes(found: "Masses") -> tuple[str, ...]:
    notes = [f"the motion determines {found.determined} combinations of {found.parameters} "
             "parameters; the others stay as close to the URDF as possible"]  # fmt: skip
    if found.touched:
        notes.append(f"{found.discarded_s:.1f} s discarded: {', '.join(found.touched)} was "
                     "touched, or hit something")  # fmt: skip
    if bad := [fit.joint for fit in found.fits if not fit.good]:
        notes.append(f"masses are fitted for the whole arm: none is used while {', '.join(bad)} is "
                     "not good")  # fmt: skip
    elif not found.usable:
        notes.append("no joint is clearly better with other masses: the URDF's stay. If friction "
                     "is not known well, `contactd identify friction` reports how long a motion "
                     "it needs")  # fmt: skip
    else:
        notes.append("they are used once the daemon has taken them up; friction and thresholds "
                     "depend on them: identify both again")  # fmt: skip
    return tuple(notes)
