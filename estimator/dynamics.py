# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Recursive dynamics of a tree of joints: momentum and beta in one pass out and one back, O(n).

Rotating joint i turns all that lies beyond it as one rigid body, in which only the velocity that
comes from before the joint is seen differently: by v_i x S_i for each radian. With H_i, the spatial
momentum of all that lies beyond joint i, and G_i, the gravity on it, both in the frame of i,

    p_i    = S_i . H_i                                                      (M q_dot)_i
    beta_i = (v_i x S_i) . H_i + S_i . G_i         dT/dq_i - g_i = (C^T q_dot - g)_i of (12)

so that neither M nor C is ever made. Ordinary Python, which runs as it is; `dynamics.pxd` names the
types for the compiler, decision 0037.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arrays import Matrix, Vector, product
from elementary import cosine, sine


@dataclass(frozen=True, slots=True)
class Body:
    """A joint, and all that is fixed to what it moves; numbers in SI, in the joint's own frame."""

    parent: int
    """joint before this one, -1 where there is none; never one that comes later"""
    row: int
    """the joint's place in the caller's vectors"""
    rotation: Matrix
    """(3, 3), of the joint at zero in the frame of its parent"""
    translation: Vector
    """(3,), likewise [m]"""
    turning: Vector
    """axis (3,) of a revolute joint, zero of a prismatic one"""
    sliding: Vector
    """axis (3,) of a prismatic joint, zero of a revolute one"""
    mass: float
    moment: Vector
    """mass times centre of mass (3,) [kg m]"""
    inertia: Matrix
    """(3, 3) about the joint's origin [kg m2]"""


