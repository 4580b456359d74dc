"""Step `friction`: friction and rotor inertia of all joints."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import click

from programs.command_line.options import Range
from programs.identify.step import Line, Outcome, now, step

if TYPE_CHECKING:
    from daemon.config.identified import FrictionEntry
    from daemon.config.load import Robot
    from estimator.transmission import Transmission
    from identification.friction_fit import FrictionFit
    from programs.identify.identification import Identification
    from programs.identify.measured import Measured

_SHORTEST_S = 10.0


@step(
    click.option("--seconds", default=60.0, show_default=True, type=Range(20, 600)),
    click.option("--shortest", default=_SHORTEST_S, show_default=True, type=Range(5, 600),
                 help="Motion that a log must contain [s]; below 10 at your own risk."),
    click.option("--direct", multiple=True, metavar="JOINT",
                 help="Measure the friction of this joint (may be repeated; or `all`) alone, to "
                 "and fro at several loads and speeds, and compare; nothing is changed."),
    quality=lambda entry: f"R2 {entry.r2:.3f}",
    order=6,
)  # fmt: skip
def friction(
    identification: "Identification", seconds: float, shortest: float, direct: tuple[str, ...]
) -> bool:
    """Identify friction and rotor inertia: all joints move, without contact."""
    if direct:
        from programs.identify.direct_motion import STEP, measure_directly
        from programs.identify.direct_outcome import direct_outcome

        named = identification.joints(tuple(name for name in direct if name != "all"))
        joints = identification.joints(() if "all" in direct else tuple(dict.fromkeys(named)))
        measured = identification.measured(partial(measure_directly, joints=joints))
        outcome = direct_outcome(identification.robot, measured, joints)
        return identification.conclude("friction", outcome, STEP)
    measured = identification.measured(lambda arm: arm.excite("friction", seconds, seed=1))
    with identification.busy("fitting friction and rotor inertia"):
        outcome = friction_outcome(identification.robot, measured, now(), shortest)
    return identification.conclude("friction", outcome)


def friction_outcome(
    robot: "Robot", measured: "Measured", date: str, shortest_s: float = _SHORTEST_S
) -> Outcome:
    """Outcome with friction and rotor inertia of all joints from contact-free motion of at least
    `shortest_s`. Raises LogError for implausible measurements."""
    import numpy as np

    from daemon.assembly import build_transmission
    from daemon.config.vectors import row
    from identification.friction import identify_friction
    from identification.friction_errors import with_steps
    from identification.friction_fit import adopt
    from identification.friction_verdict import Verdict
    from identification.limit_cycle import limit_cycles
    from identification.log_checks import refuse_implausible
    from identification.log_scale import refuse_other_scale
    from programs.identify.friction_notes import (
        load_doubts,
        off_scale,
        rotor_doubts,
        wide_intervals,
    )
    from programs.identify.guesses import guessed_constants
    from programs.identify.limit_cycle_watch import limit_cycle_sentence, limit_cycle_sentences
    from programs.identify.log_notes import late_encoders, offsets
    from programs.identify.plots import plot_friction

    c, log = robot.configuration, measured.log
    limit = row(c, lambda j: j.wiring.max_current_A)
    refuse_implausible(log, limit)
    old = build_transmission(c)
    model = robot.model
    cycles = limit_cycles(log, measured.reference, old.half_gap)
    weighed = any(joint.body is not None for joint in c.joints)
    by_urdf = robot.by_hand.model if weighed and robot.by_hand else None
    makes = [joint.wiring.profile for joint in c.joints]
    fits, shown = identify_friction(
        log, model, old, c.estimator, limit, shortest_s,
        weighed=weighed, by_urdf=by_urdf, makes=makes, guessed=guessed_constants(robot),
    )  # fmt: skip
    stiffness = row(c, lambda j: getattr(c.drives[j.wiring.profile], "stiffness", 0.0))
    fits = with_steps(fits, stiffness * c.period_s)
    gain = None if measured.reference is None else measured.gain or c.control.position_gain
    if gain is not None:
        # Oscillation in a gap resembles friction, and would fit well.
        swings = limit_cycle_sentences(cycles, gain)
        fits = [
            replace(fit, verdict=Verdict.SWINGS, reason="; ".join(filter(None, (why, fit.reason))))
            if (why := swings.get(fit.joint))
            else fit
            for fit in fits
        ]
    new = adopt(old, fits)
    good = [fit.verdict is Verdict.GOOD for fit in fits]
    if measured.reference is None and any(good):
        refuse_other_scale(log, model, old, c.estimator, limit)
    lines = [
        Line(fit.joint, fit.verdict.value, fits_well, _figures(fit), fit.reason)
        for fit, fits_well in zip(fits, good, strict=True)
    ]
    entries = {
        fit.joint: _entry(robot, measured, date, i, fit, new)
        for i, fit in enumerate(fits)
        if good[i]
    }
    notes = measured.notes + wide_intervals(fits, masses_identified=weighed)
    if now_and_then := [one for one in cycles if gain is None or not one.spoils]:
        notes += (limit_cycle_sentence(now_and_then, gain),)
    if shown.touched:
        notes += (f"{shown.discarded_s:.1f} s discarded: {', '.join(shown.touched)} was touched, "
                  "or hit something",)  # fmt: skip
    notes += late_encoders(c.joint_names, shown.late)
    notes += off_scale(fits) + load_doubts(fits)
    notes += offsets(c, np.array([fit.offset for fit in fits]))
    draw = partial(plot_friction, log, shown)
    costs = [joint.rotor_inertia * joint.limits.acceleration for joint in c.joints]
    notes += rotor_doubts(fits, costs)
    return Outcome(lines=lines, entries={**entries}, notes=notes, draw=draw)


def _entry(
    robot: "Robot", measured: "Measured", date: str, i: int, fit: "FrictionFit", new: "Transmission"
) -> "FrictionEntry":
    """Entry of joint i, with the coefficients of `new`."""
    from daemon.config.identified import FrictionEntry
    from daemon.config.schema import Friction, GapSpring

    names = [name for name in Friction.__struct_fields__ if name not in ("stiction", "load")]
    values = {name: round(float(getattr(new, name)[i]), 6) for name in names}
    stated = robot.configuration.joints[i].friction.stiction
    return FrictionEntry(
        date=date,
        log=measured.sha256,
        friction=Friction(
            **values,
            stiction=round(fit.stiction, 6) if fit.stiction_known else stated,
            load=fit.load and (round(fit.load[0], 4), round(fit.load[1], 4)),
        ),
        errors={
            name: float(f"{e:.3g}")
            for name, e in fit.errors.items()
            if name != "B" or fit.rotor_trusted
        },
        r2=round(fit.r2, 4),
        condition=round(fit.condition, 2),
        gap_spring=GapSpring(
            stiffness=round(float(new.contact_stiffness[i]), 4),
            damping=round(float(new.contact_damping[i]), 4),
        ),
        rotor_inertia=round(float(new.rotor_inertia[i]), 6) if fit.rotor_trusted else None,
    )


def _figures(fit: "FrictionFit") -> str:
    """Values in words, each with the half-width of its 95 % confidence interval."""
    from identification.regression import NORMAL_95

    def one(name: str, unit: str) -> str:
        if name not in fit.values:
            return ""
        return f"{name} {fit.values[name]:.3g} +- {fit.half_interval(name):.2g} {unit}"

    parts = [one("K_theta_s", "Nm"), one("K_theta_v", "Nm s/rad")]
    parts.append(one("B", "kg m2") if fit.rotor_trusted else "B rejected")
    if fit.stiction_known:
        parts.append(f"stiction {fit.stiction:.2f} +- {NORMAL_95 * fit.stiction_error:.1g}")
    if fit.load:
        parts.append("load {:.3f} to {:.3f}".format(*fit.load))
    elif fit.load_bound < 0.5:
        parts.append(f"load below {fit.load_bound:.2g}")
    parts += [f"R2 {fit.r2:.3f}", f"cond {fit.condition:.0f}"]
    if math.isfinite(fit.gravity_scale):
        parts.append(f"K_c/gravity {fit.gravity_scale:.2f}")
    return ", ".join(part for part in parts if part)
