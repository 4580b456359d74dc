"""Cross-checks between the fields of a configuration; all problems are listed at once."""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec

from common.errors import ConfigurationError, ModelError
from daemon.config.bounds import beyond
from daemon.config.drive_checks import bus_load, counts, profiles
from daemon.config.identified import Identified, used_entries
from daemon.config.mistakes import likely_mistakes
from daemon.config.problem import Problem, at, figure
from daemon.config.schema import NO_PAYLOAD, Configuration, Joint, JointLimits
from daemon.config.trajectories import trajectory_checks
from daemon.config.vectors import guide_of
from daemon.config.worst_loads import PayloadCapacity
from daemon.motion.guidance import guide_place
from drivers.canopen.boot.data_sheet import load_data_sheet
from drivers.canopen.settings import CanopenProfile
from estimator.body_inertia import refuse_impossible
from estimator.model import Model
from estimator.payload import Payload
from estimator.thresholds import LEAST_SHARE
from estimator.urdf import joint_ranges

_ROUNDING = 1e-9


def cross_checks(
    c: Configuration, urdf: str, model: Model | ModelError, folder: Path
) -> list[Problem]:
    """All problems of a configuration whose types and ranges are valid.

    model: of the URDF's links, or the reason why there is none. Paths are relative to `folder`.
    """
    meant = _limits_in_order(c)
    findings = [
        *_names_and_nodes(c),
        *_joints(c),
        *_estimator(c),
        *profiles(c, folder),
        *counts(meant),
        *trajectory_checks(meant),
        *_poses(meant),
        *_urdf(meant, urdf, model),
        *_guide(c, model),
    ]
    if isinstance(model, ModelError):
        return findings
    # Values computed from several fields are checked only if each of these fields is valid.
    findings = findings or [*beyond(c, model), *bus_load(c), *_payloads(c, model)]
    # The refused field may be right, and the one that its bound derives from wrong.
    return findings and [*findings, *suspects(meant, urdf, folder)]


def identified_checks(
    c: Configuration, found: Identified, urdf: str, model: Model | ModelError, folder: Path
) -> list[Problem]:
    """All problems that identified values can cause in a configuration that is valid without them:
    `cross_checks` without those of fields that no step identifies."""
    findings = [*_joints(c), *least_levels(c, found), *counts(c), *_urdf(c, urdf, model)]
    if isinstance(model, ModelError):
        return findings
    findings = findings or [*beyond(c, model), *_payloads(c, model)]
    return findings and [*findings, *suspects(c, urdf, folder)]


def _limits_in_order(c: Configuration) -> Configuration:
    """Configuration with swapped limits put in order, so that consequences of the swap at other
    fields are not reported with it."""

    def ordered(joint: Joint) -> Joint:
        lower, upper = sorted((joint.limits.lower, joint.limits.upper))
        limits = msgspec.structs.replace(joint.limits, lower=lower, upper=upper)
        return msgspec.structs.replace(joint, limits=limits)

    return msgspec.structs.replace(c, joints=[ordered(joint) for joint in c.joints])


def suspects(c: Configuration, urdf: str, folder: Path) -> list[Problem]:
    """Likely mistakes, in a configuration whose joints are those of the URDF; none if an EDS cannot
    be read."""
    try:
        sheets = {
            name: load_data_sheet(folder / profile.eds)
            for name, profile in c.drives.items()
            if isinstance(profile, CanopenProfile)
        }
    except ConfigurationError:
        return []
    if any(joint.wiring.profile not in c.drives for joint in c.joints):
        return []
    return likely_mistakes(c, urdf, sheets)


