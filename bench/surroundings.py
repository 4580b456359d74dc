"""Bench of the walls: arms with shapes are driven at themselves, a table, a wall and a press.

    python -m bench.surroundings --json

Three arms get setpoints from clear poses: random ones, thrown ones (all joints at full speed into
the gap that closes soonest, for half a second), streamed ones (a position loop on targets that
jump) and led ones (a push, by the law of admittance). Setpoints pass `Limits` and `Walls`; joints
follow a tick later, with the drives' lag. The truth are convex hulls of the points that `contactd
shapes` fits capsules to, at the distances of coal; pairs that are left out are not judged.

A pose is lost if the truth is clear and the shapes leave less than their margin. Times are those of
the processor, as others use it, too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import thread_time
from typing import Any, Final

import click
import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from bench.options import SEED, command
from bench.report import Target, plain, print_report
from bench.rigs.lockstep import BEAM, OPENARM, ROMEO
from common.arrays import Matrix, Vector
from daemon.assembly import build_walls
from daemon.config import shapes
from daemon.config.load import Robot, load_robot
from daemon.config.vectors import limits_of, row, virtual_mass_of
from daemon.motion.admittance import AdmittanceLaw
from estimator.shapes import Box, Capsule, Plane
from estimator.walls import Walls
from programs.contactd.fitting import fitted, points_of

KINDS: Final = ("random", "thrown", "streamed", "led")
TICKS: Final = 300  # of one motion
POSES: Final = 1000  # for the lost workspace
CLEAR_M: Final = (0.008, 0.1)  # smallest gap of the pose in which a motion begins
NEAR_S: Final = 0.5  # in which the sign of a setpoint may change twice
SLOWED: Final = 1e-3  # least difference of a setpoint, and least setpoint with a sign [rad/s]
HELD, LASTS = 50, 10  # ticks for which a throw, a push or a target lasts, and a random setpoint


@dataclass(frozen=True, slots=True)
class Scene:
    """One arm in its surroundings, bounded, and what is true of it."""

    name: str
    robot: Robot
    walls: Walls
    truth: "Truth"
    lower: Vector
    upper: Vector


class Truth:
    """Hulls of links, by the names of their capsules, in the frames of their joints."""

    def __init__(self, robot: Robot) -> None:
        self._model = pin.buildModelFromXML(robot.urdf)
        self._data = self._model.createData()
        names = list(self._model.names)[1:]
        self._row = [robot.configuration.joint_names.index(name) for name in names]
        links = points_of(robot, None, single=True)[1]  # whole: parts share a name
        self._hulls = {one.name: _hull(one.points) for one in links}

    def gap(self, q: Vector, pair: tuple[Capsule, Capsule | Plane | Box]) -> float:
        """Distance [m] of a pair at q (n,) [rad]."""
        pin.forwardKinematics(self._model, self._data, q[self._row])
        first, other = self._placed(pair[0]), pair[1]
        if isinstance(other, Capsule):
            second = self._placed(other)
        elif isinstance(other, Plane):
            second = coal.Halfspace(other.normal, other.offset), coal.Transform3s.Identity()
        else:
            second = coal.Box(*(2.0 * other.half)), coal.Transform3s(other.axes, other.centre)
        request = coal.DistanceRequest()
        return float(coal.distance(*first, *second, request, coal.DistanceResult()))

    def _placed(self, one: Capsule) -> tuple[coal.Convex, coal.Transform3s]:
        at = self._data.oMi[one.body + 1]
        return self._hulls[one.name], coal.Transform3s(at.rotation, at.translation)


def _hull(points: Matrix) -> coal.Convex:
    hull = ConvexHull(points)
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        corners.append(point)
    for face in hull.simplices.tolist():
        faces.append(coal.Triangle(*face))
    return coal.Convex(corners, faces)


#: Times its reach, and share of that at which the press is beside the root: this arm is on the left
#: of it, and bends forward.
AWAY, BESIDE = {"romeo_left_arm": 1.8}, {"romeo_left_arm": -0.15}


def scene(folder: Path) -> Scene:
    """An arm behind a table, before a wall, beside a press, as far away as its reach says."""
    robot = load_robot(folder)
    R = robot.model.reach * AWAY.get(folder.name, 1.0)
    around = shapes.Surroundings(
        version=1,
        planes={
            "table": shapes.PlaneEntry(point=(0.0, 0.0, -0.35 * R), normal=(0.0, 0.0, 1.0)),
            "wall": shapes.PlaneEntry(point=(0.5 * R, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)),
        },
        boxes={
            "press": shapes.BoxEntry(
                centre=(0.3 * R, BESIDE.get(folder.name, 0.4) * R, 0.1 * R),
                size=(0.3 * R,) * 3,
                rpy=(0.0, 0.0, 0.4),
            )
        },
    )
    found, _ = fitted(robot, None, around)
    robot = replace(robot, walls=shapes.Walls(shapes=found, surroundings=around))
    walls, limits = build_walls(robot), limits_of(robot.configuration)
    if walls is None:
        raise RuntimeError("no walls")
    return Scene(folder.name, robot, walls, Truth(robot), limits.lower, limits.upper)


def clear_pose(scene: Scene, rng: np.random.Generator) -> Vector:
    """Random pose with a gap of CLEAR_M between the nearest shapes."""
    clearance = scene.walls.clearance
    while True:
        q: Vector = rng.uniform(scene.lower, scene.upper)
        clearance.at(q)
        if CLEAR_M[0] < np.min(clearance.gap) < CLEAR_M[1]:
            return q


def wishes(
    scene: Scene, kind: str, rng: np.random.Generator
) -> Iterator[tuple[Vector, Vector, Vector]]:
    """For each tick a target [rad], a velocity [rad/s] and a push [Nm] that are wished for, of
    which the kind says which counts; they last."""
    limits, walls = limits_of(scene.robot.configuration), scene.walls
    level = row(scene.robot.configuration, lambda j: j.thresholds.contact)
    for k in range(TICKS):
        if k % (LASTS if kind == "random" else HELD) == 0:
            gap, gradient = (np.asarray(a) for a in (walls.clearance.gap, walls.clearance.gradient))
            soonest = np.argmax(np.abs(gradient) @ limits.velocity / np.maximum(gap, CLEAR_M[0]))
            way = -np.sign(gradient[soonest])
            if kind == "random":
                way = rng.uniform(-1.0, 1.0, len(level))
            thrown = limits.velocity * way
            target = rng.uniform(scene.lower, scene.upper)
            push = 3.0 * level * rng.choice([-1.0, 0.0, 1.0], len(level))
        yield target, thrown, push


def motion(scene: Scene, kind: str, seed: int) -> dict[str, Any]:
    """Figures of one motion: deepest true penetration [m], most sign changes within NEAR_S of one
    wish of the setpoint of a joint that a wall slows in it, times of a bound [s], ticks that were
    slowed."""
    rng, c = np.random.default_rng(seed), scene.robot.configuration
    limits, walls, dt = limits_of(c), scene.walls, c.period_s
    law = AdmittanceLaw(virtual_mass_of(c), np.full(len(c.joints), c.admittance.velocity))
    gain = row(c, lambda j: j.admittance_gain)
    q = clear_pose(scene, rng)
    v, sent, play = np.zeros_like(q), np.zeros_like(q), limits.each(0.0)
    lag = dt / (dt + c.control.drive_lag_ms / 1000.0)
    times, bounds, trace, deepest, slowed, least = [], [], [], 0.0, 0, np.inf
    for target, thrown, push in wishes(scene, kind, rng):
        if kind == "led":
            wish = limits.soft_stop(q, law.velocity_after(sent, gain, push, dt), 8.0)
        else:
            wish = c.control.position_gain * (target - q) if kind == "streamed" else thrown
        late, wanted, sent = sent, limits.bound_velocity(q, wish, sent, dt), np.empty_like(q)
        began = thread_time()
        walls.bound(q, v, wanted, play, sent)
        times.append(thread_time() - began)
        bounds.append((wanted, sent))
        slowed += walls.slows
        v = v + lag * (late - v)
        q = q + v * dt
        walls.clearance.at(q)
        trace.append((np.min(walls.clearance.gap), np.abs(wish).max(), np.abs(sent).max()))
        least = min(least, float(np.min(walls.clearance.gap)))
        for row_ in np.flatnonzero(np.asarray(walls.clearance.gap) < 0.0):
            pair = walls.clearance.pairs[walls.clearance.pair[row_]]
            deepest = max(deepest, -scene.truth.gap(q, pair))
    held = range(0, len(bounds), HELD) if kind != "random" else ()
    most = max((chatter(*np.array(bounds[k : k + HELD]).swapaxes(0, 1)) for k in held), default=0)
    return {
        "deepest_m": deepest, "changes": most, "times": times, "slowed": slowed, "least": least,
        "trace": np.array(trace),
    }  # fmt: skip


def chatter(wanted: Matrix, sent: Matrix) -> int:
    """Most sign changes of a joint's setpoint, in (ticks, n), of those that differ from what was
    wanted; pauses are none."""
    most = 0
    for j in np.flatnonzero((np.abs(wanted - sent) > SLOWED).any(axis=0)):
        signs = np.sign(sent[np.abs(sent[:, j]) > SLOWED, j])
        most = max(most, int(np.count_nonzero(np.diff(signs))))
    return most


def lost(scene: Scene, seed: int) -> tuple[int, int, int]:
    """Poses that are clear by the truth, those of them that the shapes forbid, and those that the
    truth would with the same margin."""
    rng, clearance = np.random.default_rng(seed), scene.walls.clearance
    margin, clear, forbidden, near = scene.robot.walls.shapes.margin, 0, 0, 0  # type: ignore[union-attr]
    for _ in range(POSES):
        q = rng.uniform(scene.lower, scene.upper)
        clearance.at(q)
        if (gap := min(scene.truth.gap(q, pair) for pair in clearance.pairs)) > 0.0:
            clear += 1
            forbidden += float(np.min(clearance.gap)) < margin
            near += gap < margin
    return clear, forbidden, near


def draw(trace: Matrix, margin: float, period_s: float, file: Path) -> None:
    """Picture of one motion: the smallest gap, and the fastest joint as wished for and as sent."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # takes a second

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    time_s = period_s * np.arange(len(trace))
    above.plot(time_s, 1000.0 * trace[:, 0], label="smallest gap")
    above.axhline(1000.0 * margin, color="grey", linestyle=":", label="margin")
    above.set(ylabel="mm", ylim=(0.0, None))
    below.plot(time_s, trace[:, 1], color="grey", label="fastest joint, as wished for")
    below.plot(time_s, trace[:, 2], label="as sent")
    below.set(xlabel="s", ylabel="rad/s")
    for axes in (above, below):
        axes.legend()
    figure.savefig(file, dpi=100)


