"""Steps of the identification: from measurements to entries of `identified.yaml` and to text."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from arrays import Vector
from daemon.assembly import build_transmission
from daemon.config import identified as file
from daemon.config.dynamics import model_of
from daemon.config.load import Robot
from daemon.config.marks import fingerprint, marks
from daemon.config.schema import AnyStep, Configuration, Friction, GapSpring
from daemon.identify.measured import Measured
from daemon.identify.surer import surer
from daemon.identify.swinging import told
from estimator.identification.friction import (
    SHORTEST_S,
    Reconstruction,
    identify_friction,
)
from estimator.identification.friction_fit import FrictionFit, adopt
from estimator.identification.friction_verdict import Verdict
from estimator.identification.gap import identify_gap
from estimator.identification.gap_result import GapResult
from estimator.identification.limit_cycle import LimitCycle, limit_cycles
from estimator.identification.log_checks import refuse_implausible
from estimator.identification.wiring import check_wiring, in_Nm

_SCALE = 0.1
"""Share by which gravity does not fit, that is told."""
_OFFSET = 0.01
"""Of the largest current, off all the time, that is told."""
_LATE_S = 0.001
"""Lateness of a link encoder beyond which it is told."""


@dataclass(frozen=True, slots=True)
class Line:
    """Result of a step for one joint, for a person."""

    joint: str
    verdict: str
    good: bool
    figures: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a step: lines for a person, entries for the file by joint, and data for plots."""

    lines: list[Line]
    entries: dict[str, file.Entry]
    notes: tuple[str, ...] = ()
    shown: Reconstruction | None = None
    gaps: list[GapResult] = field(default_factory=list)
    payloads: dict[str, file.IdentifiedPayload] = field(default_factory=dict)


def gap_step(
    robot: Robot, measured: Measured, joints: list[str], date: str, *, by_hand: bool = False
) -> Outcome:
    """Identify the half-gaps of the named joints, by what moved or `by_hand`."""
    names = robot.configuration.joint_names
    lines, entries, gaps = [], dict[str, file.Entry](), []
    for name in joints:
        i = names.index(name)
        joint = robot.configuration.joints[i]
        place = measured.log.joints.index(name)
        constant, gear = joint.torque_constant, joint.wiring.gear
        gap = identify_gap(measured.log, place, constant, gear, by_hand=by_hand)
        gaps.append(gap)
        figures = _gap_figures(gap)
        lines.append(Line(name, gap.verdict.value, gap.usable, figures, gap.reason))
        if gap.usable:
            entries[name] = file.GapEntry(
                date=date,
                log=measured.sha256,
                half_gap=round(float(gap.half_gap), 6),
                confidence=0.0 if np.isnan(gap.confidence) else round(float(gap.confidence), 6),
                skew_ms=None if np.isnan(gap.skew_s) else round(1e3 * float(gap.skew_s), 3),
            )
    return Outcome(lines, entries, measured.notes, gaps=gaps)


def _gap_figures(gap: GapResult) -> str:
    figures = ""
    if np.isfinite(gap.half_gap):
        figures = f"alpha {1e3 * gap.half_gap:.2f} mrad"
    elif np.isfinite(gap.estimate):
        figures = f"estimate, not used: alpha {1e3 * gap.estimate:.2f} mrad"
    if figures and np.isfinite(gap.confidence):
        figures += f" +- {1e3 * gap.confidence:.2f}"
    parts = [figures] if figures else []
    if np.isfinite(gap.skew_s):
        parts.append(f"link encoder {1e3 * gap.skew_s:+.2f} ms late")
    return "; ".join([*parts, *(str(one) for one in gap.harmonics)])


