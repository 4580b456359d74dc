"""`identified.yaml`: the parameters that `contactd identify` found, beside the configuration.

Each joint has an entry per step, written when the step passed. Values here replace those of
`config.yaml`; what the file is worth as evidence says `evidence`.
"""

import os
import tempfile
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import yaml
from msgspec import Meta

from daemon.config.problem import Keys
from daemon.config.schema import (
    Configuration,
    Friction,
    GapSpring,
    Joint,
    Levels,
    PayloadEntry,
)
from drivers.settings import Harmonic, Name, Settings, Sign
from errors import ConfigurationError
from estimator.body_inertia import BodyInertia
from estimator.payload import Mass, Place

# Step of the identification that finds each of these fields of a joint.
_STEP_OF = {
    "half_gap": "gap",
    "body": "masses",
    "friction": "friction",
    "gap_spring": "friction",
    "rotor_inertia": "friction",
    "thresholds": "thresholds",
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


class ZeroEntry(Entry, frozen=True):
    """Sign and zero [rad] of the link's encoder, by a person who saw the link."""

    link_sign: Sign
    link_offset: float


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


class MassesEntry(Entry, frozen=True):
    """What the joint moves, and |r| (rms) [Nm] on motion that it was not fitted to, by the URDF and
    by this."""

    body: BodyInertia
    by_urdf: NotNegative
    by_this: NotNegative


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
    zero: ZeroEntry | None = None
    wiring: WiringEntry | None = None
    encoders: EncodersEntry | None = None
    gap: GapEntry | None = None
    masses: MassesEntry | None = None
    friction: FrictionEntry | None = None
    thresholds: ThresholdsEntry | None = None


class IdentifiedPayload(Entry, frozen=True):
    """A load that was weighed in motion, with the standard errors of its mass [kg] and of its
    centre [m]; `payloads` of config.yaml says the frame."""

    mass: Mass
    com: tuple[Place, Place, Place]
    mass_error: NotNegative
    com_error: NotNegative


class Identified(Settings, frozen=True):
    """Content of the file."""

    version: Literal[1] = 1
    configuration: str = ""  # `fingerprint`, for entries without a mark of their own
    joints: dict[str, IdentifiedJoint] = msgspec.field(default_factory=dict)
    payloads: dict[Name, IdentifiedPayload] = msgspec.field(default_factory=dict)


def samples_alike(a: Configuration, b: Configuration) -> bool:
    """True where samples mean the same with either: drives, wiring and period are equal."""

    def about(c: Configuration) -> object:
        return c.drives, [(j.name, j.wiring) for j in c.joints], c.period_ms

    return about(a) == about(b)


def residuals_alike(a: Configuration, b: Configuration) -> bool:
    """True where residuals do: the estimator and its parameters of the joints are equal, too."""

    def about(c: Configuration) -> object:
        joints = [
            (j.torque_constant, j.rotor_inertia, j.half_gap, j.friction, j.gap_spring, j.body)
            for j in c.joints
        ]
        return c.estimator, joints

    return samples_alike(a, b) and about(a) == about(b)


def applied(c: Configuration, found: Identified) -> Configuration:
    """Configuration in which identified values replace those written by hand."""
    weighed = {name: PayloadEntry(mass=p.mass, com=p.com) for name, p in found.payloads.items()}
    return msgspec.structs.replace(
        c,
        joints=[_applied(joint, found.joints.get(joint.name)) for joint in c.joints],
        payloads=c.payloads | weighed,
    )


def _applied(joint: Joint, found: IdentifiedJoint | None) -> Joint:
    if found is None:
        return joint
    changes: dict[str, object] = {}
    wiring = dict[str, object]()
    if found.zero is not None:
        wiring |= {"link_sign": found.zero.link_sign, "link_offset": found.zero.link_offset}
    if found.encoders is not None:
        wiring["link_correction"] = found.encoders.link_correction
    if wiring:
        changes["wiring"] = msgspec.structs.replace(joint.wiring, **wiring)
    if found.gap is not None:
        changes["half_gap"] = found.gap.half_gap
    if found.masses is not None:
        changes["body"] = found.masses.body
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
        case ["joints", int(index), "wiring", ("link_sign" | "link_offset") as field] if found:
            name = c.joint_names[index]
            if getattr(found.joints.get(name), "zero", None) is not None:
                return ["joints", name, "zero", field]
        case ["payloads", str(name), *_] if found and name in found.payloads:
            return keys
    return []


def identified_text(found: Identified) -> str:
    """The file's text."""
    text = (
        "# Written by `contactd identify`; values here replace those of config.yaml.\n"
        "# Delete a step of a joint to go back to the value of config.yaml.\n"
    )
    plain = msgspec.to_builtins(found)
    return text + yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=100)


def write_identified(path: Path, found: Identified) -> None:
    """Replace the file at once: a reader sees the old one or the new one, also after a power cut.

    Raises ConfigurationError if it cannot be written; the old file is then untouched.
    """
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(identified_text(found))
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
