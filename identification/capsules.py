"""Capsules around the links of an arm, fitted to points of each, and the pairs of them that are not
worth guarding, found by sampling poses. Mathematics only."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from common.arrays import Matrix, Vector
from estimator.clearance import Clearance

SAMPLES: Final = 20_000
#: Share of all poses from which on a pair that touches is left out: shapes that touch this often
#: within the limits of a real arm are too coarse there.
ALWAYS, OFTEN = 0.95, 0.2
#: Gap [m] below which a pair must come to be guarded.
NEVER: Final = 0.02
#: Least radius of a capsule [m].
THINNEST: Final = 0.005
#: Two capsules replace one if the radius of the wider is below this share.
THINNER: Final = 0.9
#: Descent to smaller gaps: number of initial poses, of steps, and the first step [rad].
STARTS, STEPS, STEP_RAD = 5, 60, 0.1

Why = Literal["always", "often", "never", "neighbours"]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Capsule: start and end of its segment, each (3,) [m], and radius [m]."""

    start: Vector
    end: Vector
    radius: float

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        length = float(np.linalg.norm(self.end - self.start))
        return float(np.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius))


def fit_capsule(points: Matrix) -> Fit:
    """Capsule of small volume around points (m, 3) [m].

    Along an axis u through c, r is the largest distance from the axis, and each point at a height h
    and a distance d requires a segment that starts at h + sqrt(r^2 - d^2) or lower, and ends at h -
    sqrt( r^2 - d^2) or higher. Axis and c are optimised from each principal axis of the points
    (Nelder-Mead).
    """
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    axes = np.linalg.svd(points - points.mean(axis=0))[2]
    fits = []
    for k in range(3):
        frame = np.roll(axes, -k, axis=0)  # the axis, and two perpendicular ones

        def made(x: Vector, frame: Matrix = frame) -> Fit:
            axis = frame[0] + x[0] * frame[1] + x[1] * frame[2]
            return _about(points, axis, centre + x[2] * frame[1] + x[3] * frame[2])

        size = float(np.ptp(points, axis=0).max()) or THINNEST
        begin = np.zeros((5, 4))
        begin[1:] = np.diag([0.1, 0.1, 0.1 * size, 0.1 * size])
        options = {"initial_simplex": begin, "maxiter": 600, "xatol": 1e-6, "fatol": 1e-10}
        found = minimize(
            lambda x, made=made: made(x).volume, np.zeros(4), method="Nelder-Mead", options=options
        )
        fits.append(made(found.x))
    return min(fits, key=lambda fit: fit.volume)


def _about(points: Matrix, axis: Vector, centre: Vector) -> Fit:
    axis = axis / np.linalg.norm(axis)
    height = (points - centre) @ axis
    square = np.sum((points - centre - np.outer(height, axis)) ** 2, axis=1)
    radius = max(float(np.sqrt(square.max())), THINNEST)
    cap = np.sqrt(np.maximum(radius**2 - square, 0.0))
    low, high = float((height + cap).min()), float((height - cap).max())
    if low > high:
        low = high = 0.5 * (low + high)
    return Fit(centre + low * axis, centre + high * axis, radius)


def corners_of(points: Matrix) -> Matrix:
    """Vertices (m, 3) [m] of the convex hull of points; all points if they are flat."""
    flat = np.linalg.matrix_rank(points - points[0], tol=1e-4) < 3
    corners: Matrix = points if flat else points[ConvexHull(points).vertices]
    return corners


def split(points: Matrix) -> list[Matrix]:
    """Vertices (m, 3) [m] of the convex hull of points, cut in two across the principal axis that
    leaves the thinnest capsules; in one piece if it is flat, or if these are hardly thinner."""
    if np.linalg.matrix_rank(points - points[0], tol=1e-4) < 3:
        return [points]
    hull = ConvexHull(points)
    corners = points[hull.vertices]
    pairs = np.vstack([hull.simplices[:, k] for k in ([0, 1], [1, 2], [2, 0])])
    best, least = [corners], THINNER * fit_capsule(corners).radius
    for axis in np.linalg.svd(corners - corners.mean(axis=0))[2]:
        height = points @ axis
        height = height - 0.5 * (height.min() + height.max())
        a, b = pairs[height[pairs[:, 0]] * height[pairs[:, 1]] < 0.0].T
        share = (height[a] / (height[a] - height[b]))[:, np.newaxis]
        cut, above = points[a] + share * (points[b] - points[a]), height[hull.vertices] >= 0.0
        halves = [np.vstack((corners[side], cut)) for side in (above, ~above)]
        if (wider := max(fit_capsule(half).radius for half in halves)) < least:
            best, least = halves, wider
    return best


@dataclass(frozen=True, slots=True)
class PairGaps:
    """Gaps of one pair over all poses."""

    least: float  # [m]
    touching: float  # share of poses

    def why(self, *, neighbours: bool) -> Why | None:
        """Reason to leave the pair out; None if it is guarded. Two bodies that share a joint
        overlap at it."""
        if self.touching > OFTEN:
            return "always" if self.touching > ALWAYS else "often"
        if self.least > NEVER:
            return "never"
        return "neighbours" if neighbours and self.touching > 0.0 else None


def gaps_over_poses(
    clearance: Clearance, lower: Vector, upper: Vector, margin: float, seed: int = 1
) -> dict[tuple[str, str], PairGaps]:
    """Gaps of each pair of names in SAMPLES random poses within the limits (n,) [rad]; the smallest
    is refined along its gradient."""
    rng, whole, found = np.random.default_rng(seed), np.asarray(clearance.whole), {}
    poses = rng.uniform(lower, upper, (SAMPLES, len(lower)))
    gaps = np.empty((SAMPLES, len(clearance.pairs)))
    for k, q in enumerate(poses):
        clearance.at(q)
        gaps[k] = clearance.least
    for number in np.unique(whole).tolist():
        rows, nearer = np.flatnonzero(whole == number), gaps[:, number]
        least = float(nearer.min())
        if least > 0.0:
            nearest = poses[np.argsort(nearer)[:STARTS]]
            least = min(least, *(_descended(clearance, rows, q, lower, upper) for q in nearest))
        first, second = clearance.pairs[number]
        found[first.name, second.name] = PairGaps(least, float(np.mean(nearer < margin)))
    return found


def _descended(
    clearance: Clearance, rows: NDArray[np.int64], q: Vector, lower: Vector, upper: Vector
) -> float:
    """Smallest gap on a gradient descent from a pose."""
    least, step = np.inf, STEP_RAD
    for _ in range(STEPS):
        clearance.at(q)
        gap = np.asarray(clearance.gap)[rows]
        if (now := float(gap.min())) >= least:
            step *= 0.7
        least = min(least, now)
        slope = np.asarray(clearance.gradient)[rows[int(gap.argmin())]]
        q = np.clip(q - step * slope / max(float(np.linalg.norm(slope)), 1e-9), lower, upper)
    return least
