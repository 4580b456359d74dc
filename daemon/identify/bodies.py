"""Steps of the identification that find masses: of the arm's bodies, and of a load in its hand."""

from dataclasses import replace

import msgspec
import numpy as np

from daemon.assembly import build_transmission
from daemon.config import identified as file
from daemon.config.checks import names_payload
from daemon.config.dynamics import model_of
from daemon.config.load import Robot
from daemon.config.marks import marks
from daemon.config.motion import row
from daemon.config.schema import Configuration
from daemon.config.worst_loads import Carrying
from daemon.identify.measured import Measured
from daemon.identify.steps import Line, Outcome, late_encoders, offsets
from daemon.identify.swinging import told
from errors import ConfigurationError
from estimator.body_inertia import BodyInertia
from estimator.identification.limit_cycle import limit_cycles
from estimator.identification.log_checks import refuse_implausible
from estimator.identification.masses import (
    SHORTEST_S,
    Masses,
    MassesFit,
    MassesVerdict,
    identify_masses,
)
from estimator.identification.payload_fit import PayloadFit, PayloadVerdict, identify_payload
from estimator.payload import Payload

_BY_URDF, _IDENTIFIED = 0.05, 0.01
"""Shares by which what the joints move may be off while a load is weighed."""


def masses_step(
    robot: Robot, measured: Measured, date: str, shortest_s: float = SHORTEST_S
) -> Outcome:
    """Identify what the joints move, from contact-free motion of at least `shortest_s` with an
    empty hand; entries for all joints, or for none.

    Raises LogError for measurements that cannot be true.
    """
    c = robot.configuration
    limit = np.array([joint.wiring.max_current_A for joint in c.joints])
    refuse_implausible(measured.log, limit)
    # The pull is towards the URDF, whatever was identified before.
    model = model_of(robot.by_hand or c, robot.urdf)
    limits = row(c, lambda j: j.limits.lower), row(c, lambda j: j.limits.upper)
    found = identify_masses(
        measured.log, model, build_transmission(c), c.estimator, limit, limits, shortest_s
    )
    found = replace(found, fits=_standing(found.fits, measured, c))
    nominal = [BodyInertia.of(p) if p[0] > 0.0 else None for p in model.parameters()]
    lines = [
        Line(
            fit.joint,
            fit.verdict.value,
            fit.verdict in (MassesVerdict.GOOD, MassesVerdict.AS_GOOD),
            _masses_figures(fit, before),
            fit.reason,
        )
        for fit, before in zip(found.fits, nominal, strict=True)
    ]
    notes = measured.notes + late_encoders(c.joint_names, found.late) + offsets(c, found.offset)
    notes += _masses_notes(found)
    entries: dict[str, file.Entry] = {}
    if found.usable:
        entries = {
            fit.joint: file.MassesEntry(
                date=date,
                log=measured.sha256,
                body=fit.body,
                by_urdf=float(f"{fit.by_urdf:.4g}"),
                by_this=float(f"{fit.by_this:.4g}"),
            )
            for fit in found.fits
            if fit.body is not None
        }
    return Outcome(lines, entries, notes)


def _standing(fits: list[MassesFit], measured: Measured, c: Configuration) -> list[MassesFit]:
    """Fits, without those of joints that swung by themselves, as far as that shows."""
    if measured.reference is None:
        return fits
    cycles = limit_cycles(measured.log, measured.reference, row(c, lambda j: j.half_gap))
    why = {one.joint: told([one], c.control.position_gain) for one in cycles if one.spoils}
    return [
        replace(fit, verdict=MassesVerdict.SWINGS, reason=why[fit.joint])
        if fit.joint in why
        else fit
        for fit in fits
    ]


def _masses_figures(fit: MassesFit, nominal: BodyInertia | None) -> str:
    parts = [f"|r| {fit.by_urdf:.3g} Nm by the URDF, {fit.by_this:.3g} by this, held out"]
    if fit.body is not None and nominal is not None:
        moved = np.linalg.norm(np.subtract(fit.body.com, nominal.com))
        parts.append(f"{fit.body.mass:.3g} kg of {nominal.mass:.3g}")
        parts.append(f"centre moved {1e3 * moved:.0f} mm")
    return ", ".join(parts)


