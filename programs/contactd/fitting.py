"""`contactd shapes`: fits capsules to the links of an arm and writes them to shapes.yaml."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import coal
import numpy as np
import pinocchio as pin
from msgspec import structs

from common.arrays import Matrix
from common.errors import ConfigurationError, ModelError
from common.yaml_source import read_yaml
from daemon.config.convert import convert
from daemon.config.load import Robot, load_robot
from daemon.config.shapes import (
    BASE,
    MOST_CORNERS,
    SHAPES,
    SURROUNDINGS,
    CapsuleEntry,
    CornersEntry,
    LeftOut,
    Shapes,
    Surroundings,
    Walls,
    clearance_of,
    digest_of,
    digest_of_surroundings,
    read_surroundings,
    shapes_text,
)
from estimator.dynamics import Body
from estimator.model_reading import read_urdf
from identification.capsules import PairGaps, corners_of, fit_capsule, gaps_over_poses, split
from programs.command_line.sentences import say

Source = Literal["collision", "visual", "inertial"]
_TYPES = {"collision": pin.GeometryType.COLLISION, "visual": pin.GeometryType.VISUAL}
_RIM = 24  # vertices of the polygon circumscribed about a circle


@dataclass(frozen=True, slots=True, eq=False)
class LinkPoints:
    """Points (m, 3) [m] of a body in the frame of its joint; the body extends `radius` [m] beyond
    their convex hull."""

    name: str
    body: int
    points: Matrix
    radius: float = 0.0


def write_shapes(config: Path, source: Source | None, *, force: bool, single: bool) -> None:
    """Fit capsules, sample which pairs are worth guarding, write shapes.yaml, and list capsules and
    pairs. Raises ConfigurationError."""
    robot = load_robot(config, walls=False)  # errors in the shapes to be replaced do not matter
    path = robot.folder / SHAPES
    if path.exists() and not force:
        raise ConfigurationError(
            f"{path}: exists; --force replaces it, keeping its margin and capsules of other names"
        )
    around = read_surroundings(robot.folder) or Surroundings(version=1)
    before = _before(path) if path.exists() else None
    shapes, report = fitted(robot, source, around, single=single, before=before)
    path.write_text(shapes_text(shapes))
    say(f"{len(shapes.capsules)} capsules from the URDF's {shapes.source} geometry")
    for line in report:
        say(line)
    say(f"wrote {path}; `contactctl reload` takes it up, while the arm is off")


def fitted(
    robot: Robot, source: Source | None, around: Surroundings, *, single: bool = False,
    before: Shapes | None = None,
) -> tuple[Shapes, list[str]]:  # fmt: skip
    """Shapes of a robot, including capsules that the user added to the shapes `before`, and a
    report of all pairs. Raises ConfigurationError, ModelError."""
    chosen, links = points_of(robot, source, single=single)
    corners = _corners_of(robot, points_of(robot, source, single=True)[1])
    capsules = _capsules(robot, links, {one.name for one in corners})
    shapes = Shapes(
        version=1, urdf=digest_of(robot.urdf), source=chosen, capsules=capsules, corners=corners,
        surroundings=digest_of_surroundings(around),
    )  # fmt: skip
    shapes, kept = _with_added(shapes, before, robot.configuration.joint_names)
    _named_apart(robot.folder, shapes, around)
    left_out, report = _left_out(robot, Walls(shapes=shapes, surroundings=around))
    return structs.replace(shapes, left_out=left_out), [*kept, *report]


def _named_apart(folder: Path, shapes: Shapes, around: Surroundings) -> None:
    """Raise ConfigurationError for a plane or box that has the name of a link."""
    links = {one.name for one in shapes.capsules}
    for key, names in (("planes", around.planes), ("boxes", around.boxes)):
        for name in links & set(names):
            source = read_yaml(folder / SURROUNDINGS)
            raise ConfigurationError(
                f"{source.path}:{source.line([key, name])}: {key}.{name}: the name of a link's "
                "capsule: choose another"
            )


def _before(path: Path) -> Shapes | None:
    """Shapes of the file to be replaced; None, with a message, if it cannot be parsed."""
    try:
        return convert(read_yaml(path), Shapes)
    except ConfigurationError as error:
        say(f"nothing of {path.name} is kept: {error}")
        return None


def _with_added(
    shapes: Shapes, before: Shapes | None, joints: list[str]
) -> tuple[Shapes, list[str]]:
    """Shapes with the margin and the user's capsules of those before, and a report of the latter.
    Capsules fitted to another URDF, or to other geometry, may have other names: they are listed,
    not kept."""
    if before is None:
        return shapes, []
    names, alike = {one.name for one in shapes.capsules}, before.urdf == shapes.urdf
    added = [one for one in before.capsules if one.name not in names]
    alike = alike and before.source == shapes.source
    kept = [one for one in added if alike and not one.edged and one.joint in [BASE, *joints]]
    words = [
        f"{'kept' if one in kept else 'gone':9} {one.name}, a capsule of {one.joint or 'the root'}"
        for one in added
    ]
    capsules = [*shapes.capsules, *kept]
    return structs.replace(shapes, capsules=capsules, margin=before.margin), words


def points_of(
    robot: Robot, source: Source | None, *, single: bool = False
) -> tuple[Source, list[LinkPoints]]:
    """Points of all links, from the first kind of geometry that the URDF has. Unless `single`, a
    link is split in two where that makes thinner capsules."""
    kind, links = _links_of(robot, source)
    if single:
        return kind, links
    return kind, [replace(link, points=points) for link in links for points in split(link.points)]


def _links_of(robot: Robot, source: Source | None) -> tuple[Source, list[LinkPoints]]:
    for kind in ("collision", "visual"):
        if source in (None, kind) and (links := list(_described(robot, kind))):
            return kind, links
    if source in ("collision", "visual"):
        raise ConfigurationError(f"{robot.configuration.urdf}: has no {source} geometry")
    return "inertial", list(_inertial(robot))


def _described(robot: Robot, kind: str) -> Iterator[LinkPoints]:
    """Links from their <collision> or <visual> geometry."""
    if f"<{kind}" not in robot.urdf:
        return
    model, _ = read_urdf(robot.urdf)
    folder = (robot.folder / robot.configuration.urdf).parent
    try:
        geometry = pin.buildGeomFromUrdfString(
            model, robot.urdf, _TYPES[kind], package_dirs=[str(folder)]
        )
    except ValueError as error:
        raise ModelError(f"{robot.configuration.urdf}: {kind} geometry: {error}") from error
    for one in geometry.geometryObjects:
        points, radius = _points(one.geometry, np.asarray(one.meshScale))
        placed = points @ one.placement.rotation.T + one.placement.translation
        yield LinkPoints(one.name.removesuffix("_0"), one.parentJoint - 1, placed, radius)


def _points(shape: coal.CollisionGeometry, scale: Matrix) -> tuple[Matrix, float]:
    """Points of a shape in its own frame, and the radius by which it extends beyond them."""
    up = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    if isinstance(shape, coal.Sphere):
        return np.zeros((1, 3)), shape.radius
    if isinstance(shape, coal.Capsule):
        return up * shape.halfLength, shape.radius
    if isinstance(shape, coal.Box):
        return _corners(shape.halfSide), 0.0
    if isinstance(shape, coal.Cylinder):
        angle = 2.0 * np.pi / _RIM * np.arange(_RIM)
        rim = shape.radius / np.cos(np.pi / _RIM) * np.array([np.cos(angle), np.sin(angle)]).T
        ends = [np.column_stack((rim, np.full(_RIM, z * shape.halfLength))) for z in (-1, 1)]
        return np.vstack(ends), 0.0
    return np.asarray(shape.vertices()) * scale, 0.0


def _inertial(robot: Robot) -> Iterator[LinkPoints]:
    """Links as the box of uniform density with their mass and inertia, extended to the joints at
    both ends."""
    bodies = robot.model.bodies()
    for k, body in enumerate(bodies):
        points = [np.zeros((1, 3)), *_box_of(body)]
        points += [b.translation[np.newaxis] for b in bodies if b.parent == k]
        yield LinkPoints(robot.configuration.joint_names[body.row], k, np.vstack(points))


def _box_of(body: Body) -> Iterator[Matrix]:
    if body.mass > 0.0:
        centre = body.moment / body.mass
        about = body.inertia - body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        moments, axes = np.linalg.eigh(about)
        square = 1.5 * (moments.sum() - 2.0 * moments) / body.mass
        yield centre + _corners(np.sqrt(np.maximum(square, 0.0))) @ axes.T


def _corners(half: Matrix) -> Matrix:
    return np.array(np.meshgrid(*([-1.0, 1.0],) * 3)).reshape(3, 8).T * half


def _capsules(robot: Robot, links: list[LinkPoints], edged: set[str]) -> list[CapsuleEntry]:
    joints, bodies, entries = robot.configuration.joint_names, robot.model.bodies(), []
    for link in links:
        fit = fit_capsule(link.points)
        start, end = (tuple(np.round(p, 4).tolist()) for p in (fit.start, fit.end))
        joint = joints[bodies[link.body].row] if link.body >= 0 else BASE
        fits_m = fit.radius if link.radius == 0.0 else max(fit.radius - 0.005, 0.0) + link.radius
        radius = round(fits_m + 1e-4, 4)  # 0.1 mm covers the rounding
        entries.append(
            CapsuleEntry(
                name=link.name,
                joint=joint,
                start=start,
                end=end,
                radius=radius,
                edged=link.name in edged,
            )
        )
    return entries


def _corners_of(robot: Robot, links: list[LinkPoints]) -> list[CornersEntry]:
    """Corners of the links that have at most MOST_CORNERS."""
    joints, bodies, entries = robot.configuration.joint_names, robot.model.bodies(), []
    for link in links:
        points = corners_of(link.points)
        if link.body >= 0 and link.radius == 0.0 and len(points) <= MOST_CORNERS:
            joint, places = joints[bodies[link.body].row], np.round(points, 4).tolist()
            entries.append(CornersEntry(name=link.name, joint=joint, points=places))
    return entries


def _left_out(robot: Robot, walls: Walls) -> tuple[list[LeftOut], list[str]]:
    """Pairs that are not guarded, and a report of all pairs."""
    c, bodies = robot.configuration, robot.model.bodies()
    clearance = clearance_of(walls, bodies, c.joint_names)
    lower = np.array([joint.limits.lower for joint in c.joints])
    upper = np.array([joint.limits.upper for joint in c.joints])
    gaps = gaps_over_poses(clearance, lower, upper, walls.shapes.margin)
    left_out, report = [], []
    for first, second in {(a.name, b.name): (a, b) for a, b in clearance.pairs}.values():
        found = gaps[first.name, second.name]
        one, other = first.body, getattr(second, "body", -2)
        near = other in _carriers(bodies, one) or one in _carriers(bodies, other)
        why = found.why(neighbours=near)
        if other == -2:  # surroundings: poses through a table prove nothing, and it may be moved
            why = "always" if found.touching == 1.0 else None
        report.append(f"{'left out' if why else 'guarded':9} {first.name} - {second.name}: "
                      f"{_in_words(found)}")  # fmt: skip
        if why:
            left_out.append(LeftOut(pair=(first.name, second.name), why=why))
    _some_guarded(robot.folder, walls, {one.pair for one in left_out}, list(gaps))
    if len(left_out) == len(gaps):
        report.append("no pair is left to guard, so nothing will be slowed")
    return left_out, report


def _some_guarded(
    folder: Path, walls: Walls, left_out: set[tuple[str, str]], pairs: list[tuple[str, str]]
) -> None:
    """Raise ConfigurationError for a plane or box that contains the whole arm in all poses: all its
    pairs are left out, so nothing would be kept away from it."""
    around = walls.surroundings
    for key, name in [("planes", k) for k in around.planes] + [("boxes", k) for k in around.boxes]:
        if {pair for pair in pairs if pair[1] == name} <= left_out:
            source = read_yaml(folder / SURROUNDINGS)
            free = ": its normal must point to the free side" if key == "planes" else ""
            raise ConfigurationError(
                f"{source.path}:{source.line([key, name])}: {key}.{name}: the whole arm is inside "
                f"it in all poses, so nothing would be kept away from it{free}"
            )


def _carriers(bodies: list[Body], body: int) -> list[int]:
    return [bodies[body].parent] if body >= 0 else []


def _in_words(gaps: PairGaps) -> str:
    if gaps.touching == 0.0 and gaps.least > 0.0:
        return f"never closer than {1000.0 * gaps.least:.0f} mm"
    return f"touch in {gaps.touching:.1%} of all poses"
