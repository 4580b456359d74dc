"""Validation of the masses and inertias of a URDF before pinocchio reads it.

pinocchio's parser takes a link with an unreadable <inertial> for one without, and reports it on
stderr only. Gravity would lack that link, and the arm would take its own weight for a contact.
"""

import math
import re
from dataclasses import dataclass
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np

from common.errors import ModelError

_COUNTS = {1: "one finite number", 3: "three finite numbers"}  # of an attribute
# Stricter than Python's float(), as is the URDF parser.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
# Rounded to three digits, the tensor of a thin rod may be slightly negative along it.
_ROUNDING = 1e-3

_LIMITED = ("revolute", "prismatic")  # joints that need a <limit>
_OF_LIMIT = ("effort", "velocity")  # what every <limit> needs

_Lines = dict[ET.Element, int]


@dataclass(frozen=True, slots=True)
class MovedLink:
    """One link that movable joints move, as its <inertial> describes it; zeros without one."""

    name: str
    line: int
    joint: str
    """the movable joint that it moves with"""
    mass: float = 0.0
    """[kg]"""
    moment: float = 0.0
    """largest principal moment of inertia about the centre of mass [kg m2]"""
    lever: float = 0.0
    """from the link's frame to the centre of mass [m]"""


def moved_links(text: str) -> list[MovedLink]:
    """Links that movable joints move, directly or through a chain of `fixed` joints.

    Raises ModelError for text that is not XML; for an <inertial> of such a link that lacks mass or
    inertia, gives them as anything but finite numbers, or is physically impossible; for a joint
    between links that do not exist; and for one that lacks limits. A link may be without an
    <inertial>: a frame, or one whose mass others include.
    """
    root, lines = parsed(text)
    _refuse_unknown_links(root, lines)
    _refuse_unlimited(root, lines)
    carried = _carried(root)
    links = []
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        if name not in carried:
            continue
        mass = moment = lever = 0.0
        if inertial is not None:
            try:
                mass = _mass(inertial, lines)
                moment = _largest_moment(inertial, lines)
                lever = _distance(inertial.find("origin"), lines)
            except ModelError as error:
                raise ModelError(f"link {name!r}, {error}") from error
        links.append(MovedLink(name, lines[link], carried[name], mass, moment, lever))
    return links


@dataclass(frozen=True, slots=True)
class JointRange:
    """A movable joint of a URDF: its range and position; zero where a figure is missing."""

    joint: str
    line: int
    kind: str = "revolute"
    """its type in the URDF, or `mimic`"""
    lower: float = 0.0
    upper: float = 0.0
    """[rad]"""
    velocity: float = 0.0
    """[rad/s]"""
    offset: float = 0.0
    """distance from the frame of the link before it to its own [m]"""


def joint_ranges(text: str) -> list[JointRange]:
    """Movable joints of a URDF. Raises ModelError for text that is not XML, and for a value that is
    not a finite number."""
    root, lines = parsed(text)
    ranges = []
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind == "fixed":
            continue
        kind = kind if joint.find("mimic") is None else "mimic"
        limit = joint.find("limit")
        line = lines[joint if limit is None else limit]
        try:
            lower, upper, velocity = (
                0.0 if limit is None or field not in limit.attrib
                else _numbers(limit, field, 1, lines)[0]
                for field in ("lower", "upper", "velocity")
            )  # fmt: skip
            offset = _distance(joint.find("origin"), lines)
        except ModelError as error:
            raise ModelError(f"joint {name!r}, {error}") from error
        ranges.append(JointRange(name, line, kind, lower, upper, velocity, offset))
    return ranges


def _distance(origin: ET.Element | None, lines: _Lines) -> float:
    """Length of an <origin>'s xyz [m]. Raises ModelError that begins with the line."""
    if origin is None or "xyz" not in origin.attrib:
        return 0.0
    return math.hypot(*_numbers(origin, "xyz", 3, lines))


def parsed(text: str) -> tuple[ET.Element, _Lines]:
    """Root element of a URDF, and the line of each element. XML namespaces are not resolved, as in
    pinocchio. Raises ModelError."""
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    lines: _Lines = {}

    def start(tag: str, attributes: dict[str, str]) -> None:
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ModelError(f"not XML that can be read: {error}") from error
    root = builder.close()
    if root.tag != "robot":
        raise ModelError(f"not a URDF: its root is <{root.tag}>, not <robot>")
    _refuse_xacro(root, lines)
    return root, lines


