# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Forward dynamics of a tree of links, in world coordinates: mass matrix by composite rigid bodies,
bias by Newton-Euler, and a sparse solution along the branches of the tree.

    M(q) q_dotdot + c(q, q_dot) = tau

Forces, momenta and inertias are taken about the world's origin, where those of all bodies carried
by a joint simply add up. Nothing here is shared with the estimator, which works in joint frames and
never forms M, so that an error in one is not hidden by the other. Ordinary Python that also runs
uncompiled; `links.pxd` declares the C types (decision 0037).
"""

import numpy as np
import pinocchio as pin

from common.arrays import Matrix, Vector, product
from common.elementary import cosine, sine


class Links:
    """Links of a pinocchio model with single-axis revolute or prismatic joints, parents first.
    `gravity` (3,) [m/s^2], in world coordinates, is writable."""

    def __init__(self, model: pin.Model) -> None:
        n = self.n = model.nv
        self.gravity = np.array(model.gravity.linear)
        self._parent = np.array([model.parents[i + 1] - 1 for i in range(n)], dtype=np.int64)
        subspaces = []
        for joint in list(model.joints)[1:]:
            data = joint.createData()
            joint.calc(data, np.zeros(model.nq), np.zeros(n))
            subspaces.append(np.asarray(data.S).ravel())
        axes = np.array(subspaces)  # linear, angular
        self._sliding, self._turning = axes[:, :3].copy(), axes[:, 3:].copy()
        self._slides = np.any(axes[:, :3] != 0.0, axis=1).astype(np.int64)
        # Rotation relative to the parent, by Rodrigues: placement (1 + sin(q) [a] +
        # (1 - cos(q)) [a]^2).
        placement = np.array([model.jointPlacements[i + 1].rotation for i in range(n)])
        cross = np.array([np.cross(axis, np.eye(3)).T for axis in axes[:, 3:]])
        turned = product(placement, cross)
        self._fixed, self._sine, self._versine = placement, turned, product(turned, cross)
        self._offset = np.array([model.jointPlacements[i + 1].translation for i in range(n)])
        bodies = [model.inertias[i + 1] for i in range(n)]
        self._mass = np.array([body.mass for body in bodies])
        self._lever = np.array([body.lever for body in bodies])
        self._inertia = np.array([body.inertia for body in bodies])
        # In world coordinates; row n is the fixed world. Per joint: rotation; position, axis and
        # velocity at the origin for q_dot = 1; angular velocity and bias accelerations.
        self._R = np.repeat([np.eye(3)], n + 1, axis=0)
        self._p, self._z, self._s = np.zeros((3, n + 1, 3))
        self._w, self._wd, self._a = np.zeros((3, n + 1, 3))
        # Of all bodies that a joint carries, about the origin: bias force and moment, mass, first
        # and second moments of mass (xx, xy, xz, yy, yz, zz).
        self._F, self._N, self._h = np.zeros((3, n + 1, 3))
        self._m, self._J = np.zeros(n + 1), np.zeros((n + 1, 6))
        self._M, self._bias = np.zeros((n, n)), np.zeros(n)
        self._turned = np.zeros((3, 3))

    def load(self, i: int, mass: float, lever: Vector, inertia: Matrix) -> None:
        """Replace the body of joint i: mass [kg], centre of mass (3,) [m] in the joint frame, and
        inertia about it (3, 3) [kg m2]."""
        self._mass[i] = mass
        for row in range(3):
            self._lever[i, row] = lever[row]
            for c in range(3):
                self._inertia[i, row, c] = inertia[row, c]

    def accelerate(self, q: Vector, q_dot: Vector, tau: Vector, out: Vector) -> None:
        """Write the accelerations (n,) for q, q_dot and joint torques tau, (n,) each, to `out`,
        which may be `tau`."""
        self._a[self.n, 0] = -self.gravity[0]
        self._a[self.n, 1] = -self.gravity[1]
        self._a[self.n, 2] = -self.gravity[2]
        for i in range(self.n):
            self._pose(i, q[i], q_dot[i])
            self._body(i)
        for i in range(self.n - 1, -1, -1):
            self._carry(i)
        for i in range(self.n):
            out[i] = tau[i] - self._bias[i]
        self._solve(out)

    def _pose(self, i: int, q: float, q_dot: float) -> None:
        """Compute rotation, position, axis and bias acceleration of joint i from its parent's."""
        k = self._parent[i] if self._parent[i] >= 0 else self.n
        sin, versine = sine(q), 1.0 - cosine(q)
        for row in range(3):
            for c in range(3):
                self._turned[row, c] = (
                    self._fixed[i, row, c]
                    + sin * self._sine[i, row, c]
                    + versine * self._versine[i, row, c]
                )
        for row in range(3):
            x, y, u = self._R[k, row, 0], self._R[k, row, 1], self._R[k, row, 2]
            for c in range(3):
                self._R[i, row, c] = (
                    x * self._turned[0, c] + y * self._turned[1, c] + u * self._turned[2, c]
                )
        for row in range(3):
            x, y, u = self._R[k, row, 0], self._R[k, row, 1], self._R[k, row, 2]
            away = x * self._offset[i, 0] + y * self._offset[i, 1] + u * self._offset[i, 2]
            x, y, u = self._R[i, row, 0], self._R[i, row, 1], self._R[i, row, 2]
            self._z[i, row] = (
                x * self._turning[i, 0] + y * self._turning[i, 1] + u * self._turning[i, 2]
            )
            self._s[i, row] = 0.0
            if self._slides[i]:
                self._s[i, row] = (
                    x * self._sliding[i, 0] + y * self._sliding[i, 1] + u * self._sliding[i, 2]
                )
            self._p[i, row] = self._p[k, row] + away + q * self._s[i, row]
        # Acceleration of the parent's body at this point, with the Coriolis term of sliding.
        dx, dy, dz = (
            self._p[i, 0] - self._p[k, 0],
            self._p[i, 1] - self._p[k, 1],
            self._p[i, 2] - self._p[k, 2],
        )
        wx, wy, wz = self._w[k, 0], self._w[k, 1], self._w[k, 2]
        slip = 2.0 * q_dot
        vx, vy, vz = (
            wy * dz - wz * dy + slip * self._s[i, 0],
            wz * dx - wx * dz + slip * self._s[i, 1],
            wx * dy - wy * dx + slip * self._s[i, 2],
        )
        self._a[i, 0] = (
            self._a[k, 0] + self._wd[k, 1] * dz - self._wd[k, 2] * dy + wy * vz - wz * vy
        )
        self._a[i, 1] = (
            self._a[k, 1] + self._wd[k, 2] * dx - self._wd[k, 0] * dz + wz * vx - wx * vz
        )
        self._a[i, 2] = (
            self._a[k, 2] + self._wd[k, 0] * dy - self._wd[k, 1] * dx + wx * vy - wy * vx
        )
        zx, zy, zz = self._z[i, 0], self._z[i, 1], self._z[i, 2]
        self._wd[i, 0] = self._wd[k, 0] + q_dot * (wy * zz - wz * zy)
        self._wd[i, 1] = self._wd[k, 1] + q_dot * (wz * zx - wx * zz)
        self._wd[i, 2] = self._wd[k, 2] + q_dot * (wx * zy - wy * zx)
        self._w[i, 0], self._w[i, 1], self._w[i, 2] = (
            wx + q_dot * zx,
            wy + q_dot * zy,
            wz + q_dot * zz,
        )
        self._s[i, 0] += self._p[i, 1] * zz - self._p[i, 2] * zy
        self._s[i, 1] += self._p[i, 2] * zx - self._p[i, 0] * zz
        self._s[i, 2] += self._p[i, 0] * zy - self._p[i, 1] * zx

    def _body(self, i: int) -> None:
        """Compute inertia and bias force of the body of joint i alone, about the origin."""
        m = self._mass[i]
        R00, R01, R02 = self._R[i, 0, 0], self._R[i, 0, 1], self._R[i, 0, 2]
        R10, R11, R12 = self._R[i, 1, 0], self._R[i, 1, 1], self._R[i, 1, 2]
        R20, R21, R22 = self._R[i, 2, 0], self._R[i, 2, 1], self._R[i, 2, 2]
        J00, J01, J02 = self._inertia[i, 0, 0], self._inertia[i, 0, 1], self._inertia[i, 0, 2]
        J11, J12, J22 = self._inertia[i, 1, 1], self._inertia[i, 1, 2], self._inertia[i, 2, 2]
        # R J R^T, which is symmetric, too.
        x = R00 * J00 + R01 * J01 + R02 * J02
        y = R00 * J01 + R01 * J11 + R02 * J12
        z = R00 * J02 + R01 * J12 + R02 * J22
        xx = x * R00 + y * R01 + z * R02
        xy = x * R10 + y * R11 + z * R12
        xz = x * R20 + y * R21 + z * R22
        x = R10 * J00 + R11 * J01 + R12 * J02
        y = R10 * J01 + R11 * J11 + R12 * J12
        z = R10 * J02 + R11 * J12 + R12 * J22
        yy = x * R10 + y * R11 + z * R12
        yz = x * R20 + y * R21 + z * R22
        x = R20 * J00 + R21 * J01 + R22 * J02
        y = R20 * J01 + R21 * J11 + R22 * J12
        z = R20 * J02 + R21 * J12 + R22 * J22
        zz = x * R20 + y * R21 + z * R22
        # Centre of mass relative to the joint, and relative to the origin.
        cx, cy, cz = self._lever[i, 0], self._lever[i, 1], self._lever[i, 2]
        rx = R00 * cx + R01 * cy + R02 * cz
        ry = R10 * cx + R11 * cy + R12 * cz
        rz = R20 * cx + R21 * cy + R22 * cz
        x, y, z = self._p[i, 0] + rx, self._p[i, 1] + ry, self._p[i, 2] + rz
        # Newton: force is mass times the acceleration of the centre of mass.
        wx, wy, wz = self._w[i, 0], self._w[i, 1], self._w[i, 2]
        ax, ay, az = self._wd[i, 0], self._wd[i, 1], self._wd[i, 2]
        vx, vy, vz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
        fx = m * (self._a[i, 0] + ay * rz - az * ry + wy * vz - wz * vy)
        fy = m * (self._a[i, 1] + az * rx - ax * rz + wz * vx - wx * vz)
        fz = m * (self._a[i, 2] + ax * ry - ay * rx + wx * vy - wy * vx)
        self._F[i, 0], self._F[i, 1], self._F[i, 2] = fx, fy, fz
        # Euler: moment is the rate of change of angular momentum.
        kx = xx * wx + xy * wy + xz * wz
        ky = xy * wx + yy * wy + yz * wz
        kz = xz * wx + yz * wy + zz * wz
        self._N[i, 0] = xx * ax + xy * ay + xz * az + wy * kz - wz * ky + y * fz - z * fy
        self._N[i, 1] = xy * ax + yy * ay + yz * az + wz * kx - wx * kz + z * fx - x * fz
        self._N[i, 2] = xz * ax + yz * ay + zz * az + wx * ky - wy * kx + x * fy - y * fx
        # Parallel axis theorem.
        self._m[i] = m
        self._h[i, 0], self._h[i, 1], self._h[i, 2] = m * x, m * y, m * z
        self._J[i, 0] = xx + m * (y * y + z * z)
        self._J[i, 1], self._J[i, 2] = xy - m * x * y, xz - m * x * z
        self._J[i, 3] = yy + m * (x * x + z * z)
        self._J[i, 4] = yz - m * y * z
        self._J[i, 5] = zz + m * (x * x + y * y)

    def _carry(self, i: int) -> None:
        """Compute row i of mass matrix and bias, once joint i holds the sum of all bodies that it
        carries; then add that sum to its parent."""
        zx, zy, zz, sx, sy, sz = (
            self._z[i, 0],
            self._z[i, 1],
            self._z[i, 2],
            self._s[i, 0],
            self._s[i, 1],
            self._s[i, 2],
        )
        hx, hy, hz, m = self._h[i, 0], self._h[i, 1], self._h[i, 2], self._m[i]
        self._bias[i] = zx * self._N[i, 0] + zy * self._N[i, 1] + zz * self._N[i, 2]
        self._bias[i] += sx * self._F[i, 0] + sy * self._F[i, 1] + sz * self._F[i, 2]
        # Linear and angular momentum of all bodies carried by joint i, at q_dot_i = 1.
        lx, ly, lz = (
            m * sx + zy * hz - zz * hy,
            m * sy + zz * hx - zx * hz,
            m * sz + zx * hy - zy * hx,
        )
        kx = self._J[i, 0] * zx + self._J[i, 1] * zy + self._J[i, 2] * zz + hy * sz - hz * sy
        ky = self._J[i, 1] * zx + self._J[i, 3] * zy + self._J[i, 4] * zz + hz * sx - hx * sz
        kz = self._J[i, 2] * zx + self._J[i, 4] * zy + self._J[i, 5] * zz + hx * sy - hy * sx
        j = i
        while j >= 0:
            self._M[i, j] = (
                self._z[j, 0] * kx + self._z[j, 1] * ky + self._z[j, 2] * kz
                + self._s[j, 0] * lx + self._s[j, 1] * ly + self._s[j, 2] * lz
            )  # fmt: skip
            j = self._parent[j]
        k = self._parent[i]
        if k < 0:
            return
        self._m[k] += m
        for row in range(3):
            self._F[k, row] += self._F[i, row]
            self._N[k, row] += self._N[i, row]
            self._h[k, row] += self._h[i, row]
        for row in range(6):
            self._J[k, row] += self._J[i, row]

    def _solve(self, x: Vector) -> None:
        """Solve M x = x in place by M = L^T D L, where L has the sparsity of the tree."""
        for i in range(self.n - 1, -1, -1):
            j = self._parent[i]
            while j >= 0:
                share = self._M[i, j] / self._M[i, i]
                k = j
                while k >= 0:
                    self._M[j, k] -= share * self._M[i, k]
                    k = self._parent[k]
                self._M[i, j] = share
                x[j] -= share * x[i]
                j = self._parent[j]
        for i in range(self.n):
            x[i] /= self._M[i, i]
            j = self._parent[i]
            while j >= 0:
                x[i] -= self._M[i, j] * x[j]
                j = self._parent[j]
