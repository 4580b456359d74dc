# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Clearance: gaps between the arm's links, and between links and surroundings, with their
gradients.

A link is a capsule: everything within a radius of a segment. The surroundings are planes and boxes.
The gap between a point x of a segment and its nearest point y on another shape, with the normal n
there, is

    d = n . (x - y) - radii,    d d / d q_j = n . (w_j x (x - p_j))  for each joint j that moves x,

minus the same term at y for each joint that moves y. It is negative inside. The smallest gap of a
pair is not enough: between parallel segments its points jump from one end to the other. So each
pair has a row for the nearest points, and one for each end: a fixed number, without allocations.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from common.arrays import Vector, product
from common.elementary import cosine, sine
from estimator.dynamics import Body
from estimator.shapes import Box, Capsule, Plane

_CAPSULE, _PLANE, _BOX = 0, 1, 2
_ROWS = (5, 2, 3)
_HALVINGS = 30  # bisections of a segment beside a box: to a thousandth of a micrometre
_BESIDE = 1e-8  # step along a segment for one-sided slopes, as a share of it
_TINY = 1e-12


class Clearance:
    """Gaps of pairs of shapes; the first shape of each pair is a capsule.

    `at` writes `gap` (rows,) [m] and `gradient` (rows, n) [m/rad]. The rows of a pair are
    contiguous, and `pair` (rows,) is its index; the smallest of them is the gap of the pair. Pairs
    with the same names count as one: `whole` (rows,) is the index of the first of them, where
    `least` (pairs,) [m] holds their common gap.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        capsules: Sequence[Capsule],
        pairs: Sequence[tuple[Capsule, Capsule | Plane | Box]],
    ) -> None:
        n, m = len(bodies), len(capsules)
        self.n = n
        self.pairs = tuple(pairs)
        self._parent = np.array([body.parent for body in bodies], dtype=np.int64)
        self._row = np.array([body.row for body in bodies], dtype=np.int64)
        rotation = np.array([body.rotation for body in bodies])
        cross = np.array([np.cross(body.turning, np.eye(3)).T for body in bodies])
        turned = product(rotation, cross)
        self._fixed, self._sine, self._versine = rotation, turned, product(turned, cross)
        self._offset = np.array([body.translation for body in bodies])
        self._turning = np.array([body.turning for body in bodies])
        self._sliding = np.array([body.sliding for body in bodies])
        # In the root frame: rotation and origin of each joint, row n for the root itself, and axes.
        self._R, self._p = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
        for a in range(3):
            self._R[n, a, a] = 1.0
        self._w, self._s = np.zeros((2, n, 3))
        self._body = np.array([one.body for one in capsules], dtype=np.int64)
        ends = [np.array([one.start, one.end - one.start]) for one in capsules]
        self._local = np.array(ends).reshape(m, 2, 3)
        self._radius = np.array([one.radius for one in capsules])
        self._segment = np.zeros((m, 2, 3))  # start, and vector to the end
        planes = [other for _, other in pairs if isinstance(other, Plane)]
        boxes = [other for _, other in pairs if isinstance(other, Box)]
        self._plane = np.array([[*one.normal, one.offset] for one in planes]).reshape(-1, 4)
        self._axes = np.array([one.axes for one in boxes]).reshape(-1, 3, 3)
        self._centre = np.array([one.centre for one in boxes]).reshape(-1, 3)
        self._half = np.array([one.half for one in boxes]).reshape(-1, 3)
        known = {id(one): k for of in (capsules, planes, boxes) for k, one in enumerate(of)}
        kinds = [(Capsule, Plane, Box).index(type(other)) for _, other in pairs]
        self._kind = np.array(kinds, dtype=np.int64)
        self._first = np.array([known[id(one)] for one, _ in pairs], dtype=np.int64)
        self._second = np.array([known[id(other)] for _, other in pairs], dtype=np.int64)
        self.pair = np.repeat(np.arange(len(pairs)), [_ROWS[kind] for kind in kinds])
        names = [frozenset((one.name, other.name)) for one, other in pairs]
        self.whole = np.array([names.index(names[k]) for k in self.pair], dtype=np.int64)
        self.gap, self.least = np.zeros(len(self.pair)), np.zeros(len(pairs))
        self.gradient = np.zeros((len(self.pair), n))
        self._x, self._y, self._normal, self._lower = np.zeros((4, 3))

    def at(self, q: Vector) -> None:
        """Compute gaps and gradients at q (n,) [rad, or m for a prismatic joint]."""
        for i in range(self.n):
            self._outward(i, q[self._row[i]])
        for k in range(self._body.shape[0]):
            self._place(k)
        row = 0
        for k in range(self._kind.shape[0]):
            if self._kind[k] == _CAPSULE:
                row = self._beside_capsule(row, self._first[k], self._second[k])
            elif self._kind[k] == _PLANE:
                row = self._beside_plane(row, self._first[k], self._second[k])
            else:
                row = self._beside_box(row, self._first[k], self._second[k])
        for k in range(self.least.shape[0]):
            self.least[k] = 1e300
        for row in range(self.gap.shape[0]):
            k = self.whole[row]
            self.least[k] = min(self.least[k], self.gap[row])

    def _outward(self, i: int, q: float) -> None:
        """Pose of joint i in the root frame, from that of its parent."""
        parent = self._parent[i] if self._parent[i] >= 0 else self.n
        s, versine = sine(q), 1.0 - cosine(q)
        R, own = self._R, self._x
        for a in range(3):
            own[a] = self._offset[i, a]
            for b in range(3):
                own[a] += q * self._fixed[i, a, b] * self._sliding[i, b]
        for a in range(3):
            self._p[i, a] = self._p[parent, a]
            for b in range(3):
                self._p[i, a] += R[parent, a, b] * own[b]
                R[i, a, b] = 0.0
                for c in range(3):
                    turned = self._fixed[i, c, b] + s * self._sine[i, c, b]
                    R[i, a, b] += R[parent, a, c] * (turned + versine * self._versine[i, c, b])
        for a in range(3):
            self._w[i, a] = self._s[i, a] = 0.0
            for b in range(3):
                self._w[i, a] += R[i, a, b] * self._turning[i, b]
                self._s[i, a] += R[i, a, b] * self._sliding[i, b]

    def _place(self, k: int) -> None:
        """Segment of capsule k in the root frame."""
        i = self._body[k] if self._body[k] >= 0 else self.n
        for a in range(3):
            self._segment[k, 0, a] = self._p[i, a]
            self._segment[k, 1, a] = 0.0
            for b in range(3):
                self._segment[k, 0, a] += self._R[i, a, b] * self._local[k, 0, b]
                self._segment[k, 1, a] += self._R[i, a, b] * self._local[k, 1, b]

    def _beside_plane(self, row: int, k: int, m: int) -> int:
        for a in range(3):
            self._normal[a] = self._plane[m, a]
        for end in range(2):
            height = -self._plane[m, 3]
            for a in range(3):
                self._x[a] = self._segment[k, 0, a] + end * self._segment[k, 1, a]
                height += self._normal[a] * self._x[a]
            self.gap[row] = height - self._radius[k]
            self._differentiate(row, k, -1)
            row += 1
        return row

    def _beside_box(self, row: int, k: int, m: int) -> int:
        t = self._nearest_to_box(k, m)
        for end in range(3):
            distance = self._from_box(k, m, t if end == 0 else end - 1.0)
            if end == 0 and distance < 0.0 and 0.0 < t < 1.0:
                self._lean(k, m, t)
            self.gap[row] = distance - self._radius[k]
            self._differentiate(row, k, -1)
            row += 1
        return row

    def _nearest_to_box(self, k: int, m: int) -> float:
        """Position along segment k, 0 to 1, that is nearest to box m, by bisection: the distance is
        convex along the segment, so its slope changes sign once."""
        if self._slope(k, m, 0.0) >= 0.0:
            return 0.0
        if self._slope(k, m, 1.0) <= 0.0:
            return 1.0
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self._slope(k, m, middle) < 0.0:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)

    def _lean(self, k: int, m: int, t: float) -> None:
        """Set the normal at the deepest point in a box, which may be equally far from two faces:
        the mean of both normals that is perpendicular to the segment; zero between opposite
        faces."""
        low, lean = self._slope(k, m, t - _BESIDE), self._lower
        for a in range(3):
            lean[a] = self._normal[a]
        high = self._slope(k, m, t + _BESIDE)
        for a in range(3):
            if low < 0.0 < high:
                self._normal[a] = (high * lean[a] - low * self._normal[a]) / (high - low)
            self._x[a] = self._segment[k, 0, a] + t * self._segment[k, 1, a]

    def _slope(self, k: int, m: int, t: float) -> float:
        """Slope of the distance along the segment at the position t, 0 to 1."""
        self._from_box(k, m, t)
        slope = 0.0
        for a in range(3):
            slope += self._normal[a] * self._segment[k, 1, a]
        return slope

    def _from_box(self, k: int, m: int, t: float) -> float:
        """Distance of a point of the segment from a box, and its normal; inside, to the next
        face."""
        y, normal, outside, deepest, face = self._y, self._normal, 0.0, -1e300, 0
        for a in range(3):
            self._x[a] = self._segment[k, 0, a] + t * self._segment[k, 1, a]
        for b in range(3):
            along = 0.0
            for a in range(3):
                along += self._axes[m, a, b] * (self._x[a] - self._centre[m, a])
            beyond = abs(along) - self._half[m, b]
            if beyond > deepest:
                deepest, face = beyond, b
            y[b] = max(beyond, 0.0) if along >= 0.0 else -max(beyond, 0.0)
            outside += y[b] * y[b]
            normal[b] = 1.0 if along >= 0.0 else -1.0  # for now: which side
        distance = sqrt(outside) if outside > _TINY * _TINY else deepest
        for b in range(3):
            if outside > _TINY * _TINY:
                y[b] = y[b] / distance
            else:
                y[b] = normal[b] if b == face else 0.0
        for a in range(3):
            normal[a] = 0.0
            for b in range(3):
                normal[a] += self._axes[m, a, b] * y[b]
        return distance

    def _beside_capsule(self, row: int, k: int, m: int) -> int:
        t = self._nearest_to_line(k, m)
        self._between(row, k, m, t, self._foot(m, k, t))
        for end in range(2):
            self._between(row + 1 + end, k, m, end, self._foot(m, k, end))
            self._between(row + 3 + end, k, m, self._foot(k, m, end), end)
        return row + 5

    def _nearest_to_line(self, k: int, m: int) -> float:
        """Position along segment k, 0 to 1, nearest to the line through segment m. If the foot lies
        beyond an end of m, the row of that end has the gap."""
        A, B, aa, ab, bb, ar, br = self._segment[k], self._segment[m], 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            apart = A[0, i] - B[0, i]
            aa += A[1, i] * A[1, i]
            ab += A[1, i] * B[1, i]
            bb += B[1, i] * B[1, i]
            ar += A[1, i] * apart
            br += B[1, i] * apart
        square = aa * bb - ab * ab
        return min(max((ab * br - bb * ar) / square, 0.0), 1.0) if square > _TINY * aa * bb else 0.5

    def _foot(self, k: int, m: int, u: float) -> float:
        """Position along segment k, 0 to 1, nearest to the point at the position u of segment m."""
        A, B, along, square = self._segment[k], self._segment[m], 0.0, 0.0
        for i in range(3):
            along += A[1, i] * (B[0, i] + u * B[1, i] - A[0, i])
            square += A[1, i] * A[1, i]
        return min(max(along / square, 0.0), 1.0) if square > _TINY else 0.0

    def _between(self, row: int, k: int, m: int, t: float, u: float) -> None:
        """Compute the row of one point of capsule k and one of capsule m. Where the points
        coincide, the normal is the z axis."""
        x, y, normal, square = self._x, self._y, self._normal, 0.0
        for a in range(3):
            x[a] = self._segment[k, 0, a] + t * self._segment[k, 1, a]
            y[a] = self._segment[m, 0, a] + u * self._segment[m, 1, a]
            normal[a] = x[a] - y[a]
            square += normal[a] * normal[a]
        distance = sqrt(square)
        for a in range(3):
            normal[a] = normal[a] / distance if distance > _TINY else (1.0 if a == 2 else 0.0)
        self.gap[row] = distance - self._radius[k] - self._radius[m]
        self._differentiate(row, k, m)

    def _differentiate(self, row: int, k: int, m: int) -> None:
        """Gradient of a row along the normal, from the point x of capsule k and, unless m is -1,
        the point y of capsule m."""
        for j in range(self.n):
            self.gradient[row, j] = 0.0
        self._add(row, self._body[k], self._x, 1.0)
        if m >= 0:
            self._add(row, self._body[m], self._y, -1.0)

    def _add(self, row: int, i: int, x: Vector, sign: float) -> None:
        w, s, p, normal = self._w, self._s, self._p, self._normal
        while i >= 0:
            r0, r1, r2 = x[0] - p[i, 0], x[1] - p[i, 1], x[2] - p[i, 2]
            v0 = w[i, 1] * r2 - w[i, 2] * r1 + s[i, 0]
            v1 = w[i, 2] * r0 - w[i, 0] * r2 + s[i, 1]
            v2 = w[i, 0] * r1 - w[i, 1] * r0 + s[i, 2]
            change = normal[0] * v0 + normal[1] * v1 + normal[2] * v2
            self.gradient[row, self._row[i]] += sign * change
            i = self._parent[i]