def friction_step(
    robot: Robot, measured: Measured, date: str, shortest_s: float = SHORTEST_S
) -> Outcome:
    """Identify friction and rotor inertia of all joints from contact-free motion of at least
    `shortest_s`.

    Raises LogError for measurements that cannot be true.
    """
    c = robot.configuration
    limit = np.array([joint.wiring.max_current_A for joint in c.joints])
    refuse_implausible(measured.log, limit)
    old = build_transmission(c)
    model = model_of(c, robot.urdf)
    cycles = limit_cycles(measured.log, measured.reference, old.half_gap)
    weighed = any(joint.body is not None for joint in c.joints)
    fits, shown = identify_friction(
        measured.log, model, old, c.estimator, limit, shortest_s, weighed=weighed
    )
    gain = None if measured.reference is None else measured.gain or c.control.position_gain
    if gain is not None:
        fits = _standing(fits, cycles, gain)
    new = adopt(old, fits)
    lines, entries = [], dict[str, file.Entry]()
    for i, fit in enumerate(fits):
        good = fit.verdict is Verdict.GOOD
        lines.append(Line(fit.joint, fit.verdict.value, good, _friction_figures(fit), fit.reason))
        if good:
            rotor = round(float(new.rotor_inertia[i]), 6) if fit.rotor_trusted else None
            names = [name for name in Friction.__struct_fields__ if name != "stiction"]
            values = {name: round(float(getattr(new, name)[i]), 6) for name in names}
            known = round(fit.stiction, 6) if fit.stiction_known else c.joints[i].friction.stiction
            entries[fit.joint] = file.FrictionEntry(
                date=date,
                log=measured.sha256,
                friction=Friction(**values, stiction=known),
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
                rotor_inertia=rotor,
            )
    notes = measured.notes + surer(fits, weighed=weighed)
    if now_and_then := [one for one in cycles if gain is None or not one.spoils]:
        notes += (told(now_and_then, gain),)
    if shown.touched:
        notes += (f"{shown.discarded_s:.1f} s discarded: {', '.join(shown.touched)} was touched, "
                  "or met something",)  # fmt: skip
    notes += late_encoders(c.joint_names, shown.late)
    notes += off_scale(fits)
    notes += offsets(c, np.array([fit.offset for fit in fits]))
    return Outcome(lines, entries, notes + _doubts(fits), shown)


def off_scale(fits: list[FrictionFit]) -> tuple[str, ...]:
    """Sentence about good fits by whose gravity torque constants or masses are off, or none."""
    about = [
        f"{fit.joint} by {100.0 * (fit.gravity_scale - 1.0):+.0f} %"
        for fit in fits
        if fit.verdict is Verdict.GOOD and abs(fit.gravity_scale - 1.0) > _SCALE
    ]
    if not about:
        return ()
    return (
        f"torque constants or masses are off: {', '.join(about)}. Friction and rotor are off by as "
        "much where it is `torque_constant`, and their errors say so: check it by the motor's data "
        "sheet first, as masses identified with it would hide that",
    )


def offsets(c: Configuration, offset: Vector) -> tuple[str, ...]:
    """Sentence about currents that show a torque (n,) [Nm] all the time, or none."""
    about = [
        f"{joint.name} by {by / joint.torque_constant:+.2f} A ({by:+.2g} Nm)"
        for joint, by in zip(c.joints, offset, strict=True)
        if abs(by) > _OFFSET * joint.torque_constant * joint.wiring.max_current_A
    ]
    if not about:
        return ()
    return (
        f"currents are off all the time: {', '.join(about)}, as far as masses are right "
        "(`contactd identify masses` tells the two apart). Have the drive find the zero of its "
        "current; the residual is off by as much",
    )


def late_encoders(joints: Sequence[str], late: Vector) -> tuple[str, ...]:
    """Sentence about link encoders that are later than the motor's (n,) [s], or none."""
    about = [
        f"{joint} by {1e3 * by:.1f} ms"
        for joint, by in zip(joints, late, strict=True)
        if by > _LATE_S
    ]
    if not about:
        return ()
    return (
        f"link encoders are late: {', '.join(about)}. This was taken into account here; for the "
        "arm at work give `estimator.link_position_delay_ms`, and repeat",
    )


def _doubts(fits: list[FrictionFit]) -> tuple[str, ...]:
    """Sentences about rotors that are not taken, one for each reason, with the joints' names."""
    good = [fit for fit in fits if fit.verdict is Verdict.GOOD]
    why = dict.fromkeys(fit.rotor_doubt for fit in good if fit.rotor_doubt)
    return tuple(
        f"B of {', '.join(fit.joint for fit in good if fit.rotor_doubt == doubt)} is not taken: "
        f"{doubt}"
        for doubt in why
    )


