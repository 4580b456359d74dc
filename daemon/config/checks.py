"""Cross-checks between the fields of a configuration. All problems are listed at once."""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec

from daemon.config.bounds import beyond
from daemon.config.counts import unrepresentable
from daemon.config.dynamics import model_of
from daemon.config.mistakes import likely_mistakes
from daemon.config.problem import Keys, Problem, at, figure
from daemon.config.schema import NO_PAYLOAD, Configuration, Joint, JointLimits, drive_of
from daemon.config.worst_loads import Carrying
from drivers.boot.data_sheet import load_data_sheet
from drivers.boot.required_objects import DriveSetup, Place, problems
from drivers.can.bus_load import refuse_overload
from drivers.codec import LayoutError
from drivers.settings import PdoEntry
from errors import ConfigurationError, ModelError
from estimator.body_inertia import refuse_impossible
from estimator.payload import Payload
from estimator.urdf import joint_ranges


def cross_checks(configuration: Configuration, urdf: str, folder: Path) -> list[Problem]:
    """Everything wrong with a configuration whose types and ranges are right.

    `folder` is what its paths are relative to.
    """
    meant = _limits_in_order(configuration)
    findings = [
        *_names_and_nodes(configuration),
        *_joints(configuration),
        *_estimator(configuration),
        *_profiles(configuration, folder),
        *_counts(meant),
        *_trajectory(meant),
        *_poses(meant),
        *_urdf(meant, urdf),
    ]
    # What is computed from many fields can only be where each is right.
    findings = findings or [
        *beyond(configuration, urdf),
        *_load(configuration),
        *_payloads(configuration, urdf),
    ]
    # The field that is refused may be right, and measured by one that is not.
    return findings and [*findings, *suspects(meant, urdf, folder)]


def _limits_in_order(c: Configuration) -> Configuration:
    """The configuration with limits that were swapped the right way round: what follows from the
    swap, at other fields, is not told beside it."""

    def ordered(joint: Joint) -> Joint:
        lower, upper = sorted((joint.limits.lower, joint.limits.upper))
        limits = msgspec.structs.replace(joint.limits, lower=lower, upper=upper)
        return msgspec.structs.replace(joint, limits=limits)

    return msgspec.structs.replace(c, joints=[ordered(joint) for joint in c.joints])


def suspects(c: Configuration, urdf: str, folder: Path) -> list[Problem]:
    """What most likely is not meant; nothing where URDF or EDS cannot be read, or the joints of
    both are others."""
    try:
        model_of(c, urdf)
        sheets = {name: load_data_sheet(folder / drive.eds) for name, drive in c.drives.items()}
    except (ModelError, ConfigurationError):
        return []
    if any(joint.wiring.profile not in sheets for joint in c.joints):
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


def _estimator(c: Configuration) -> Iterator[Problem]:
    gain, limit = c.estimator.gain, 2.0 / c.period_s
    if gain >= limit:
        yield Problem(
            ["estimator", "gain"],
            "estimator.gain",
            f"{gain:g} /s makes the residual oscillate at a period of {c.period_ms} ms: T K must "
            f"be less than 2, so less than {limit:g} /s",
        )
    least, most = c.estimator.presliding
    if least > most:
        yield Problem(
            ["estimator", "presliding"],
            "estimator.presliding",
            f"[{least:g}, {most:g}] rad: at least comes first, at most second",
        )
    if c.estimator.motor_position == "measured":
        for i, joint in enumerate(c.joints):
            profile = c.drives.get(joint.wiring.profile)
            sent = profile and any("motor_position" in p for p in profile.tpdo.values())
            if profile and not sent:
                yield Problem(
                    *at(i, joint, "wiring", "profile"),
                    f"`{joint.wiring.profile}` sends no motor_position, which "
                    "estimator.motor_position: measured needs: list it under `tpdo`, or choose "
                    "integrated",
                )


def _profiles(c: Configuration, folder: Path) -> Iterator[Problem]:
    used = {joint.wiring.profile for joint in c.joints}
    for name, profile in c.drives.items():
        if name not in used:
            yield Problem(["drives", name], f"drives.{name}", "no joint uses this profile")
        yield from _data_sheet(c, name, folder)
        # A drive must survive one lost heartbeat of ours, which is sent every third of the time.
        if profile.master_timeout_ms < 3 * c.period_ms:
            yield Problem(
                ["drives", name, "master_timeout_ms"],
                f"drives.{name}.master_timeout_ms",
                f"{profile.master_timeout_ms} ms must be at least three periods "
                f"({3 * c.period_ms} ms)",
            )


def _data_sheet(c: Configuration, name: str, folder: Path) -> list[Problem]:
    """Contradictions between an EDS and a profile with the joints that use it, each once, at the
    field of the profile that asks for what is not there."""
    profile = c.drives[name]
    try:
        sheet = load_data_sheet(folder / profile.eds)
    except ConfigurationError as error:
        return [_in_profile(name, ("eds",), str(error))]
    setups = [
        DriveSetup(drive_of(joint, profile), sheet, joint.limits.velocity, joint.limits.quick_stop)
        for joint in c.joints
        if joint.wiring.profile == name
    ]
    try:
        found = [p for s in setups for p in problems(s, c.period_ms, c.bus.master_node)]
    except LayoutError as error:
        return [_in_profile(name, error.at, str(error))]
    return [_in_profile(name, p.at, f"{profile.eds}: {p.what}") for p in dict.fromkeys(found)]


def _in_profile(name: str, place: Place, what: str) -> Problem:
    keys: Keys = ["drives", name, *place]
    where = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return Problem(keys, where.removeprefix("."), what)