def _names_and_nodes(c: Configuration) -> Iterator[Problem]:
    names = Counter(c.joint_names)
    nodes = Counter(joint.wiring.node for joint in c.joints)
    for i, joint in enumerate(c.joints):
        if names[joint.name] > 1:
            yield Problem(*at(i, joint, "name"), "two joints have this name")
        if nodes[joint.wiring.node] > 1:
            others = [
                o.name for o in c.joints if o.wiring.node == joint.wiring.node and o is not joint
            ]
            yield Problem(
                *at(i, joint, "wiring", "node"),
                f"node {joint.wiring.node} is also that of {', '.join(others)}; "
                "each drive needs a node id of its own",
            )
        if joint.wiring.node == c.bus.master_node:
            yield Problem(
                *at(i, joint, "wiring", "node"),
                f"node {joint.wiring.node} is the master's (bus.master_node)",
            )
        if joint.wiring.profile not in c.drives:
            yield Problem(
                *at(i, joint, "wiring", "profile"),
                f"no drive profile `{joint.wiring.profile}`; there are: {', '.join(c.drives)}",
            )


def _joints(c: Configuration) -> Iterator[Problem]:
    for i, joint in enumerate(c.joints):
        if joint.limits.lower >= joint.limits.upper:
            yield Problem(
                *at(i, joint, "limits", "lower"),
                f"{joint.limits.lower:g} must be less than upper ({joint.limits.upper:g})",
            )
        if joint.thresholds.contact >= joint.thresholds.collision:
            yield Problem(
                *at(i, joint, "thresholds", "contact"),
                f"{joint.thresholds.contact:g} must be less than collision "
                f"({joint.thresholds.collision:g})",
            )
        if joint.body is not None:
            try:
                refuse_impossible(joint.name, joint.body)
            except ModelError as error:
                yield Problem(*at(i, joint, "body", "inertia"), str(error))
        spring = joint.gap_spring
        if joint.half_gap == 0 and (spring.stiffness > 0 or spring.damping > 0):
            yield Problem(
                *at(i, joint, "gap_spring"),
                "must be zero where half_gap is 0: without a gap there are no borders",
            )
        if joint.half_gap > 0 and c.estimator.link_velocity == "motor":
            yield Problem(
                *at(i, joint, "half_gap"),
                "must be 0 with estimator.link_velocity: motor: in a gap the link moves by itself",
            )


def least_levels(c: Configuration, found: Identified | None = None) -> Iterator[Problem]:
    """Problems of `least` above the contact level in force, or below a fifth of a stated one."""
    for i, joint in enumerate(c.joints):
        least, most = joint.thresholds.least, joint.thresholds.contact
        words = f"{LEAST_SHARE * most:g} to {most:g} Nm: {LEAST_SHARE:g} to 1 times contact"
        lowest = LEAST_SHARE - _ROUNDING
        if "thresholds" in used_entries(joint, found):
            words, lowest = f"at most {most:g} Nm, contact of {c.identified}", 0.0
        if least is not None and not lowest <= least / most <= 1.0:
            yield Problem(*at(i, joint, "thresholds", "least"), f"{least:g} must be {words}")


def _guide(c: Configuration, model: Model | ModelError) -> Iterator[Problem]:
    for reason in guide_of(c).objections(len(c.joints)):
        yield Problem(["admittance"], "admittance", reason)
    if not isinstance(model, ModelError):
        try:
            guide_place(model, guide_of(c))
        except ModelError as error:
            yield Problem(["admittance", "frame"], "admittance.frame", str(error))


def _estimator(c: Configuration) -> Iterator[Problem]:
    gain, limit = c.estimator.gain, 2.0 / c.period_s
    if gain >= limit:
        yield Problem(
            ["estimator", "gain"],
            "estimator.gain",
            f"{gain:g} /s makes the residual oscillate at a period of {c.period_ms} ms: T K must "
            f"be less than 2, so less than {limit:g} /s",
        )
    variants = (c.estimator.residual, *c.estimator.beside)
    twice = [name for name, n in Counter(v.name for v in variants).items() if n > 1]
    if twice:
        yield Problem(
            ["estimator", "beside"],
            "estimator.beside",
            f"{', '.join(twice)} is listed twice, counting estimator.residual: list each once",
        )
    if any(one.kind == "two_mass" and not one.rotor_inertia for one in variants):
        yield Problem(
            ["estimator"],
            "estimator",
            "a two_mass residual with rotor_inertia: false has only one mass: choose classical",
        )
    least, most = c.estimator.presliding
    if least > most:
        yield Problem(
            ["estimator", "presliding"],
            "estimator.presliding",
            f"[{least:g}, {most:g}] rad: must be [minimum, maximum]",
        )
    if c.estimator.motor_position == "measured":
        for i, joint in enumerate(c.joints):
            profile = c.drives.get(joint.wiring.profile)
            if profile and not profile.sends_motor_position:
                yield Problem(
                    *at(i, joint, "wiring", "profile"),
                    f"`{joint.wiring.profile}` sends no motor_position, which "
                    "estimator.motor_position: measured needs: list it under `tpdo`, or choose "
                    "integrated",
                )


