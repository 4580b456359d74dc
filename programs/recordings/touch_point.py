"""Point of contact: which link is touched and where on it, from the residuals of all joints.

A force f at a point x of a link causes the torques J(x)^T f at the joints. Each point on the
surface of each link is a hypothesis, with a zero-mean normal prior of f of standard deviation F:

    r ~ mean over F of N(0, D + F^2 J(x)^T J(x)),    D = diag(s_i^2),    F = 2, 5, 12, 30 N

so that a link further out, whose own joint shows no residual, is as unlikely as a force through
that joint's axis. A priori the last link, with the tool, is as likely as all others together. For
clients that read States; not part of the loop.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import pi
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike

from common.arrays import Matrix, Vector
from daemon.modes.table import SENSING
from daemon.protocol.state import Snapshot, State
from programs.recordings.skeleton import Skeleton, from_rpy, rotated, skeleton_of, triple

LIKELY, SURE_S = 0.5, 0.06
"""A link is decided after being the most likely one for SURE_S [s], weighted by its probability:
fully at one, not at all at LIKELY. Residuals of outer joints rise later, because of their gaps."""
MOSTLY, MOSTLY_SURE, MOSTLY_S = 0.7, 0.6, 0.2
"""Or after MOSTLY_S [s], if its probability is MOSTLY_SURE and its share so far MOSTLY."""
CANDIDATE: Final = 0.05
MOST_DOUBT_M, LEAST_SURE = 0.1, 0.7
"""A point is only given up to this uncertainty [m], and from this probability of its link on."""
NO_FIT: Final = 3.0
"""Misfit from which on no force at one point explains the residuals."""
_FORCES_N: Final = np.array([2.0, 5.0, 12.0, 30.0]).reshape(-1, 1)
_ALONG, _AROUND = 12, 12  # points along and around a capsule
# Standard deviation of a residual, relative to the level in force, to its raise, and to the largest
# recent r' / K; K is the usual gain of configurations.
_LEVEL, _RAISED, _LAG, _GAIN = 0.05, 0.25, 0.8, 25.0
_LEAST_NM = 1e-3
_SHAPE_M, _COARSE_M = 0.03, 0.006  # error of a surface; spacing of its points
_BALL_M = 0.035  # radius of the ball for a link that is too short for a capsule
_EVERY, _LATE_S = 3, 0.05  # ticks between evaluations; longest time that one counts for [s]


@dataclass(frozen=True, slots=True)
class TouchPoint:
    """Contact at one point. `joints`: those whose links may be touched, the most likely, with
    probability `sure`, first; `decided`: that one alone. `point` (3,) [m] and `force` (3,) [N] are
    in the frame of the URDF's link `link`. If the first joint is right, the true point is within
    `doubt_m` in 95 % of cases."""

    joints: tuple[str, ...]
    sure: float
    decided: bool
    link: str
    point: Vector
    doubt_m: float
    force: Vector
    misfit: float

    @property
    def placed(self) -> bool:
        """True if the point is known well enough."""
        near = self.doubt_m <= MOST_DOUBT_M and self.sure >= LEAST_SURE
        return near and self.misfit < NO_FIT


@dataclass(slots=True)
class LinkDecision:
    """Decision on the touched link, by its joint: the most likely one at present, the weighted time
    for which it has been so, and sums of probabilities by joint."""

    best: int = -1
    counts_s: float = 0.0
    since_s: float = 0.0
    sums: dict[int, float] = field(default_factory=dict)

    def decides(self, best: int, sure: float, dt: float) -> bool:
        """Add dt [s] of joint `best` as the most likely one; True if its link is decided."""
        counts_s = dt * (sure - LIKELY) / (1.0 - LIKELY)
        stays = best == self.best and counts_s >= 0.0
        self.counts_s = self.counts_s + counts_s if stays else 0.0
        self.best = best
        self.sums[best] = self.sums.get(best, 0.0) + sure
        mostly = sure >= MOSTLY_SURE and self.sums[best] >= MOSTLY * sum(self.sums.values())
        late = self.since_s >= MOSTLY_S - 1e-9
        self.since_s += dt
        return self.counts_s >= SURE_S - 1e-9 or (late and mostly)


class TouchFinder:
    """Finder of the point of contact of one arm; `take` each tick."""

    def __init__(self, urdf: str, joints: Sequence[str], contact: ArrayLike) -> None:
        """Create a finder; contact: configured levels (n,) [Nm]. Raises ModelError."""
        self._names, self._contact = tuple(joints), np.array(contact)
        self._skeleton: Skeleton = skeleton_of(urdf)
        surfaces = _collisions(urdf)
        for capsule in self._skeleton.capsules:
            if capsule.link not in surfaces:
                surfaces[capsule.link] = [_surface(np.array(capsule.end), capsule.radius)]
        for frame in self._skeleton.frames:
            if frame.joint in self._names and frame.child not in surfaces:
                surfaces[frame.child] = [_BALL_M * _unit_ball()]
        self.surfaces = {link: np.concatenate(parts) for link, parts in surfaces.items()}
        self._r, self._lag = np.full((2, len(self._names)), np.nan)
        self._ticks, self._likely = 0, LinkDecision()
        self._found: TouchPoint | None = None
        self._time_s = np.inf
        self.frames: dict[str, tuple[Matrix, Vector]] = {}
        """Rotation and origin [m] of each link in the root's frame, at the last evaluation."""

    @classmethod
    def of(cls, snapshot: Snapshot) -> "TouchFinder":
        """Finder for the arm of a snapshot. Raises ModelError for an invalid URDF."""
        return cls(snapshot.urdf, snapshot.joints, snapshot.thresholds)

    def see(self, state: State) -> TouchPoint | None:
        """Contact of a State, as by `take`; States in between may be missing. None in a mode
        without sensing."""
        q, r, level = (
            np.array(values, dtype=np.float64)
            for values in (state.link_position, state.residual, state.threshold)
        )
        if state.mode not in SENSING:
            r = np.zeros(len(r))
        elif state.sensing is not None:
            r = np.where(state.sensing, r, np.nan)
        share = np.ones(len(q)) if state.level_share is None else np.array(state.level_share)
        since, self._time_s = state.time_s - self._time_s, state.time_s
        return self.take(q, r, level, share, max(since, state.interval_s))

    def take(
        self, q: Vector, r: Vector, threshold: Vector, share: Vector, dt: float
    ) -> TouchPoint | None:
        """Contact of one tick, dt [s] after the last, evaluated every third tick; None if no
        residual r exceeds its threshold [Nm]. share: of the configured level that is in force; (n,)
        each. Joints whose residual is not finite are ignored."""
        rate = np.nan_to_num(np.abs(r - self._r)) / (_GAIN * dt)
        self._lag = np.maximum(rate, np.nan_to_num(self._lag) / (1.0 + _GAIN * dt))
        self._r = r
        if not np.any(np.abs(r) > threshold):
            self._ticks, self._likely, self._found = 0, LinkDecision(), None
            return None
        if self._ticks % _EVERY == 0:
            usual = share * self._contact
            parts = (_LEVEL * usual, _RAISED * (threshold - usual), _LAG * self._lag)
            variance = np.sum(np.square(parts), axis=0) + _LEAST_NM**2
            variance[~np.isfinite(r)] = np.inf
            self._found = self._find(
                np.nan_to_num(q), np.nan_to_num(r), variance, min(_EVERY * dt, _LATE_S)
            )
        self._ticks += 1
        return self._found

    def _find(self, q: Vector, r: Vector, variance: Vector, dt: float) -> TouchPoint | None:
        """Point that best explains r with this variance; None if no joint moves a link."""
        at, J, row, links = self._hypotheses(q)
        if not len(at):
            return None
        counts, levers, size = np.isfinite(variance), np.any(J != 0.0, axis=2), 0.0
        for _ in range(2):  # the second time with the error from the spacing of points
            w = 1.0 / (variance + levers * (_COARSE_M * size) ** 2)
            S = np.einsum("pia,pi,pib->pab", J, w, J)
            S = S + np.eye(3) / np.square(_FORCES_N)[..., np.newaxis, np.newaxis]
            h = np.einsum("pia,pi->pa", J, w * r)
            force = np.linalg.solve(S, h[..., np.newaxis])[..., 0]
            left = np.sum(w * r * r, axis=1) - np.sum(h * force, axis=2)
            log = 0.5 * np.sum(np.log(w[:, counts]), axis=1) - 0.5 * np.linalg.slogdet(S)[1]
            log -= 0.5 * left + 3.0 * np.log(_FORCES_N)
            size = float(np.linalg.norm(force.reshape(-1, 3)[log.argmax()]))
        count = np.bincount(row, minlength=len(self._names))
        beforehand = 1.0 / np.maximum(count, 1)
        last = row[np.count_nonzero(levers, axis=1).argmax()]
        beforehand[last] *= max(np.count_nonzero(count) - 1, 1)
        weight = np.exp(log - log.max()) * beforehand[row]
        likely = weight.sum(axis=0) / weight.sum()
        of_joint = np.bincount(row, weights=likely, minlength=len(self._names))
        best = int(of_joint.argmax())
        own = row == best
        share = likely[own] / of_joint[best]
        point = share @ at[own]
        away = np.linalg.norm(at[own] - point, axis=1)
        order = np.argsort(away)
        within = int(np.searchsorted(np.cumsum(share[order]), 0.95))
        link = links[int(np.flatnonzero(own)[share.argmax()])]
        rotation, origin = self.frames[link]
        sure = float(of_joint[best])
        return TouchPoint(
            joints=tuple(self._names[i] for i in np.argsort(-of_joint) if of_joint[i] > CANDIDATE),
            sure=sure,
            decided=self._likely.decides(best, sure, dt),
            link=link,
            point=rotation.T @ (point - origin),
            doubt_m=float(np.hypot(away[order[min(within, len(order) - 1)]], _SHAPE_M)),
            force=rotation.T @ np.average(force[:, own], axis=(0, 1), weights=weight[:, own]),
            misfit=float(np.sqrt(max(left.min(), 0.0) / max(int(np.sum(counts)) - 5, 1))),
        )

    def _hypotheses(self, q: Vector) -> tuple[Matrix, Matrix, Vector, list[str]]:
        """Points (p, 3) [m] in the root's frame, their J (p, n, 3), the index of the joint that
        moves each, and its link."""
        angle = dict(zip(self._names, q.tolist(), strict=True))
        root = self._skeleton.root
        self.frames = frames = {root: (np.eye(3), np.zeros(3))}
        chain: dict[str, tuple[int, ...]] = {root: ()}
        axes: dict[int, tuple[Vector, Vector, bool]] = {}
        for frame in self._skeleton.frames:
            rotation, origin = frames[frame.parent]
            shift, turn = frame.at(angle.get(frame.joint, 0.0))
            turned = rotation @ np.array([rotated(turn, unit) for unit in np.eye(3).tolist()]).T
            frames[frame.child] = turned, origin + rotation @ shift
            chain[frame.child] = chain[frame.parent]
            if frame.joint in angle:
                i = self._names.index(frame.joint)
                chain[frame.child] += (i,)
                axes[i] = turned @ frame.axis, frames[frame.child][1], frame.slides
        points, jacobians, rows, links = [], [], [], []
        for link, surface in self.surfaces.items():
            if not chain.get(link):
                continue
            rotation, origin = frames[link]
            x = surface @ rotation.T + origin
            J = np.zeros((len(x), len(self._names), 3))
            for i in chain[link]:
                axis, place, slides = axes[i]
                J[:, i] = axis if slides else np.cross(axis, x - place)
            points.append(x)
            jacobians.append(J)
            rows += [chain[link][-1]] * len(x)
            links += [link] * len(x)
        empty = np.zeros((0, 3))
        return (
            np.concatenate([empty, *points]),
            np.concatenate([np.zeros((0, len(self._names), 3)), *jacobians]),
            np.array(rows, dtype=np.int64),
            links,
        )