def _masses_notes(found: Masses) -> tuple[str, ...]:
    notes = [f"the motion tells {found.told} combinations of {found.parameters} parameters; what "
             "it does not tell stays as near to the URDF as it can"]  # fmt: skip
    if found.touched:
        notes.append(f"{found.discarded_s:.1f} s discarded: {', '.join(found.touched)} was "
                     "touched, or met something")  # fmt: skip
    bad = [f.joint for f in found.fits
           if f.verdict not in (MassesVerdict.GOOD, MassesVerdict.AS_GOOD)]  # fmt: skip
    if bad:
        notes.append(f"masses are those of the whole arm: none is used while {', '.join(bad)} is "
                     "not good")  # fmt: skip
    elif not found.usable:
        notes.append("no joint is better by other masses: the URDF's stay. Where friction is not "
                     "known well, `contactd identify friction` says how long a motion tells it "
                     "better")  # fmt: skip
    else:
        notes.append("they count once the daemon has taken them up; friction and thresholds "
                     "belong to them: identify both again")  # fmt: skip
    return tuple(notes)


def refuse_name(name: str) -> None:
    """Raises ConfigurationError for a name that `contactctl payload` would not take for one."""
    if not names_payload(name) or not name.isprintable() or not 0 < len(name) <= 64:
        raise ConfigurationError(
            f"{name!r} is no name of a payload: a word of at most 64 letters, no number and not "
            "`none`"
        )


def payload_step(robot: Robot, measured: Measured, name: str, date: str) -> Outcome:
    """Identify the load in the hand, for `contactctl payload NAME`, from contact-free motion.

    Raises LogError for measurements that cannot be true.
    """
    c = robot.configuration
    limit = np.array([joint.wiring.max_current_A for joint in c.joints])
    refuse_implausible(measured.log, limit)
    model = model_of(c, robot.urdf)
    identified = c.joints[model.hand_joint].body is not None
    fit = identify_payload(
        measured.log,
        model,
        build_transmission(c),
        c.estimator,
        limit,
        _IDENTIFIED if identified else _BY_URDF,
    )
    notes, payloads = list(measured.notes), dict[str, file.IdentifiedPayload]()
    if fit.touched:
        notes.append(f"{fit.discarded_s:.1f} s discarded: {', '.join(fit.touched)} was touched, or "
                     "met something")  # fmt: skip
    good = fit.verdict is PayloadVerdict.GOOD
    line = Line(name, fit.verdict.value, good, _figures(fit, model.hand), fit.reason)
    if line.good:
        load = Payload.of(round(fit.mass, 4), [round(float(x), 4) for x in fit.com])
        if weak := Carrying(c, robot.urdf).too_heavy(load):
            line = replace(line, verdict="too heavy", good=False, reason="; ".join(weak))
        else:
            payloads[name] = file.IdentifiedPayload(
                date=date,
                log=measured.sha256,
                of=marks(c, robot.urdf)["friction"],
                mass=load.mass,
                com=(load.com[0], load.com[1], load.com[2]),
                mass_error=float(f"{fit.mass_error:.3g}"),
                com_error=float(f"{fit.com_error:.3g}"),
            )
            place = " ".join(f"{x:g}" for x in load.com)
            notes.append(f"`contactctl payload {name}` once the daemon has taken it up; now "
                         f"`contactctl payload {load.mass:g} --com {place}`")  # fmt: skip
            if not identified:
                notes.append("the arm's masses are by the URDF, and may be 5 % off: "
                             "`contactd identify masses` makes this surer")  # fmt: skip
    return Outcome([line], {}, tuple(notes), payloads=payloads)


def _figures(fit: PayloadFit, hand: str) -> str:
    if not np.isfinite(fit.mass_error):
        return ""
    place = " ".join(f"{x:.3f}" for x in fit.com)
    return (f"{fit.mass:.3g} +- {fit.mass_error:.2g} kg at ({place}) m of {hand}, "
            f"+- {1e3 * fit.com_error:.0f} mm")  # fmt: skip


def merged_payloads(robot: Robot, found: dict[str, file.IdentifiedPayload]) -> file.Identified:
    """Content of the robot's file with these loads in it."""
    old = robot.identified or file.Identified()
    return msgspec.structs.replace(old, payloads=old.payloads | found)
