# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Recursive dynamics of a tree of joints: momentum and beta in one outward and one inward pass,
O(n).

A revolute joint i turns everything beyond it as one rigid body, in which only the velocity that
comes from before the joint changes: by v_i x S_i per radian. With H_i, the spatial momentum of
everything beyond joint i, and G_i, the gravity on it, both in the frame of i,

    p_i    = S_i . H_i                                                      (M q_dot)_i
    beta_i = (v_i x S_i) . H_i + S_i . G_i         dT/dq_i - g_i = (C^T q_dot - g)_i of (12)

so that neither M nor C is ever formed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.arrays import Matrix, Vector, product
from common.elementary import cosine, sine


@dataclass(frozen=True, slots=True)
class Body:
    """A joint, and everything fixed to what it moves; SI units, in the joint's own frame."""

    parent: int
    """index of the joint before this one, -1 for none; always below its own"""
    row: int
    """index of the joint in the caller's vectors"""
    rotation: Matrix
    """(3, 3), of the joint frame at zero in the frame of its parent"""
    translation: Vector
    """(3,), origin likewise [m]"""
    turning: Vector
    """axis (3,) of a revolute joint, zero for a prismatic one"""
    sliding: Vector
    """axis (3,) of a prismatic joint, zero for a revolute one"""
    mass: float
    moment: Vector
    """mass times centre of mass (3,) [kg m]"""
    inertia: Matrix
    """(3, 3) about the joint's origin [kg m2]"""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Point of the arm, and axes there, in the frame of the body that carries both."""

    body: int
    """index among the bodies of `Dynamics`"""
    point: Vector
    """(3,) [m]"""
    axes: Matrix
    """(3, 3): axes of the frame, in columns"""


class Dynamics:
    """Dynamics of `bodies`, each listed after its parent; gravity (3,) [m/s2] in the root frame.

    `at` writes `momentum` [kg m2/s, or kg m/s for a prismatic joint] and `beta` [Nm or N], both
    (n,), in the caller's order.
    """

    def __init__(self, bodies: Sequence[Body], gravity: Vector) -> None:
        n = len(bodies)
        self.n = n
        self.momentum, self.beta = np.zeros((2, n))
        self._parent = np.array([body.parent for body in bodies], dtype=np.int64)
        self._row = np.array([body.row for body in bodies], dtype=np.int64)
        # R(q) = fixed + sin(q) sine + (1 - cos(q)) versine: `rotation` times Rodrigues' formula.
        rotation = np.array([body.rotation for body in bodies])
        cross = np.array([np.cross(body.turning, np.eye(3)).T for body in bodies])
        turned = product(rotation, cross)
        self._fixed, self._sine, self._versine = rotation, turned, product(turned, cross)
        self._offset = np.array([body.translation for body in bodies])
        self._slide = np.array(
            [product(b.rotation, b.sliding[:, np.newaxis])[:, 0] for b in bodies]
        )
        self._turning = np.array([body.turning for body in bodies])
        self._sliding = np.array([body.sliding for body in bodies])
        mass = np.array([body.mass for body in bodies])
        self._moment = np.array([body.moment for body in bodies])
        inertia = np.array([body.inertia for body in bodies])
        self._inertia = inertia
        # Mass of each body, and of everything beyond each joint, which does not depend on the pose.
        self._mass, self._beyond = mass, mass.copy()
        self._own = np.column_stack((mass, self._moment, inertia.reshape(n, 9)))
        # Per joint, in its own frame; row n is the root, which is at rest.
        self._R = np.zeros((n, 3, 3))
        self._t = np.zeros((n, 3))
        standing = np.zeros((3, n + 1, 3))
        standing[2, n] = gravity
        self._v, self._w, self._g = standing
        # Linear and angular momentum, and first moment of mass, of everything beyond the joint.
        self._L, self._K, self._c = np.zeros((3, n, 3))
        self._load = np.zeros(3)  # position of the mass that `carry` adds
        self.carry(n - 1, 0.0, 0.0, 0.0, 0.0)

    def carry(self, i: int, mass: float, x: float, y: float, z: float) -> None:
        """Let joint i carry only this point mass [kg] at x, y, z [m] in its frame; 0 carries
        nothing."""
        own, J, c = self._own[i], self._inertia[i], self._load
        c[0], c[1], c[2] = x, y, z
        square = x * x + y * y + z * z
        for a in range(3):
            self._moment[i, a] = own[1 + a] + mass * c[a]
            for b in range(3):
                J[a, b] = own[4 + 3 * a + b] - mass * c[a] * c[b]
            J[a, a] += mass * square
        self._mass[i] = own[0] + mass
        # Recomputed, so that adding and removing a mass leaves no rounding error.
        for k in range(self.n):
            self._beyond[k] = self._mass[k]
        for k in range(self.n - 1, -1, -1):
            if self._parent[k] >= 0:
                self._beyond[self._parent[k]] += self._beyond[k]

    def at(self, q: Vector, q_dot: Vector) -> None:
        """Compute momentum and beta at q and q_dot, both (n,) [rad or m, /s]."""
        for i in range(self.n):
            self._outward(i, q[self._row[i]], q_dot[self._row[i]])
        for i in range(self.n - 1, -1, -1):
            self._inward(i)

    def _outward(self, i: int, q: float, q_dot: float) -> None:
        """Pose and velocity of joint i from those of its parent, and momentum of its own body."""
        parent = self._parent[i] if self._parent[i] >= 0 else self.n
        s, versine = sine(q), 1.0 - cosine(q)
        for a in range(3):
            self._t[i, a] = self._offset[i, a] + q * self._slide[i, a]
            for b in range(3):
                self._R[i, a, b] = (
                    self._fixed[i, a, b]
                    + s * self._sine[i, a, b]
                    + versine * self._versine[i, a, b]
                )
        # Velocity of the parent's body at the origin of this joint.
        t0, t1, t2 = self._t[i, 0], self._t[i, 1], self._t[i, 2]
        w0, w1, w2 = self._w[parent, 0], self._w[parent, 1], self._w[parent, 2]
        g0, g1, g2 = self._g[parent, 0], self._g[parent, 1], self._g[parent, 2]
        x = self._v[parent, 0] + w1 * t2 - w2 * t1
        y = self._v[parent, 1] + w2 * t0 - w0 * t2
        z = self._v[parent, 2] + w0 * t1 - w1 * t0
        for a in range(3):
            R0, R1, R2 = self._R[i, 0, a], self._R[i, 1, a], self._R[i, 2, a]
            self._v[i, a] = R0 * x + R1 * y + R2 * z + q_dot * self._sliding[i, a]
            self._w[i, a] = R0 * w0 + R1 * w1 + R2 * w2 + q_dot * self._turning[i, a]
            self._g[i, a] = R0 * g0 + R1 * g1 + R2 * g2
        m = self._mass[i]
        v0, v1, v2 = self._v[i, 0], self._v[i, 1], self._v[i, 2]
        w0, w1, w2 = self._w[i, 0], self._w[i, 1], self._w[i, 2]
        c0, c1, c2 = self._moment[i, 0], self._moment[i, 1], self._moment[i, 2]
        self._L[i, 0] = m * v0 + w1 * c2 - w2 * c1
        self._L[i, 1] = m * v1 + w2 * c0 - w0 * c2
        self._L[i, 2] = m * v2 + w0 * c1 - w1 * c0
        for a in range(3):
            J0, J1, J2 = self._inertia[i, a, 0], self._inertia[i, a, 1], self._inertia[i, a, 2]
            self._K[i, a] = J0 * w0 + J1 * w1 + J2 * w2
            self._c[i, a] = self._moment[i, a]
        self._K[i, 0] = self._K[i, 0] + c1 * v2 - c2 * v1
        self._K[i, 1] = self._K[i, 1] + c2 * v0 - c0 * v2
        self._K[i, 2] = self._K[i, 2] + c0 * v1 - c1 * v0

    def _inward(self, i: int) -> None:
        """Compute p_i and beta_i once everything beyond joint i is added to it; add it to its
        parent."""
        m, row, parent = self._beyond[i], self._row[i], self._parent[i]
        p, beta = 0.0, 0.0
        for a in range(3):
            b, d = (a + 1) % 3, (a + 2) % 3
            L, K = self._L[i, a], self._K[i, a]
            S, T = self._sliding[i, a], self._turning[i, a]
            w_b, w_d = self._w[i, b], self._w[i, d]
            S_b, S_d = self._sliding[i, b], self._sliding[i, d]
            T_b, T_d = self._turning[i, b], self._turning[i, d]
            p += S * L + T * K
            # v_i x S_i, linear and angular, and gravity on everything beyond.
            beta += (w_b * S_d - w_d * S_b + self._v[i, b] * T_d - self._v[i, d] * T_b) * L
            beta += (w_b * T_d - w_d * T_b) * K
            beta += S * m * self._g[i, a] + T * (
                self._c[i, b] * self._g[i, d] - self._c[i, d] * self._g[i, b]
            )
        self.momentum[row], self.beta[row] = p, beta
        if parent < 0:
            return
        L0, L1, L2 = self._L[i, 0], self._L[i, 1], self._L[i, 2]
        K0, K1, K2 = self._K[i, 0], self._K[i, 1], self._K[i, 2]
        c0, c1, c2 = self._c[i, 0], self._c[i, 1], self._c[i, 2]
        t0, t1, t2 = self._t[i, 0], self._t[i, 1], self._t[i, 2]
        x = self._R[i, 0, 0] * L0 + self._R[i, 0, 1] * L1 + self._R[i, 0, 2] * L2
        y = self._R[i, 1, 0] * L0 + self._R[i, 1, 1] * L1 + self._R[i, 1, 2] * L2
        z = self._R[i, 2, 0] * L0 + self._R[i, 2, 1] * L1 + self._R[i, 2, 2] * L2
        self._L[parent, 0] += x
        self._L[parent, 1] += y
        self._L[parent, 2] += z
        self._K[parent, 0] += t1 * z - t2 * y
        self._K[parent, 1] += t2 * x - t0 * z
        self._K[parent, 2] += t0 * y - t1 * x
        for a in range(3):
            R0, R1, R2 = self._R[i, a, 0], self._R[i, a, 1], self._R[i, a, 2]
            self._K[parent, a] += R0 * K0 + R1 * K1 + R2 * K2
            self._c[parent, a] += R0 * c0 + R1 * c1 + R2 * c2 + m * self._t[i, a]