def _counts(c: Configuration) -> Iterator[Problem]:
    """What the counts of drives cannot hold: at the joint where it is one of several with such a
    drive, else at the scale that they share."""
    margin = c.supervisor.speed_margin
    for name, profile in c.drives.items():
        users = [(i, joint) for i, joint in enumerate(c.joints) if joint.wiring.profile == name]
        found: dict[PdoEntry, list[tuple[int, Joint, str]]] = {}
        for i, joint in users:
            for entry, what in unrepresentable(joint, profile, margin):
                found.setdefault(entry, []).append((i, joint, what))
        for entry, places in found.items():
            if len(places) == len(users):
                _, joint, what = places[0]
                yield _in_profile(name, (entry, "scale"), f"joint {joint.name}: {what}")
                continue
            for i, joint, what in places:
                yield Problem(*at(i, joint, "wiring", "gear"), f"{name}.{entry}: {what}")


def _trajectory(c: Configuration) -> Iterator[Problem]:
    joints = {joint.name: joint for joint in c.joints}
    if c.trajectory.file is not None and c.trajectory.sinusoids:
        yield Problem(
            ["trajectory", "file"],
            "trajectory.file",
            f"`{c.trajectory.file}` beside trajectory.sinusoids: give either a file or sinusoids",
        )
    for name, wave in c.trajectory.sinusoids.items():
        keys: list[str | int] = ["trajectory", "sinusoids", name]
        where = f"trajectory.sinusoids.{name}"
        if name not in joints:
            yield Problem(keys, where, f"no such joint; there are: {', '.join(joints)}")
            continue
        limits, omega = joints[name].limits, 2 * math.pi * wave.frequency_Hz
        if (peak := wave.amplitude * omega) > limits.velocity:
            yield Problem(
                keys, where, f"its speed of {peak:.3g} rad/s is above the limit {limits.velocity:g}"
            )
        # A w^2 |sin| with A w |cos| / ramp of a soft start, which may fall on any phase.
        peak = wave.amplitude * omega * math.hypot(omega, 1.0 / c.trajectory.ramp_s)
        if peak > limits.acceleration:
            yield Problem(
                keys,
                where,
                f"its acceleration of {peak:.3g} rad/s2 (a soft start included) is above the limit "
                f"{limits.acceleration:g}",
            )
        if 2 * wave.amplitude > limits.upper - limits.lower:
            yield Problem(
                keys,
                where,
                f"its swing of {2 * wave.amplitude:g} rad does not fit between the limits "
                f"{limits.lower:g} and {limits.upper:g}",
            )


def _poses(c: Configuration) -> Iterator[Problem]:
    joints = {joint.name: joint.limits for joint in c.joints}
    for pose, values in c.poses.items():
        if "=" in pose or pose.startswith("-"):
            text = "a name that `contactctl go` takes for something else"
            yield Problem(["poses", pose], f"poses.{pose}", text)
        for name, value in values.items():
            keys: list[str | int] = ["poses", pose, name]
            where = f"poses.{pose}.{name}"
            if name not in joints:
                yield Problem(keys, where, f"no such joint; there are: {', '.join(joints)}")
            elif not (joints[name].lower <= value <= joints[name].upper):
                limits = f"[{joints[name].lower:g}, {joints[name].upper:g}]"
                yield Problem(keys, where, f"{value:g} rad is outside its limits {limits}")


def _urdf(c: Configuration, urdf: str) -> Iterator[Problem]:
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
        model = model_of(c, urdf)
    except ModelError as error:
        yield Problem(["urdf"], f"urdf ({c.urdf})", str(error))
        return
    for i, joint in enumerate(c.joints):
        lower, upper = float(model.lower[i]), float(model.upper[i])
        if joint.limits.lower < lower or joint.limits.upper > upper:
            yield Problem(
                *at(i, joint, "limits"),
                f"[{joint.limits.lower:g}, {joint.limits.upper:g}] goes beyond the URDF's "
                f"[{lower:g}, {upper:g}] rad{_meant(joint.limits, lower, upper)}",
            )


def _meant(limits: JointLimits, lower: float, upper: float) -> str:
    """How limits beyond [lower, upper] would fit, in words."""
    for words, low, high in (
        ("in degrees?", math.radians(limits.lower), math.radians(limits.upper)),
        ("about the axis the other way round?", -limits.upper, -limits.lower),
    ):
        # In degrees any limits would fit: those that leave next to nothing were not meant so.
        wide = high - low >= 0.1 * (upper - lower)
        if wide and lower - 1e-3 <= low <= high <= upper + 1e-3:
            return f"; {words} then it is [{figure(low)}, {figure(high)}]"
    return ""


def _payloads(c: Configuration, urdf: str) -> Iterator[Problem]:
    if not c.payloads:
        return
    model, carrying = model_of(c, urdf), Carrying(c, urdf)
    for name, entry in c.payloads.items():
        keys: list[str | int] = ["payloads", name]
        where = f"payloads.{name}"
        if not names_payload(name):
            yield Problem(keys, where, "a name that `contactctl payload` takes for something else")
        com = model.tool_place.tolist() if entry.com is None else entry.com
        for reason in carrying.too_heavy(Payload.of(entry.mass, com)):
            yield Problem([*keys, "mass"], f"{where}.mass", reason)


def names_payload(name: str) -> bool:
    """True if `contactctl payload` can take such a word for the name of a payload."""
    try:
        float(name)
    except ValueError:
        return name != NO_PAYLOAD
    return False


def _load(c: Configuration) -> Iterator[Problem]:
    try:
        refuse_overload(c.joint_drives, c.period_s, c.bus.bitrate)
    except ConfigurationError as error:
        yield Problem(["bus", "bitrate"], "bus.bitrate", str(error))
