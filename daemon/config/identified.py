"""`identified.yaml`: the parameters that `contactd identify` found, beside the configuration.

Each joint has an entry per step, written when the step passed. A value here replaces that of the
same name in `config.yaml`, except levels stated in `known`; `evidence` decides on its validity.
"""

import os
import tempfile
from functools import reduce
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, get_args, get_type_hints

import msgspec
import yaml
from msgspec import Meta

from common.errors import ConfigurationError
from daemon.config.digests import Dependence
from daemon.config.problem import Keys
from daemon.config.schema import Configuration, Friction, GapSpring, Joint, Levels, PayloadEntry
from drivers.settings import RAD, Name, Settings, Sign
from drivers.wiring import Harmonic, JointWiring
from estimator.body_inertia import BodyInertia
from estimator.payload import Coordinate, Mass

NotNegative = Annotated[float, Meta(ge=0)]


class Entry(Settings, frozen=True, kw_only=True):
    """Date of a step that passed, and the measurements behind it."""

    depends: ClassVar[Dependence]
    """Settings whose change invalidates the entry"""
    optional: ClassVar[bool] = False
    """True if values of the configuration, or of the URDF, may be right without the step"""

    date: str
    log: str  # sha256 of the measurements
    of: str = ""  # digest of its dependencies; empty in files that have one for all

    def applied(self, joint: Joint) -> Joint:
        """Joint whose values are replaced by those of the same names in this entry."""

        def values(settings: type[Settings]) -> dict[str, object]:
            names = set(self.__struct_fields__) & set(settings.__struct_fields__)
            return {name: own for name in names if (own := getattr(self, name)) is not None}

        wiring = msgspec.structs.replace(joint.wiring, **values(JointWiring))
        return msgspec.structs.replace(joint, wiring=wiring, **values(Joint))


class WiringEntry(Entry, frozen=True):
    """Check of the wiring that passed: signs and scales agree."""

    depends = Dependence.CONSTANTS

    follows: float  # link motion over motor motion


class ZeroEntry(Entry, frozen=True):
    """Sign and zero [rad] of the link's encoder, stated by a person who looked at the link."""

    depends = Dependence.NODES

    link_sign: Sign
    link_offset: float
    motor_sign: Sign | None = None  # equal to link_sign, if both encoders are in the motor


class EncodersEntry(Entry, frozen=True):
    """Periodic error of the link's encoder over a turn, and the share of phi's scatter at the
    borders that is left after its correction on held-out motion."""

    depends = Dependence.WIRING

    link_correction: list[Harmonic]
    left: float


class GapEntry(Entry, frozen=True):
    """Half-gap [rad], half its 95 % confidence interval; encoder skew, if it was observable."""

    depends = Dependence.WIRING

    half_gap: Annotated[float, Meta(ge=0, le=0.5, extra=RAD)]
    confidence: NotNegative
    skew_ms: float | None = None


class MassesEntry(Entry, frozen=True):
    """Body of the joint; |r| on held-out motion with the URDF's body and with this one."""

    depends = Dependence.MASSES
    optional = True

    body: BodyInertia
    by_urdf: NotNegative
    by_this: NotNegative
    errors: tuple[float, ...] = ()  # standard errors of PARAMETERS of `estimator.body_inertia`


class FrictionEntry(Entry, frozen=True):
    """Coefficients of eq. (6), with standard errors of those identified, such as K_theta_s or B."""

    depends = Dependence.BODIES

    friction: Friction
    errors: dict[str, float]
    r2: float
    condition: float
    gap_spring: GapSpring = GapSpring()
    rotor_inertia: NotNegative | None = None  # None if not observable in the current

    def applied(self, joint: Joint) -> Joint:
        """Joint with these values, but without a gap spring if it has no gap."""
        spring = GapSpring() if joint.half_gap == 0.0 else self.gap_spring
        return msgspec.structs.replace(Entry.applied(self, joint), gap_spring=spring)


class SeenEntry(Settings, frozen=True):
    """Motion in which levels were learned: largest motor speed [rad/s], range of the link [rad],
    and a description of the load that was carried."""

    speed: NotNegative
    lower: float
    upper: float
    load: str = ""


class DiscardedEntry(Settings, frozen=True):
    """Interval that looked like a contact and was left out: its start and duration [s], and its
    largest |r| [Nm]."""

    at_s: float
    lasted_s: float
    largest: float


class ThresholdsEntry(Entry, frozen=True):
    """Levels [Nm] at a rate of false alarms per hour, the largest |r| that was used, the motion
    that they cover (None in older files), and the intervals that were left out."""

    depends = Dependence.BODIES

    thresholds: Levels
    per_hour: float
    largest: NotNegative
    seen: SeenEntry | None = None
    discarded: tuple[DiscardedEntry, ...] = ()

    def applied(self, joint: Joint) -> Joint:
        """Joint with these levels, with the `least` that `config.yaml` states."""
        levels, least = self.thresholds, joint.thresholds.least
        if least is not None:
            levels = msgspec.structs.replace(levels, least=least)
        return msgspec.structs.replace(joint, thresholds=levels)


