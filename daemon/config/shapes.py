"""Shapes of the arm and of its surroundings: two optional files beside config.yaml. `contactd
shapes` writes the first; the second is written by hand.

Distances in m, angles in rad; surroundings in the frame of the URDF's root.
"""

import hashlib
import math
from itertools import combinations
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
import numpy as np
import pinocchio as pin
import yaml
from msgspec import Meta

from common.errors import ConfigurationError
from common.yaml_source import read_yaml
from daemon.config.convert import convert
from drivers.settings import RAD, Name, Settings
from estimator.clearance import Clearance
from estimator.dynamics import Body
from estimator.shapes import Box, Capsule, Plane

SHAPES: Final = "shapes.yaml"
SURROUNDINGS: Final = "surroundings.yaml"
BASE: Final = ""
"""Joint name of fixed bodies."""
MOST_PAIRS: Final = 150
"""Largest number of pairs for the time of a tick, and of a path check between two ticks."""
MOST_CORNERS: Final = 16
ROUNDING_M: Final = 1e-4
"""Rounding of numbers in a file, which may be too small by this much."""
HEAD: Final = (
    "# Written by `contactd shapes`: capsules and corners of links, in their joint's frame (an\n"
    "# empty name: of the URDF's root), and the pairs that are not guarded, with the reason. Add\n"
    "# capsules for what the URDF lacks, as a tool. Taken up by `contactctl reload`, while off.\n"
)

Number = Annotated[float, Meta(ge=-100, le=100)]
Vector3 = tuple[Number, Number, Number]
Radius = Annotated[float, Meta(gt=0, le=2)]
Angle = Annotated[float, Meta(ge=-7, le=7, extra=RAD)]  # a full turn; more is likely in degrees


class _Part(Settings, frozen=True):
    name: Name
    joint: str


class CapsuleEntry(_Part, frozen=True):
    """Capsule: all points within a radius of the segment from start to end. Capsules with the same
    name and joint are parts of one link."""

    start: Vector3
    end: Vector3
    radius: Radius
    edged: bool = False  # against planes its link's corners are used instead


class CornersEntry(_Part, frozen=True):
    """Corners of an edged link, used against planes, as its capsules are wider than the link."""

    points: Annotated[list[Vector3], Meta(min_length=1, max_length=MOST_CORNERS)]


class LeftOut(Settings, frozen=True):
    """Pair that is not guarded; the second may be a plane or a box of the surroundings."""

    pair: tuple[Name, Name]
    why: Name


class Shapes(Settings, frozen=True):
    """Shapes of an arm, for one URDF."""

    version: Literal[1]
    urdf: str  # digest of the URDF that they were fitted to
    source: Literal["collision", "visual", "inertial"]  # elements of the URDF that were fitted
    capsules: Annotated[list[CapsuleEntry], Meta(min_length=1, max_length=64)]
    corners: list[CornersEntry] = msgspec.field(default_factory=list)
    margin: Annotated[float, Meta(ge=0, le=0.2)] = 0.005  # clearance that is kept [m]
    left_out: list[LeftOut] = msgspec.field(default_factory=list)
    surroundings: str = ""  # digest of the surroundings at that time


class PlaneEntry(Settings, frozen=True):
    """Plane through a point; the side to which the normal points is free."""

    point: Vector3
    normal: Vector3


class BoxEntry(Settings, frozen=True):
    """Box about its centre, turned by roll, pitch and yaw as in a URDF."""

    centre: Vector3
    size: tuple[Radius, Radius, Radius]
    rpy: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)


class Surroundings(Settings, frozen=True):
    """Surroundings of the arm: tables, walls, obstacles, and space that is kept free for people,
    each under a name of your choice."""

    version: Literal[1]
    planes: dict[Name, PlaneEntry] = msgspec.field(default_factory=dict)
    boxes: dict[Name, BoxEntry] = msgspec.field(default_factory=dict)