class Dynamics:
    """Dynamics of `bodies`, each behind its parent; gravity (3,) [m/s2] in the frame of the root.

    `at` writes to `momentum` [kg m2/s, or kg m/s where a joint slides] and `beta` [Nm or N], both
    (n,), in the caller's order.
    """

    def __init__(self, bodies: Sequence[Body], gravity: Vector) -> None:
        n = len(bodies)
        self.n = n
        self.momentum, self.beta = np.zeros((2, n))
        self._parent = np.array([body.parent for body in bodies], dtype=np.int64)
        self._row = np.array([body.row for body in bodies], dtype=np.int64)
        # R(q) = fixed + sin(q) sine + (1 - cos(q)) versine, Rodrigues' formula behind `rotation`.
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
        # Of all that lies beyond each joint: it does not depend on the pose.
        self._mass, self._beyond = mass, mass.copy()
        self._own = np.column_stack((mass, self._moment, inertia.reshape(n, 9)))
        # Of each joint in its own frame; row n is the root's, which stands.
        self._R = np.zeros((n, 3, 3))
        self._t = np.zeros((n, 3))
        standing = np.zeros((3, n + 1, 3))
        standing[2, n] = gravity
        self._v, self._w, self._g = standing
        # Momentum, angular momentum and first moment of mass of all that lies beyond the joint.
        self._L, self._K, self._c = np.zeros((3, n, 3))
        self._load = np.zeros(3)  # where the mass is that `carry` puts on
        self.carry(n - 1, 0.0, 0.0, 0.0, 0.0)

    def carry(self, i: int, mass: float, x: float, y: float, z: float) -> None:
        """Let joint i carry a point mass [kg] at x, y, z [m] of its frame, in place of what it
        carried before; 0 is nothing."""
        own, J, c = self._own[i], self._inertia[i], self._load
        c[0], c[1], c[2] = x, y, z
        square = x * x + y * y + z * z
        for a in range(3):
            self._moment[i, a] = own[1 + a] + mass * c[a]
            for b in range(3):
                J[a, b] = own[4 + 3 * a + b] - mass * c[a] * c[b]
            J[a, a] += mass * square
        self._mass[i] = own[0] + mass
        # Anew, so that what is carried leaves no rounding behind.
        for k in range(self.n):
            self._beyond[k] = self._mass[k]
        for k in range(self.n - 1, -1, -1):
            if self._parent[k] >= 0:
                self._beyond[self._parent[k]] += self._beyond[k]

    def at(self, q: Vector, q_dot: Vector) -> None:
        """Dynamics at q and q_dot, both (n,) [rad or m, /s]."""
        for i in range(self.n):
            self._outward(i, q[self._row[i]], q_dot[self._row[i]])
        for i in range(self.n - 1, -1, -1):
            self._inward(i)

    def _outward(self, i: int, q: float, q_dot: float) -> None:
        """Pose and velocity of joint i from those of its parent, and its own body's momentum."""
        R, t, v, w, g = self._R[i], self._t[i], self._v[i], self._w[i], self._g[i]
        parent = self._parent[i] if self._parent[i] >= 0 else self.n
        v0, w0, g0 = self._v[parent], self._w[parent], self._g[parent]
        s, versine = sine(q), 1.0 - cosine(q)
        for a in range(3):
            t[a] = self._offset[i, a] + q * self._slide[i, a]
            for b in range(3):
                R[a, b] = (
                    self._fixed[i, a, b]
                    + s * self._sine[i, a, b]
                    + versine * self._versine[i, a, b]
                )
        # Velocity of the parent's body where this joint is.
        x = v0[0] + w0[1] * t[2] - w0[2] * t[1]
        y = v0[1] + w0[2] * t[0] - w0[0] * t[2]
        z = v0[2] + w0[0] * t[1] - w0[1] * t[0]
        for a in range(3):
            v[a] = R[0, a] * x + R[1, a] * y + R[2, a] * z + q_dot * self._sliding[i, a]
            w[a] = R[0, a] * w0[0] + R[1, a] * w0[1] + R[2, a] * w0[2] + q_dot * self._turning[i, a]
            g[a] = R[0, a] * g0[0] + R[1, a] * g0[1] + R[2, a] * g0[2]
        L, K, c, m, J = self._L[i], self._K[i], self._moment[i], self._mass[i], self._inertia[i]
        L[0] = m * v[0] + w[1] * c[2] - w[2] * c[1]
        L[1] = m * v[1] + w[2] * c[0] - w[0] * c[2]
        L[2] = m * v[2] + w[0] * c[1] - w[1] * c[0]
        K[0] = J[0, 0] * w[0] + J[0, 1] * w[1] + J[0, 2] * w[2] + c[1] * v[2] - c[2] * v[1]
        K[1] = J[1, 0] * w[0] + J[1, 1] * w[1] + J[1, 2] * w[2] + c[2] * v[0] - c[0] * v[2]
        K[2] = J[2, 0] * w[0] + J[2, 1] * w[1] + J[2, 2] * w[2] + c[0] * v[1] - c[1] * v[0]
        for a in range(3):
            self._c[i, a] = c[a]

    def _inward(self, i: int) -> None:
        """p_i and beta_i, once all beyond joint i was added to it; then add it to its parent."""
        R, t, v, w, g = self._R[i], self._t[i], self._v[i], self._w[i], self._g[i]
        L, K, c, m = self._L[i], self._K[i], self._c[i], self._beyond[i]
        S, T = self._sliding[i], self._turning[i]
        row = self._row[i]
        p, beta = 0.0, 0.0
        for a in range(3):
            b, d = (a + 1) % 3, (a + 2) % 3
            p += S[a] * L[a] + T[a] * K[a]
            # v_i x S_i, linear and angular, and gravity on all beyond.
            beta += (w[b] * S[d] - w[d] * S[b] + v[b] * T[d] - v[d] * T[b]) * L[a]
            beta += (w[b] * T[d] - w[d] * T[b]) * K[a]
            beta += S[a] * m * g[a] + T[a] * (c[b] * g[d] - c[d] * g[b])
        self.momentum[row], self.beta[row] = p, beta
        if self._parent[i] < 0:
            return
        L0, K0, c0 = self._L[self._parent[i]], self._K[self._parent[i]], self._c[self._parent[i]]
        x = R[0, 0] * L[0] + R[0, 1] * L[1] + R[0, 2] * L[2]
        y = R[1, 0] * L[0] + R[1, 1] * L[1] + R[1, 2] * L[2]
        z = R[2, 0] * L[0] + R[2, 1] * L[1] + R[2, 2] * L[2]
        L0[0] += x
        L0[1] += y
        L0[2] += z
        K0[0] += t[1] * z - t[2] * y
        K0[1] += t[2] * x - t[0] * z
        K0[2] += t[0] * y - t[1] * x
        for a in range(3):
            K0[a] += R[a, 0] * K[0] + R[a, 1] * K[1] + R[a, 2] * K[2]
            c0[a] += R[a, 0] * c[0] + R[a, 1] * c[1] + R[a, 2] * c[2] + m * t[a]