def _poses(c: Configuration) -> Iterator[Problem]:
    joints = {joint.name: joint.limits for joint in c.joints}
    for pose, values in c.poses.items():
        if "=" in pose or pose.startswith("-"):
            text = "`contactctl go` gives this name another meaning: choose another name"
            yield Problem(["poses", pose], f"poses.{pose}", text)
        for name, value in values.items():
            keys: list[str | int] = ["poses", pose, name]
            where = f"poses.{pose}.{name}"
            if name not in joints:
                yield Problem(keys, where, f"no such joint; there are: {', '.join(joints)}")
            elif not (joints[name].lower <= value <= joints[name].upper):
                limits = f"[{joints[name].lower:g}, {joints[name].upper:g}]"
                yield Problem(keys, where, f"{value:g} rad is outside its limits {limits}")


def _urdf(c: Configuration, urdf: str, model: Model | ModelError) -> Iterator[Problem]:
    try:
        movable = [one.joint for one in joint_ranges(urdf)]
        strangers = [
            Problem(
                *at(i, joint, "name"),
                f"{c.urdf} has no joint of this name that moves; it has {', '.join(movable)}",
            )
            for i, joint in enumerate(c.joints)
            if joint.name not in movable
        ]
        if strangers:
            yield from strangers
            return
        if isinstance(model, ModelError):
            raise model
    except ModelError as error:
        yield Problem(["urdf"], f"urdf ({c.urdf})", str(error))
        return
    for i, joint in enumerate(c.joints):
        lower, upper = float(model.lower[i]), float(model.upper[i])
        if joint.limits.lower < lower or joint.limits.upper > upper:
            yield Problem(
                *at(i, joint, "limits"),
                f"[{joint.limits.lower:g}, {joint.limits.upper:g}] goes beyond the URDF's "
                f"[{lower:g}, {upper:g}] rad{_suggestion(joint.limits, lower, upper)}",
            )


def _suggestion(limits: JointLimits, lower: float, upper: float) -> str:
    """Suggested mistake that would explain limits beyond [lower, upper]; may be empty."""
    for words, low, high in (
        ("in degrees?", math.radians(limits.lower), math.radians(limits.upper)),
        ("about the reversed axis?", -limits.upper, -limits.lower),
    ):
        # Any limits would fit as degrees: a suggestion that leaves nearly no range is omitted.
        wide = high - low >= 0.1 * (upper - lower)
        if wide and lower - 1e-3 <= low <= high <= upper + 1e-3:
            return f"; {words} then it is [{figure(low)}, {figure(high)}]"
    return ""


def _payloads(c: Configuration, model: Model) -> Iterator[Problem]:
    if not c.payloads:
        return
    capacity = PayloadCapacity(c, model)
    for name, entry in c.payloads.items():
        keys: list[str | int] = ["payloads", name]
        where = f"payloads.{name}"
        if not names_payload(name):
            text = "`contactctl payload` gives this name another meaning: choose another name"
            yield Problem(keys, where, text)
        com = model.tool_place.tolist() if entry.com is None else entry.com
        for reason in capacity.too_heavy(Payload.of(entry.mass, com)):
            yield Problem([*keys, "mass"], f"{where}.mass", reason)


def names_payload(name: str) -> bool:
    """True if `contactctl payload` interprets this word as the name of a payload."""
    try:
        float(name)
    except ValueError:
        return name != NO_PAYLOAD
    return False