def touch_words(found: TouchPoint) -> str:
    """Words such as `l_wrist at (0.01 0.00 0.06) m +- 3 cm`, or what is unknown."""
    if found.misfit >= NO_FIT:
        return "two places, or none that is one force"
    meant = " or ".join(found.joints[1:])
    others = f", or the link of {meant}" if meant and not found.decided else ""
    if not found.placed:
        return f"{found.link}{others}; where on it is not known"
    place = " ".join(f"{x:.2f}" for x in np.round(found.point, 2) + 0.0)
    return f"{found.link} at ({place}) m +- {100.0 * found.doubt_m:.0f} cm{others}"


def _surface(end: Vector, radius: float) -> Matrix:
    """Points on the lateral surface of a cylinder from the origin to `end` (3,)."""
    along = end / np.linalg.norm(end)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    angle = 2.0 * pi * np.arange(_AROUND) / _AROUND
    ring = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(along, first))
    return np.concatenate([part * end + radius * ring for part in np.linspace(0.05, 1.0, _ALONG)])


def _collisions(urdf: str) -> dict[str, list[Matrix]]:
    """Surface points of the links with collision shapes other than meshes, in the link's frame."""
    found: dict[str, list[Matrix]] = {}
    for link in ET.fromstring(urdf).findall("link"):
        for shape in link.findall("collision"):
            points = _shape(shape)
            if points is None:
                continue
            turn = from_rpy(triple(shape.find("origin"), "rpy", (0.0, 0.0, 0.0)))
            turned = np.array([rotated(turn, point) for point in points.tolist()])
            at = triple(shape.find("origin"), "xyz", (0.0, 0.0, 0.0))
            found.setdefault(link.get("name", ""), []).append(turned + at)
    return found


def _shape(shape: ET.Element) -> Matrix | None:
    """Surface points of a box, sphere or cylinder around the origin; None for a mesh."""
    if (box := shape.find("geometry/box")) is not None:
        return np.asarray(_cube() * triple(box, "size", (0.0, 0.0, 0.0)) / 2.0)
    if (sphere := shape.find("geometry/sphere")) is not None:
        return _unit_ball() * float(sphere.get("radius", "0"))
    if (cylinder := shape.find("geometry/cylinder")) is not None:
        end = np.array([0.0, 0.0, float(cylinder.get("length", "0"))])
        return _surface(end, float(cylinder.get("radius", "0"))) - end / 2.0
    return None


def _cube() -> Matrix:
    """Surface points of a cube from -1 to 1 along each axis."""
    grid = np.stack(np.meshgrid(*3 * [np.linspace(-1.0, 1.0, 5)]), axis=-1).reshape(-1, 3)
    return np.asarray(grid[np.abs(grid).max(axis=1) == 1.0])


def _unit_ball() -> Matrix:
    return np.asarray(_cube() / np.linalg.norm(_cube(), axis=1, keepdims=True))