def _refuse_xacro(root: ET.Element, lines: _Lines) -> None:
    """Raise ModelError for xacro macros, which pinocchio would drop or misread."""
    for element in root.iter():
        macro = next((value for value in element.attrib.values() if "${" in value), "")
        if macro or element.tag.startswith("xacro:"):
            raise ModelError(
                f"line {lines[element]}: `{macro or element.tag}` is xacro: expand it first "
                "(`xacro arm.urdf.xacro > arm.urdf`)"
            )


def _carried(root: ET.Element) -> dict[str, str]:
    """Movable joint that moves each link, by the link's name."""
    joints = [
        (joint.get("type"), joint.get("name", ""), linked(joint, "parent"), linked(joint, "child"))
        for joint in root.findall("joint")
    ]
    carried = {child: name for kind, name, _, child in joints if kind != "fixed"}
    for _ in joints:  # no chain is longer
        for _, _, parent, child in joints:
            if parent in carried:
                carried.setdefault(child, carried[parent])
    return carried


def _refuse_unknown_links(root: ET.Element, lines: _Lines) -> None:
    """Raise ModelError for a joint whose link does not exist: pinocchio names it on stderr only."""
    known = [link.get("name", "") for link in root.findall("link")]
    for joint in root.findall("joint"):
        for role in ("parent", "child"):
            if (name := linked(joint, role)) not in known:
                element = joint.find(role)
                raise ModelError(
                    f"joint {joint.get('name', '')!r}, line "
                    f"{lines[joint if element is None else element]}: no link {name!r} for its "
                    f"<{role}>; there are: {', '.join(known)}"
                )


def _refuse_unlimited(root: ET.Element, lines: _Lines) -> None:
    """Raise ModelError for a joint that lacks limits: pinocchio names it on stderr only."""
    for joint in root.findall("joint"):
        name, kind, limit = joint.get("name", ""), joint.get("type", ""), joint.find("limit")
        if limit is None:
            if kind in _LIMITED:
                raise ModelError(
                    f"joint {name!r}, line {lines[joint]}: it is {kind}, and has no <limit>, which "
                    f"needs lower, upper, {' and '.join(_OF_LIMIT)}"
                )
            continue
        try:
            for field in _OF_LIMIT:
                _numbers(limit, field, 1, lines)
        except ModelError as error:
            raise ModelError(f"joint {name!r}, {error}") from error


def linked(joint: ET.Element, role: str) -> str:
    """Name of the link that a joint has as `parent` or `child`; empty without one."""
    element = joint.find(role)
    return "" if element is None else element.get("link", "")


def _mass(inertial: ET.Element, lines: _Lines) -> float:
    """Mass of one link [kg], its origin validated. Raises ModelError that begins with the line."""
    origin = inertial.find("origin")
    for attribute in ("xyz", "rpy"):
        if origin is not None and attribute in origin.attrib:
            _numbers(origin, attribute, 3, lines)
    element = _child(inertial, "mass", lines)
    (mass,) = _numbers(element, "value", 1, lines)
    if mass < 0:
        raise ModelError(f"line {lines[element]}: its mass of {mass:g} kg must not be negative")
    return mass


def _largest_moment(inertial: ET.Element, lines: _Lines) -> float:
    """Largest principal moment of one link [kg m2]. Raises ModelError that begins with the line."""
    element = _child(inertial, "inertia", lines)
    xx, xy, xz, yy, yz, zz = (
        _numbers(element, name, 1, lines)[0] for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if principal[0] < -_ROUNDING * np.abs(principal).max():
        raise ModelError(
            f"line {lines[element]}: its <inertia> has a principal moment of {principal[0]:.3g} "
            "kg m2; none may be negative"
        )
    return float(principal[-1])


def _child(inertial: ET.Element, tag: str, lines: _Lines) -> ET.Element:
    element = inertial.find(tag)
    if element is None:
        found = ", ".join(f"<{child.tag}>" for child in inertial) or "nothing"
        raise ModelError(
            f"line {lines[inertial]}: its <inertial> has no <{tag}> but {found}; allowed are both "
            "<mass> and <inertia>, or no <inertial>"
        )
    return element


def _numbers(element: ET.Element, attribute: str, count: int, lines: _Lines) -> list[float]:
    line, text = lines[element], element.get(attribute)
    if text is None:
        raise ModelError(f"line {line}: its <{element.tag}> has no {attribute}")
    # The URDF parser rejects a single number that is followed by a space.
    words = text.split() if count > 1 else [text.lstrip()]
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word)]
    if not len(numbers) == len(words) == count or not all(map(math.isfinite, numbers)):
        raise ModelError(
            f'line {line}: <{element.tag} {attribute}="{text}">: must be {_COUNTS[count]} and '
            "nothing else"
        )
    return numbers