def _standing(fits: list[FrictionFit], cycles: list[LimitCycle], gain: float) -> list[FrictionFit]:
    """Fits, without those of joints that swung: what a gap does with each swing looks like friction
    of its own, and fits well."""
    why = {cycle.joint: told([cycle], gain) for cycle in cycles if cycle.spoils}
    return [
        replace(fit, verdict=Verdict.SWINGS, reason="; ".join(filter(None, (about, fit.reason))))
        if (about := why.get(fit.joint))
        else fit
        for fit in fits
    ]


def _friction_figures(fit: FrictionFit) -> str:
    def one(name: str, unit: str) -> str:
        if name not in fit.values:
            return ""
        return f"{name} {fit.values[name]:.3g} +- {fit.errors[name]:.1g} {unit}"

    parts = [one("K_theta_s", "Nm"), one("K_theta_v", "Nm s/rad")]
    parts.append(one("B", "kg m2") if fit.rotor_trusted else "B not taken")
    if fit.stiction_known:
        parts.append(f"stiction {fit.stiction:.2f} +- {fit.stiction_error:.1g}")
    parts += [f"R2 {fit.r2:.3f}", f"cond {fit.condition:.0f}"]
    if np.isfinite(fit.gravity_scale):
        parts.append(f"K_c/gravity {fit.gravity_scale:.2f}")
    return ", ".join(part for part in parts if part)


def wiring_step(robot: Robot, measured: dict[str, Measured], date: str) -> Outcome:
    """Check signs and scales of joints that were moved one by one; `measured` has a log of each."""
    c = robot.configuration
    model = model_of(c, robot.urdf)
    lines, entries = [], dict[str, file.Entry]()
    for name, one in measured.items():
        i = c.joint_names.index(name)
        joint = c.joints[i]
        found = check_wiring(one.log, i, model, joint.torque_constant)
        figures = f"link/motor {found.follows:.3f}" if np.isfinite(found.follows) else ""
        if np.isfinite(found.held):
            figures += f", holds {in_Nm(found.held)} of {in_Nm(found.gravity)} gravity"
        reason = "; ".join([*found.problems, *found.untold, *found.notes])
        verdict = "good" if found.passed else "wrong" if found.problems else "not told"
        lines.append(Line(name, verdict, found.passed, figures, reason))
        if found.passed:
            entries[name] = file.WiringEntry(
                date=date, log=one.sha256, follows=round(float(found.follows), 4)
            )
    return Outcome(lines, entries)


def wiring_goes_on(left: list[str], *, passed: bool) -> str:
    """How the check goes on after it was stopped, with these joints left."""
    if not passed:
        return "Nothing had passed: the same command begins anew"
    return f"What passed is kept: to go on, name {left[0]} and those that are left"


def merged(
    robot: Robot, step: AnyStep, entries: dict[str, file.Entry], serials: dict[str, int | None]
) -> file.Identified:
    """Content of the robot's file with the entries of one step in it.

    Entries of another drive are dropped. Those of another configuration stay, and say so by their
    mark, in case that it comes back; of a file of before, whose entries have none, they are
    dropped.
    """
    of = marks(robot.configuration, robot.urdf)
    joints = _marked(robot, of)
    for name, found in entries.items():
        entry = msgspec.structs.replace(found, of=of[step])
        known = joints.get(name, file.IdentifiedJoint(serial=serials.get(name)))
        if name in serials and known.serial != serials[name]:
            known = file.IdentifiedJoint(serial=serials[name])
        joints[name] = msgspec.structs.replace(known, **{step: entry})
    order = {name: joints[name] for name in robot.configuration.joint_names if name in joints}
    kept = robot.identified.payloads if robot.identified else {}
    return file.Identified(joints=order, payloads=kept)


def _marked(robot: Robot, of: dict[AnyStep, str]) -> dict[str, file.IdentifiedJoint]:
    """What the file has by joint, each entry with a mark of its own."""
    old = robot.identified or file.Identified()
    valid = old.configuration == fingerprint(robot.configuration, robot.urdf)

    def marked(joint: file.IdentifiedJoint) -> file.IdentifiedJoint:
        entries = {step: getattr(joint, step) for step in of}
        without = {step: entry for step, entry in entries.items() if entry and not entry.of}
        changes = {
            step: msgspec.structs.replace(entry, of=of[step]) if valid else None
            for step, entry in without.items()
        }
        return msgspec.structs.replace(joint, **changes)

    return {name: marked(joint) for name, joint in old.joints.items()}