class IdentifiedJoint(Settings, frozen=True):
    """Entries of one joint, and the serial number of the drive that they were measured on."""

    serial: int | None = None  # 0x1018:4; None if the drive does not report it
    zero: ZeroEntry | None = None
    wiring: WiringEntry | None = None
    encoders: EncodersEntry | None = None
    gap: GapEntry | None = None
    masses: MassesEntry | None = None
    friction: FrictionEntry | None = None
    thresholds: ThresholdsEntry | None = None


ENTRIES: Final[dict[str, type[Entry]]] = {
    step: get_args(hint)[0]
    for step, hint in get_type_hints(IdentifiedJoint).items()
    if step != "serial"
}
"""Entry of a joint by the step that writes it, in the order in which they are applied."""


def entries_of(joint: IdentifiedJoint | None) -> dict[str, Entry]:
    """Entries that a joint has, by step."""
    return {s: entry for s in ENTRIES if (entry := getattr(joint, s, None)) is not None}


class IdentifiedPayload(Entry, frozen=True):
    """Load that was identified in motion, with the standard errors of its mass [kg] and of its
    centre [m]; the frame is that of `payloads` in config.yaml."""

    depends = Dependence.BODIES

    mass: Mass
    com: tuple[Coordinate, Coordinate, Coordinate]
    mass_error: NotNegative
    com_error: NotNegative


class Identified(Settings, frozen=True):
    """Content of the file."""

    version: Literal[1] = 1
    configuration: str = ""  # `fingerprint`, for entries without a digest of their own
    joints: dict[str, IdentifiedJoint] = msgspec.field(default_factory=dict)
    payloads: dict[Name, IdentifiedPayload] = msgspec.field(default_factory=dict)


def same_samples(a: Configuration, b: Configuration) -> bool:
    """True if samples have the same meaning with both: drives, wiring and period are equal."""

    def about(c: Configuration) -> object:
        return c.drives, [(j.name, j.wiring) for j in c.joints], c.period_ms

    return about(a) == about(b)


def same_residuals(a: Configuration, b: Configuration) -> bool:
    """True if residuals have the same meaning with both: the estimator and its parameters of the
    joints are equal, too."""

    def about(c: Configuration) -> object:
        joints = [
            (j.torque_constant, j.rotor_inertia, j.half_gap, j.friction, j.gap_spring, j.body)
            for j in c.joints
        ]
        return c.estimator, joints

    return same_samples(a, b) and about(a) == about(b)


def applied(c: Configuration, found: Identified) -> Configuration:
    """Configuration in which identified values replace those written by hand."""
    weighed = {
        name: PayloadEntry(mass=p.mass, com=p.com, box=getattr(c.payloads.get(name), "box", None))
        for name, p in found.payloads.items()
    }
    joints = [
        reduce(lambda joint, entry: entry.applied(joint), used_entries(one, found).values(), one)
        for one in c.joints
    ]
    return msgspec.structs.replace(c, joints=joints, payloads=c.payloads | weighed)


def used_entries(joint: Joint, found: Identified | None) -> dict[str, Entry]:
    """Entries in force, by step: levels stated by a person (`known`) override identified ones."""
    entries = entries_of(found.joints.get(joint.name) if found is not None else None)
    return {s: e for s, e in entries.items() if s != "thresholds" or s not in joint.known}


def identified_keys(keys: Keys, c: Configuration, found: Identified | None) -> Keys:
    """Keys in identified.yaml of the value at `keys` in config.yaml; empty if that is in force."""
    match keys:
        case ["joints", int(index), "wiring", *path] | ["joints", int(index), *path] if found:
            joint = c.joints[index]
            for step, entry in used_entries(joint, found).items():
                # The entry has no value for a rotor that is not observable in the current.
                own = _value(entry, path)
                if path and own is not None and own == _value(joint, keys[2:]):
                    return ["joints", joint.name, step, *path]
        case ["payloads", str(name), *_] if found and name in found.payloads:
            return keys
    return []


def _value(settings: object, path: Keys) -> object:
    return reduce(lambda one, name: getattr(one, str(name), None), path, settings)


def identified_text(found: Identified) -> str:
    """Text of the file."""
    text = (
        "# Written by `contactd identify`; values here replace those of config.yaml, unless\n"
        "# `known` states thresholds there. Delete a step of a joint to go back to config.yaml.\n"
    )
    plain = msgspec.to_builtins(found)
    return text + yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=100)


def write_identified(path: Path, found: Identified) -> None:
    """Atomic replacement of the file: a reader sees the old or the new one, even after a power cut.

    Raises ConfigurationError if it cannot be written; the old file is then unchanged.
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
