"""Script of a hand: acts on the arm and their times, in a YAML file."""

import re
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta

from common.errors import ConfigurationError
from common.yaml_source import read_yaml

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
# Far more than any person can exert, but not so much that a light link diverges at the plant's
# step: no value of a script makes the simulation unstable.
Torque = Annotated[float, Meta(ge=-500.0, le=500.0)]  # [Nm]
Strength = Annotated[float, Meta(gt=0.0, le=500.0)]  # [Nm]
Angle = Annotated[float, Meta(ge=-100.0, le=100.0)]  # of a link [rad]
Coordinate = Annotated[float, Meta(ge=-2.0, le=2.0)]  # [m]
Newtons = Annotated[float, Meta(ge=-500.0, le=500.0)]


class Act(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="act"):
    """One act of the hand, `at_s` seconds after the arm first moved."""

    at_s: Annotated[float, Meta(ge=0.0, le=1e6)]


class Push(Act, frozen=True, kw_only=True, tag="push"):
    """Torque [Nm] on one joint: constant, rising from zero, or a half sine."""

    joint: str
    torque: Torque
    duration_s: Positive
    shape: Literal["step", "ramp", "pulse"] = "step"


STRONGEST = 4.0
"""Default torque of a hand at a joint [Nm]."""


class Grip(Act, frozen=True, kw_only=True):
    """Spring [Nm/rad], damper [Nm s/rad] and largest torque [Nm] per joint."""

    stiffness: Positive = 40.0
    damping: NotNegative = 2.0
    # None: derived by `Hand` from the motor's torque limit and the joint's friction
    max_torque: Strength | None = STRONGEST


class Hold(Grip, frozen=True, kw_only=True, tag="hold"):
    """Hold joints at their present positions."""

    joints: tuple[str, ...]


class Guide(Grip, frozen=True, kw_only=True, tag="guide"):
    """Lead joints to positions [rad] at a speed [rad/s], and hold them there."""

    to: dict[str, Angle]
    speed: Annotated[float, Meta(gt=0.0, le=20.0)]


class Release(Act, frozen=True, kw_only=True, tag="release"):
    """Let go of everything."""


class Lean(Act, frozen=True, kw_only=True, tag="lean"):
    """Lean on one joint with a torque [Nm] that rises over `rise_s`, until `release`."""

    joint: str
    torque: Torque
    rise_s: Positive = 0.5


class Press(Act, frozen=True, kw_only=True, tag="press"):
    """Force on the tool (`Plant.held_at`), x y z along the axes of the URDF's last link [N], that
    rises over `rise_s`; for `duration_s`, or until `release`."""

    force: tuple[Newtons, Newtons, Newtons]
    rise_s: Positive = 0.1
    duration_s: Positive | None = None


class Clamp(Act, frozen=True, kw_only=True, tag="clamp"):
    """Clamp joints rigidly at their present positions, until `release`."""

    joints: tuple[str, ...]
    stiffness: Positive = 1000.0
    damping: NotNegative = 10.0
    max_torque: Strength = 100.0


class Gap(Act, frozen=True, kw_only=True, tag="gap"):
    """Move one link gently between the borders of its gap, as `contactd identify gap` requires:
    against one border, rest, against the other, `times` times, while carrying the link's weight."""

    joint: str
    # largest torque in addition to the weight [Nm]; None: `hand.SOFT` times the motor's limit
    torque: Strength | None = None
    times: Annotated[int, Meta(ge=1, le=1000)] = 30
    reach: Positive = 0.06  # in each direction, more than the gap [rad]


class Give(Act, frozen=True, kw_only=True, tag="give"):
    """Give the arm a mass [kg] to carry, at a position in the frame of the URDF's last link [m]
    (default: `Plant.held_at`); 0 removes it again."""

    mass: Annotated[float, Meta(ge=0.0, le=100.0)]
    com: tuple[Coordinate, Coordinate, Coordinate] | None = None


AnyAct = Push | Lean | Press | Hold | Clamp | Guide | Gap | Release | Give
Script = tuple[AnyAct, ...]
_NAMES = tuple(str(act.__struct_config__.tag) for act in get_args(AnyAct))
_OF_ACT = re.compile(r"\[(\d+)\]\.?(.*)")


def read_script(path: Path) -> Script:
    """Read a YAML (or JSON) list of acts, sorted by time. Raises ConfigurationError."""
    try:
        script = msgspec.convert(read_yaml(path).data, type=Script)
        return tuple(sorted(script, key=lambda act: act.at_s))
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{path}: hand script: {_in_words(error)}") from error


def _in_words(error: msgspec.ValidationError) -> str:
    """Text of an error: number of the act (from 1), field in it, and the known acts."""
    message, _, where = str(error).partition(" - at `$")
    act = _OF_ACT.match(where.rstrip("`"))
    if act is None:
        return message
    known = f"; there are {', '.join(_NAMES)}" if act[2] == "act" else ""
    place = f", {act[2]}" if act[2] else ""
    return f"act {int(act[1]) + 1}{place}: {message[:1].lower()}{message[1:]}{known}"


def joints_of(act: AnyAct) -> tuple[str, ...]:
    """Names of the joints that an act addresses."""
    if isinstance(act, Push | Lean | Gap):
        return (act.joint,)
    if isinstance(act, Hold | Clamp):
        return act.joints
    return tuple(act.to) if isinstance(act, Guide) else ()


def described(act: AnyAct) -> str:
    """Description of an act, as text."""
    match act:
        case Push():
            words = f"push {act.joint} {act.torque:g} Nm"
        case Lean():
            words = f"lean on {act.joint} with {act.torque:g} Nm, until `release`"
        case Gap():
            most = "softly" if act.torque is None else f"with {act.torque:g} Nm"
            words = f"move {act.joint} in its gap {most}, {act.times} times"
        case Press():
            words = f"press the tool with {' '.join(f'{part + 0.0:g}' for part in act.force)} N"
            words += ", until `release`" if act.duration_s is None else f" for {act.duration_s:g} s"
        case Clamp():
            words = "clamp " + ", ".join(act.joints)
        case Hold():
            words = "hold " + ", ".join(act.joints)
        case Guide():
            ways = (f"{name} to {goal:g} rad" for name, goal in act.to.items())
            words = "lead " + ", ".join(ways)
        case Give():
            words = f"carry {act.mass:g} kg"
        case Release():
            words = "release"
    return words