class Walls(Settings, frozen=True):
    """Content of both files."""

    shapes: Shapes
    surroundings: Surroundings = Surroundings(version=1)

    @property
    def left_out(self) -> set[frozenset[str]]:
        """Pairs that are not guarded, by name."""
        return {frozenset(one.pair) for one in self.shapes.left_out}

    @property
    def in_words(self) -> str:
        """Summary of shapes, surroundings and unguarded pairs."""
        of, around = self.shapes, [*self.surroundings.planes, *self.surroundings.boxes]
        out = ", ".join(f"{' - '.join(one.pair)} ({one.why})" for one in of.left_out)
        return (
            f"shapes: {len(of.capsules)} capsules of {of.source} geometry; surroundings: "
            f"{', '.join(around) or 'none'}; not guarded: {out or 'none'}"
        )


def digest_of_surroundings(around: Surroundings) -> str:
    """Digest of the content of surroundings.yaml."""
    return digest_of(msgspec.json.encode(around).decode())


def digest_of(urdf: str) -> str:
    """Digest of a URDF's text."""
    return hashlib.sha256(urdf.encode()).hexdigest()[:16]


def read_walls(folder: Path, urdf: str, joints: list[str]) -> Walls | None:
    """Shapes and surroundings in the folder of a configuration; None without shapes.

    Raises ConfigurationError with file and line for content that the schema does not allow, an
    unknown joint, a duplicate name, shapes of another URDF, and surroundings without shapes.
    """
    path, surroundings = folder / SHAPES, read_surroundings(folder)
    if not path.exists():
        if surroundings is not None:
            raise ConfigurationError(
                f"{folder / SURROUNDINGS}: the arm has no shapes to keep away from it: "
                "`contactd shapes` first"
            )
        return None
    source = read_yaml(path)
    shapes = convert(source, Shapes)
    if shapes.urdf != digest_of(urdf):
        raise ConfigurationError(
            f"{path}:{source.line(['urdf'])}: fitted to another URDF: `contactd shapes --force`"
        )
    around = [*surroundings.planes, *surroundings.boxes] if surroundings else []
    joint_of = dict.fromkeys(around, "of the surroundings")
    parts: list[tuple[str, int, _Part]] = [
        *(("capsules", k, one) for k, one in enumerate(shapes.capsules)),
        *(("corners", k, one) for k, one in enumerate(shapes.corners)),
    ]
    cornered = {one.name for one in shapes.corners}
    for key, k, one in parts:
        where = f"{path}:{source.line([key, k])}: {key}[{k}]"
        if one.joint not in [BASE, *joints]:
            raise ConfigurationError(
                f"{where}: no joint {one.joint!r}; there are: {', '.join(joints)}, or '' for the "
                "root of the URDF"
            )
        if isinstance(one, CapsuleEntry) and one.edged and one.name not in cornered:
            raise ConfigurationError(f"{where}: edged, but there are no corners of {one.name!r}")
        if joint_of.setdefault(one.name, one.joint) != one.joint:
            also = f": {SURROUNDINGS} has it, too" if one.name in around else ""
            raise ConfigurationError(f"{where}: the name {one.name!r} is given twice{also}")
    walls = Walls(shapes=shapes, surroundings=surroundings or Surroundings(version=1))
    if shapes.surroundings != digest_of_surroundings(walls.surroundings):
        for k, left in enumerate(shapes.left_out):
            if {*around} & {*left.pair}:
                raise ConfigurationError(
                    f"{path}:{source.line(['left_out', k])}: left_out[{k}]: {SURROUNDINGS} has "
                    "changed since this pair was left out: `contactd shapes --force`"
                )
    if (pairs := guarded(walls)) > MOST_PAIRS:
        raise ConfigurationError(
            f"{path}:{source.line(['capsules'])}: {pairs} pairs to guard; at most {MOST_PAIRS} "
            "leave a tick its time: `contactd shapes --single --force`, or fewer planes and boxes"
        )
    return walls


