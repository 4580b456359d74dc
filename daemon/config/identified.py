"""`identified.yaml`: the parameters that `contactd identify` found, beside the configuration.

Each joint has an entry per step, written when the step passed. Values here replace those of
`config.yaml`; the daemon refuses to arm with a file that belongs to other drives or to another
configuration of them.
"""

import os
import tempfile
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import yaml
from msgspec import Meta

from daemon.config.marks import fingerprint, marks
from daemon.config.problem import Keys
from daemon.config.schema import Configuration, Friction, GapSpring, Joint, Levels, Step
from daemon.protocol.messages import printable
from drivers.settings import Harmonic, Settings
from errors import ConfigurationError

# Step of the identification that finds each of these fields of a joint.
_STEP_OF = {
    "half_gap": "gap",
    "friction": "friction",
    "gap_spring": "friction",
    "rotor_inertia": "friction",
    "thresholds": "thresholds",
}
# What arming needs beside the wiring, in the order in which it is identified.
_PARAMETERS: tuple[tuple[Step, str, str], ...] = (
    ("gap", "the gap", "`contactd identify gap JOINT`"),
    ("friction", "the friction", "`contactd identify friction`"),
    ("thresholds", "the thresholds", "`contactd identify thresholds`"),
)
# What voids each of them, in words (`daemon.config.marks`).
_CHANGED: dict[Step, str] = {
    "wiring": "drives, wiring, torque constants, period or the URDF's joints",
    "gap": "drives, wiring, period or the URDF's joints",
    "friction": "drives, wiring, torque constants, period or URDF",
    "thresholds": "drives, wiring, torque constants, period or URDF",
}
NotNegative = Annotated[float, Meta(ge=0)]


class Entry(Settings, frozen=True, kw_only=True):
    """Date of a step that passed, and the measurements behind it."""

    date: str
    log: str  # sha256 of what was measured
    of: str = ""  # mark of what it depends on; empty in files that have one for all


class WiringEntry(Entry, frozen=True):
    """Wiring whose signs and scales agree."""

    follows: float  # link motion over motor motion


class EncodersEntry(Entry, frozen=True):
    """Error of the link's encoder that repeats with its turn, and how much of phi's scatter at the
    borders it leaves on held-out motion."""

    link_correction: list[Harmonic]
    left: float


class GapEntry(Entry, frozen=True):
    """Half-gap [rad] and half its 95 % interval; skew between the encoders, where it showed."""

    half_gap: Annotated[float, Meta(ge=0, le=0.5)]
    confidence: NotNegative
    skew_ms: float | None = None


class FrictionEntry(Entry, frozen=True):
    """Coefficients of eq. (6), with standard errors of those identified: K_theta, B, ..."""

    friction: Friction
    errors: dict[str, float]
    r2: float
    condition: float
    gap_spring: GapSpring = GapSpring()
    rotor_inertia: NotNegative | None = None  # None where the current does not show it


class SeenEntry(Settings, frozen=True):
    """Motion in which levels were learned: speed of the motor [rad/s], range of the link [rad], and
    the load that was carried, in words."""

    speed: NotNegative
    lower: float
    upper: float
    load: str = ""


class DiscardedEntry(Settings, frozen=True):
    """Stretch that looked like a touch and was left out: from when, for how long [s], how large was
    |r| [Nm]."""

    at_s: float
    lasted_s: float
    largest: float


class ThresholdsEntry(Entry, frozen=True):
    """Levels [Nm] at a rate of false alarms per hour, the largest |r| that was used, what motion
    they have seen (None in files of before), and what was left out of it."""

    thresholds: Levels
    per_hour: float
    largest: NotNegative
    seen: SeenEntry | None = None
    discarded: tuple[DiscardedEntry, ...] = ()


class IdentifiedJoint(Settings, frozen=True):
    """Entries of one joint, and the serial number of the drive that they were measured on."""

    serial: int | None = None  # 0x1018:4; None where the drive keeps it to itself
    wiring: WiringEntry | None = None
    encoders: EncodersEntry | None = None
    gap: GapEntry | None = None
    friction: FrictionEntry | None = None
    thresholds: ThresholdsEntry | None = None


class Identified(Settings, frozen=True):
    """Content of the file."""

    version: Literal[1] = 1
    configuration: str = ""  # `fingerprint`, for entries without a mark of their own
    joints: dict[str, IdentifiedJoint] = msgspec.field(default_factory=dict)


def samples_alike(a: Configuration, b: Configuration) -> bool:
    """True where samples mean the same with either: drives, wiring and period are equal."""

    def about(c: Configuration) -> object:
        return c.drives, [(j.name, j.wiring) for j in c.joints], c.period_ms

    return about(a) == about(b)


def residuals_alike(a: Configuration, b: Configuration) -> bool:
    """True where residuals do: the estimator and its parameters of the joints are equal, too."""

    def about(c: Configuration) -> object:
        joints = [
            (j.torque_constant, j.rotor_inertia, j.half_gap, j.friction, j.gap_spring)
            for j in c.joints
        ]
        return c.estimator, joints

    return samples_alike(a, b) and about(a) == about(b)


def applied(c: Configuration, found: Identified) -> Configuration:
    """Configuration in which identified values replace those written by hand."""
    return msgspec.structs.replace(
        c, joints=[_applied(joint, found.joints.get(joint.name)) for joint in c.joints]
    )


