"""Script of a hand: its acts on the arm and their times, in a file of YAML."""

import re
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta

from common.errors import ConfigurationError
from common.yaml_source import read_yaml

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
# Far more than any person has, and less than would throw a light link through the plant's step: no
# number of a script makes the simulation diverge.
Torque = Annotated[float, Meta(ge=-500.0, le=500.0)]  # [Nm]
Strength = Annotated[float, Meta(gt=0.0, le=500.0)]  # [Nm]
Angle = Annotated[float, Meta(ge=-100.0, le=100.0)]  # of a link [rad]
Coordinate = Annotated[float, Meta(ge=-2.0, le=2.0)]  # [m]
Newtons = Annotated[float, Meta(ge=-500.0, le=500.0)]


class Act(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="act"):
    """One act of the hand, `at_s` seconds after the arm first moved."""

    at_s: Annotated[float, Meta(ge=0.0, le=1e6)]


class Push(Act, frozen=True, kw_only=True, tag="push"):
    """A torque [Nm] on one joint: constant, rising from zero, or a half sine."""

    joint: str
    torque: Torque
    duration_s: Positive
    shape: Literal["step", "ramp", "pulse"] = "step"


STRONGEST = 4.0
"""Default torque of a hand at a joint [Nm]."""


class Grip(Act, frozen=True, kw_only=True):
    """Spring [Nm/rad], damper [Nm s/rad] and strongest torque [Nm] per joint."""

    stiffness: Positive = 40.0
    damping: NotNegative = 2.0
    # as `Hand` derives it from the torque of the joint's motor and its friction, if None
    max_torque: Strength | None = STRONGEST


class Hold(Grip, frozen=True, kw_only=True, tag="hold"):
    """Hold joints where they are."""

    joints: tuple[str, ...]


class Guide(Grip, frozen=True, kw_only=True, tag="guide"):
    """Take joints and lead them to positions [rad] at a speed [rad/s]; holds on at the end."""

    to: dict[str, Angle]
    speed: Annotated[float, Meta(gt=0.0, le=20.0)]


class Release(Act, frozen=True, kw_only=True, tag="release"):
    """Let go of everything."""


class Lean(Act, frozen=True, kw_only=True, tag="lean"):
    """Lean on one joint with a torque [Nm], rising over so many seconds, until `release`."""

    joint: str
    torque: Torque
    rise_s: Positive = 0.5


class Press(Act, frozen=True, kw_only=True, tag="press"):
    """A force on the tool (`Plant.held_at`), x y z along the axes of the URDF's last link [N],
    rising over so many seconds; for a time, or until `release`."""

    force: tuple[Newtons, Newtons, Newtons]
    rise_s: Positive = 0.1
    duration_s: Positive | None = None


class Clamp(Act, frozen=True, kw_only=True, tag="clamp"):
    """Something hard that joints are caught in where they are, until `release`."""

    joints: tuple[str, ...]
    stiffness: Positive = 1000.0
    damping: NotNegative = 10.0
    max_torque: Strength = 100.0


class Gap(Act, frozen=True, kw_only=True, tag="gap"):
    """Move one link softly between the borders of its gap, as `contactd identify gap` asks for:
    beyond one, rest, beyond the other, so many times, carrying the weight that the joint bears."""

    joint: str
    # pressed with at most [Nm], beside the weight; `hand.SOFT` of the motor's torque if None
    torque: Strength | None = None
    times: Annotated[int, Meta(ge=1, le=1000)] = 30
    reach: Positive = 0.06  # each way, more than the gap [rad]


class Give(Act, frozen=True, kw_only=True, tag="give"):
    """Put a mass [kg] into the arm's hand, at a place in the frame of the URDF's last link [m],
    without one where a hand would hold it (`Plant.held_at`); 0 takes it away again."""

    mass: Annotated[float, Meta(ge=0.0, le=100.0)]
    com: tuple[Coordinate, Coordinate, Coordinate] | None = None


AnyAct = Push | Lean | Press | Hold | Clamp | Guide | Gap | Release | Give
Script = tuple[AnyAct, ...]
_NAMES = tuple(str(act.__struct_config__.tag) for act in get_args(AnyAct))
_OF_ACT = re.compile(r"\[(\d+)\]\.?(.*)")


def read_script(path: Path) -> Script:
    """A YAML (or JSON) list of acts, in order of time. Raises ConfigurationError."""
    try:
        script = msgspec.convert(read_yaml(path).data, type=Script)
        return tuple(sorted(script, key=lambda act: act.at_s))
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{path}: hand script: {_in_words(error)}") from error


def _in_words(error: msgspec.ValidationError) -> str:
    """Text of an error: act of the script, counted from 1, place in it, and the known acts."""
    message, _, where = str(error).partition(" - at `$")
    act = _OF_ACT.match(where.rstrip("`"))
    if act is None:
        return message
    known = f"; there are {', '.join(_NAMES)}" if act[2] == "act" else ""
    place = f", {act[2]}" if act[2] else ""
    return f"act {int(act[1]) + 1}{place}: {message[:1].lower()}{message[1:]}{known}"


def joints_of(act: AnyAct) -> tuple[str, ...]:
    """Names of the joints that an act is about."""
    if isinstance(act, Push | Lean | Gap):
        return (act.joint,)
    if isinstance(act, Hold | Clamp):
        return act.joints
    return tuple(act.to) if isinstance(act, Guide) else ()


def described(act: AnyAct) -> str:
    """Description of an act, in words."""
    match act:
        case Push():
            words = f"push {act.joint} {act.torque:g} Nm"
        case Lean():
            words = f"lean on {act.joint} with {act.torque:g} Nm"
        case Gap():
            most = "softly" if act.torque is None else f"with {act.torque:g} Nm"
            words = f"move {act.joint} in its gap {most}, {act.times} times"
        case Press():
            words = f"press the tool with {' '.join(f'{part + 0.0:g}' for part in act.force)} N"
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