def guarded(walls: Walls) -> int:
    """Number of pairs that are guarded."""
    capsules, around = walls.shapes.capsules, walls.surroundings
    pairs = [(a.name, b.name) for a, b in combinations(capsules, 2) if a.joint != b.joint]
    obstacles = [*around.planes, *around.boxes]
    pairs += [(a.name, name) for a in capsules if a.joint != BASE for name in obstacles]
    return sum(frozenset(pair) not in walls.left_out for pair in pairs)


def read_surroundings(folder: Path) -> Surroundings | None:
    """Surroundings in the folder of a configuration; None without. Raises ConfigurationError."""
    if not (folder / SURROUNDINGS).exists():
        return None
    source = read_yaml(folder / SURROUNDINGS)
    found = convert(source, Surroundings)
    for name, plane in found.planes.items():
        if math.hypot(*plane.normal) < 1e-6:
            line = source.line(["planes", name, "normal"])
            raise ConfigurationError(f"{source.path}:{line}: planes.{name}.normal: has no length")
    if shared := set(found.planes) & set(found.boxes):
        name = min(shared)
        line = source.line(["boxes", name])
        raise ConfigurationError(f"{source.path}:{line}: boxes: the name {name!r} is given twice")
    return found


def shapes_text(shapes: Shapes) -> str:
    """Text of shapes.yaml."""
    plain = msgspec.to_builtins(shapes)
    return HEAD + yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=100)


def clearance_of(walls: Walls, bodies: list[Body], joints: list[str]) -> Clearance:
    """Clearance of all guarded pairs."""
    numbers = {joints[body.row]: k for k, body in enumerate(bodies)} | {BASE: -1}
    capsules = [
        Capsule(one.name, numbers[one.joint], np.array(one.start), np.array(one.end), one.radius)
        for one in walls.shapes.capsules
    ]
    edges = [
        Capsule(one.name, numbers[one.joint], np.array(start), np.array(end), ROUNDING_M)
        for one in walls.shapes.corners
        for start, end in zip(one.points[::2], [*one.points[1::2], one.points[0]], strict=False)
    ]
    round_ = [c for c, one in zip(capsules, walls.shapes.capsules, strict=True) if not one.edged]
    pairs = pairs_of(capsules, [*round_, *edges], obstacles_of(walls), walls.left_out)
    return Clearance(bodies, [*capsules, *edges], pairs)


def obstacles_of(walls: Walls) -> list[Plane | Box]:
    """Planes and boxes of the surroundings."""
    planes, boxes = walls.surroundings.planes, walls.surroundings.boxes
    found: list[Plane | Box] = []
    for name, plane in planes.items():
        normal = np.array(plane.normal) / math.hypot(*plane.normal)
        found.append(Plane(name, normal, float(normal @ np.array(plane.point))))
    for name, box in boxes.items():
        half = 0.5 * np.array(box.size)
        found.append(Box(name, np.array(box.centre), pin.rpy.rpyToMatrix(*box.rpy), half))
    return found


def pairs_of(
    capsules: list[Capsule],
    beside_planes: list[Capsule],
    obstacles: list[Plane | Box],
    left_out: set[frozenset[str]],
) -> list[tuple[Capsule, Capsule | Plane | Box]]:
    """Pairs that can move relative to each other, without those that are left out."""
    pairs: list[tuple[Capsule, Capsule | Plane | Box]] = [
        (one, other) for k, one in enumerate(capsules) for other in capsules[:k]
        if one.body != other.body
    ]  # fmt: skip
    for other in obstacles:
        firsts = beside_planes if isinstance(other, Plane) else capsules
        pairs += [(one, other) for one in firsts if one.body >= 0]
    return [pair for pair in pairs if frozenset((pair[0].name, pair[1].name)) not in left_out]