def _applied(joint: Joint, found: IdentifiedJoint | None) -> Joint:
    if found is None:
        return joint
    changes: dict[str, object] = {}
    if found.encoders is not None:
        correction = found.encoders.link_correction
        changes["wiring"] = msgspec.structs.replace(joint.wiring, link_correction=correction)
    if found.gap is not None:
        changes["half_gap"] = found.gap.half_gap
    if found.friction is not None:
        changes["friction"] = found.friction.friction
        rigid = changes.get("half_gap", joint.half_gap) == 0.0
        changes["gap_spring"] = GapSpring() if rigid else found.friction.gap_spring
        if found.friction.rotor_inertia is not None:
            changes["rotor_inertia"] = found.friction.rotor_inertia
    if found.thresholds is not None:
        changes["thresholds"] = found.thresholds.thresholds
    return msgspec.structs.replace(joint, **changes)


def identified_keys(keys: Keys, c: Configuration, found: Identified | None) -> Keys:
    """Place in identified.yaml of the value behind the `keys` of config.yaml; empty where that is
    as written by hand."""
    match keys:
        case ["joints", int(index), str(field), *rest] if found and field in _STEP_OF:
            name, step = c.joint_names[index], _STEP_OF[field]
            entry = getattr(found.joints.get(name), step, None)
            # Of a rotor that the current does not show the entry has no value.
            if getattr(entry, field, None) is not None:
                return ["joints", name, step, field, *rest]
    return []


def objections(
    found: Identified | None, c: Configuration, urdf: str, serials: dict[str, int | None]
) -> list[str]:
    """Reasons not to arm this arm with this file; empty if there are none.

    `serials` are those of the drives that answered, by joint. Simulated arms are no exception:
    those of `configs/` come with a file of their own, which fits no other drives.
    """
    reasons = []
    if names := outdated("wiring", found, c, urdf):
        reasons.append(
            f"the wiring of {', '.join(names)} in {c.identified} belongs to another configuration: "
            f"{_CHANGED['wiring']} were changed since (`contactd identify wiring` again)"
        )
    for joint in c.joints:
        known = found.joints.get(joint.name) if found is not None else None
        if (
            known is not None
            and known.wiring is not None
            and known.serial != (serial := serials.get(joint.name))
        ):
            reasons.append(
                f"{joint.name} was identified on drive {known.serial}, this is drive {serial}"
            )
    if names := unidentified("wiring", found, c):
        reasons.append(
            f"the wiring of {', '.join(names)} was never checked (`contactd identify wiring`)"
        )
    return reasons


def unidentified(step: Step, found: Identified | None, c: Configuration) -> list[str]:
    """Joints that a step of the identification has not passed, and that are not known otherwise.
    Without that of the wiring a sign may be wrong, and every loop over the links drives them
    away."""
    entries = found.joints if found is not None else {}
    return [
        joint.name
        for joint in c.joints
        if step not in joint.known and getattr(entries.get(joint.name), step, None) is None
    ]


def outdated(step: Step, found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Joints that passed a step before something was changed that it depends on, and that are not
    known otherwise."""
    if found is None:
        return []
    mark = marks(c, urdf)[step]
    of_all = found.configuration == fingerprint(c, urdf)
    entries = {name: getattr(joint, step) for name, joint in found.joints.items()}
    return [
        joint.name
        for joint in c.joints
        if step not in joint.known
        and (entry := entries.get(joint.name)) is not None
        and not (entry.of == mark if entry.of else of_all)
    ]


def unarmable(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Reasons why this arm will not be armed, whichever drives answer; empty if there are none."""
    entries = found.joints if found is not None else {}
    same = {name: entry.serial for name, entry in entries.items()}
    return [*objections(found, c, urdf, same), *parameters_missing(found, c, urdf)]


def parameters_missing(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Reasons not to arm: the gaps, friction and thresholds that the file does not have, or that
    something was changed for since, each with the command to run; empty if there are none."""
    reasons = []
    for step, what, command in _PARAMETERS:
        if names := unidentified(step, found, c):
            reasons.append(
                f"{what} of {', '.join(names)} not identified ({command}; or, known otherwise, say "
                f"how: `known: {{{step}: ...}}` in config.yaml)"
            )
        if names := outdated(step, found, c, urdf):
            reasons.append(
                f"{what} of {', '.join(names)} identified before {_CHANGED[step]} were changed "
                f"({command} again)"
            )
    return reasons


def parameters_known(found: Identified | None, c: Configuration) -> str:
    """Evidence that the parameters are right: identified, or how else they are known."""
    entries = found.joints if found is not None else {}
    said: dict[tuple[str, str], list[str]] = {}
    for joint in c.joints:
        for step, how in joint.known.items():
            if getattr(entries.get(joint.name), step, None) is not None:
                continue
            said.setdefault((step, how), []).append(joint.name)
    if not said:
        return "gap, friction and thresholds of every joint are identified"
    everywhere = [joint.name for joint in c.joints]
    return "known otherwise: " + "; ".join(
        f"{step} of {'all' if names == everywhere else ', '.join(names)}: {printable(how)}"
        for (step, how), names in said.items()
    )


def write_identified(path: Path, found: Identified) -> None:
    """Replace the file at once: a reader sees the old one or the new one, also after a power cut.

    Raises ConfigurationError if it cannot be written; the old file is then untouched.
    """
    text = (
        "# Written by `contactd identify`; values here replace those of config.yaml.\n"
        "# Delete a step of a joint to go back to the value of config.yaml.\n"
    )
    plain = msgspec.to_builtins(found)
    text += yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=100)
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            Path(name).chmod(0o644)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be written: {error.strerror}") from error
