"""Skeleton of an arm: frames and capsules from its URDF, for viewers that draw it. Pure.

A capsule extends from the origin of a link to that of each joint it carries, or, at the end of a
chain, to twice its centre of mass. Capsules shorter than 2 cm are left out.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from common.errors import ModelError
from estimator.urdf import linked

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Quaternion x, y, z, w."""
_SHORTEST_M: Final = 0.02
_LEAST_RADIUS_M, _RADIUS_SHARE, _MOST_RADIUS_M = 0.02, 0.2, 0.05
_ZERO: Final[Triple] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Frame:
    """Frame of a link relative to its parent's."""

    parent: str
    child: str
    joint: str
    xyz: Triple
    fixed: Quaternion
    """Rotation at q = 0."""
    axis: Triple
    slides: bool
    """True for a prismatic joint, whose q is a displacement along the axis [m]."""

    def at(self, q: float) -> tuple[Triple, Quaternion]:
        """Translation and rotation at a joint position [rad], or [m]."""
        if self.slides:
            shift = rotated(self.fixed, (q * self.axis[0], q * self.axis[1], q * self.axis[2]))
            x, y, z = (a + b for a, b in zip(self.xyz, shift, strict=True))
            return (x, y, z), self.fixed
        half, (x, y, z) = math.sin(0.5 * q), self.axis
        return self.xyz, product(self.fixed, (x * half, y * half, z * half, math.cos(0.5 * q)))


@dataclass(frozen=True, slots=True)
class Capsule:
    """Capsule from the origin of a link's frame to `end` [m]."""

    link: str
    end: Triple
    radius: float

    @property
    def length(self) -> float:
        """Distance between the centres of its round ends [m]."""
        return math.dist(_ZERO, self.end)


@dataclass(frozen=True, slots=True)
class Skeleton:
    """Frames from the root on, and capsules of all links of some extent."""

    root: str
    frames: tuple[Frame, ...]
    capsules: tuple[Capsule, ...]

    def link_of(self) -> Mapping[str, str]:
        """Link that each joint moves, by joint."""
        return {frame.joint: frame.child for frame in self.frames}


def skeleton_of(urdf: str) -> Skeleton:
    """Skeleton of a URDF. Raises ModelError for an invalid URDF."""
    try:
        robot = ET.fromstring(urdf)
        frames = tuple(_frame(joint) for joint in robot.findall("joint"))
        ends = {link.get("name", ""): _centre(link) for link in robot.findall("link")}
    except (ET.ParseError, ValueError) as error:
        raise ModelError(f"the recorded URDF cannot be drawn: {error}") from error
    children = {frame.child for frame in frames}
    roots = [frame.parent for frame in frames if frame.parent not in children]
    carried: dict[str, list[Triple]] = {}
    for frame in frames:
        carried.setdefault(frame.parent, []).append(frame.xyz)
    capsules = []
    for link, centre in ends.items():
        tips = carried.get(link, [(2 * centre[0], 2 * centre[1], 2 * centre[2])])
        capsules += [_capsule(link, tip) for tip in tips if math.dist(tip, _ZERO) > _SHORTEST_M]
    return Skeleton(roots[0] if roots else "", frames, tuple(capsules))


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Product a b: rotation by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotated(by: Quaternion, v: Sequence[float]) -> Triple:
    """Vector v rotated by a quaternion."""
    x, y, z, w = by
    (vx, vy, vz, _) = product(product(by, (v[0], v[1], v[2], 0.0)), (-x, -y, -z, w))
    return vx, vy, vz


def towards(direction: Triple) -> Quaternion:
    """Rotation that turns the z axis into a direction."""
    x, y, z = np.array(direction) / math.dist(direction, _ZERO)
    if z < -1.0 + 1e-9:
        return 1.0, 0.0, 0.0, 0.0
    half = math.sqrt(2.0 * (1.0 + z))
    return float(-y / half), float(x / half), 0.0, 0.5 * half


def _frame(joint: ET.Element) -> Frame:
    origin, axis = joint.find("origin"), joint.find("axis")
    kind = joint.get("type", "")
    x, y, z = triple(axis, "xyz", (1.0, 0.0, 0.0))
    norm = math.dist((x, y, z), _ZERO) if kind != "fixed" else math.inf
    return Frame(
        parent=linked(joint, "parent"),
        child=linked(joint, "child"),
        joint=joint.get("name", ""),
        xyz=triple(origin, "xyz", _ZERO),
        fixed=from_rpy(triple(origin, "rpy", _ZERO)),
        axis=(x / norm, y / norm, z / norm) if norm > 0.0 else (1.0, 0.0, 0.0),
        slides=kind == "prismatic",
    )


def _capsule(link: str, tip: Triple) -> Capsule:
    radius = _RADIUS_SHARE * math.dist(tip, _ZERO)
    return Capsule(link, tip, min(max(radius, _LEAST_RADIUS_M), _MOST_RADIUS_M))


def from_rpy(rpy: Triple) -> Quaternion:
    """Rotation by a URDF's roll, pitch and yaw."""
    roll, pitch, yaw = (0.5 * angle for angle in rpy)
    about_x = (math.sin(roll), 0.0, 0.0, math.cos(roll))
    about_y = (0.0, math.sin(pitch), 0.0, math.cos(pitch))
    about_z = (0.0, 0.0, math.sin(yaw), math.cos(yaw))
    return product(about_z, product(about_y, about_x))


def _centre(link: ET.Element) -> Triple:
    return triple(link.find("inertial/origin"), "xyz", _ZERO)


def triple(element: ET.Element | None, name: str, otherwise: Triple) -> Triple:
    """Three numbers of an attribute, or `otherwise` if it is missing. Raises ValueError."""
    text = None if element is None else element.get(name)
    if text is None:
        return otherwise
    x, y, z = (float(word) for word in text.split())
    return x, y, z