@command(__doc__)
@click.option("--motions", type=click.IntRange(1, 10_000), default=40, help="Of each kind and arm.")
@SEED
@click.option("--picture", type=click.Path(path_type=Path), help="A throw of the OpenArm.")
def main(motions: int, seed: int, picture: Path | None, as_json: bool) -> None:
    rows, data = [], {}
    if picture is not None:
        one = scene(OPENARM)
        draw(motion(one, "thrown", seed)["trace"], 0.005, one.robot.configuration.period_s, picture)
    for folder in (ROMEO, OPENARM, BEAM):
        one = scene(folder)
        runs = [motion(one, kind, seed + k) for kind in KINDS for k in range(motions)]
        clear, forbidden, near = lost(one, seed)
        times = 1e6 * np.concatenate([run["times"] for run in runs])
        data[one.name] = {
            "setpoints": len(times),
            "slowed": sum(run["slowed"] for run in runs) / len(times),
            "least_gap_of_shapes_mm": 1000.0 * min(run["least"] for run in runs),
            "pairs": len(one.walls.clearance.pairs),
            "bound_us": np.percentile(times, [50.0, 99.0, 99.9]).tolist(),
            "clear_poses": clear,
            "lost_to_margin": near / max(clear, 1),
        }
        deepest = 1000.0 * max(run["deepest_m"] for run in runs)
        changes = max(run["changes"] for run in runs)
        rows += [
            Target(f"deepest penetration of the truth, {one.name}", deepest, 0.0, "mm"),
            Target(f"lost of the workspace, {one.name}", forbidden / max(clear, 1), 0.05),
            Target(f"sign changes of a setpoint in {NEAR_S:g} s, {one.name}", changes, 2),
            Target(f"bound, p99.9, {one.name}", float(np.percentile(times, 99.9)), 200.0, "us"),
        ]
    print_report("surroundings", seed, rows, plain(data, 3), as_json=as_json)


if __name__ == "__main__":
    main()
