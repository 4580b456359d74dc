"""Rigid-body dynamics of the links: M(q), C(q, q_dot)^T q_dot and g(q), by pinocchio."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pinocchio as pin

from common.arrays import Matrix, Vector, check_shapes
from common.errors import ModelError
from estimator.body_inertia import PARAMETERS, BodyInertia, refuse_impossible
from estimator.dynamics import Body, Dynamics, Place
from estimator.model_reading import (
    add_tool,
    body_of,
    hand_of,
    order_of,
    reach_of,
    read_urdf,
    refuse_weightless,
)


class Model:
    """Rigid-body model of an arm from its URDF (a file, or the text of one), in the caller's joint
    order.

    Every movable joint of the URDF must be in `joints`: one that is not measured would have an
    unknown angle and make gravity wrong, so it is refused; make it `fixed` in the URDF instead. The
    rotors are not included: B is diagonal and belongs to the transmission.

    `mass` [kg] is that of all moving links; `reach` [m] bounds how far they extend from the first
    joint, each body as far beyond its centre of mass as that is from its joint; `hand` is the name
    of the URDF's last link, `tool` describes the point of `tool_jacobian`, and `tool_place` (3,)
    [m] is that point in the hand's frame.

    `bodies`, by joint, replace those of the URDF, but not in `links`, which are as it describes
    them.

    All users of an arm share its model: it never changes, and no result depends on an earlier call.
    Its methods share working memory, however, so only one thread may use it.

    Raises ModelError if the file cannot be read; if a joint is missing, named twice, not measured,
    or not revolute with limits; if the mass or inertia of a moving link is physically impossible;
    and if a joint moves no mass or no inertia.
    """

    def __init__(
        self,
        urdf: Path | str,
        joints: Sequence[str],
        bodies: Mapping[str, BodyInertia] = MappingProxyType({}),
    ) -> None:
        model, self.links = read_urdf(urdf)
        self.names = tuple(joints)
        self.n = len(self.names)
        where = "the URDF" if isinstance(urdf, str) else str(urdf)
        order = order_of(model, self.names, where)
        model.armature[:] = 0.0
        for name, body in bodies.items():
            refuse_impossible(name, body)
            inertia = pin.Inertia(body.mass, np.array(body.com), body.tensor())
            model.inertias[model.getJointId(name)] = inertia
        refuse_weightless(model, where)
        self.lower: Vector = model.lowerPositionLimit[order]
        self.upper: Vector = model.upperPositionLimit[order]
        # Row i of the caller is coordinate order[i] of pinocchio; `None` if they are the same.
        self._order = None if np.array_equal(order, np.arange(self.n)) else order
        self.hand, placement = hand_of(model)
        self._hand_rotation, self._hand_place = placement.rotation, placement.translation
        self.tool, self._tool = add_tool(model)
        tool = model.frames[self._tool].placement.translation
        self.tool_place: Vector = self._hand_rotation.T @ (tool - self._hand_place)
        self.mass = float(sum(body.mass for body in list(model.inertias)[1:]))
        self.reach = reach_of(model)
        self._model = model
        self._data = model.createData()
        self._q = np.zeros(self.n)
        self.down: Vector = model.gravity.linear.copy()
        self.recursion = Dynamics(self.bodies(), self.down)

    def dynamics(self, q: Vector, q_dot: Vector) -> tuple[Vector, Vector]:
        """Momentum M q_dot and beta = C^T q_dot - g, both (n,) [kg m2/s, Nm]; copies.

        beta equals M_dot q_dot - c(q, q_dot) of (12), as M_dot = C + C^T.
        """
        q, q_dot = np.array(q, dtype=np.float64), np.array(q_dot, dtype=np.float64)
        check_shapes((self.n,), q=q, q_dot=q_dot)
        self.recursion.at(q, q_dot)
        return np.array(self.recursion.momentum), np.array(self.recursion.beta)

    def bodies(self) -> list[Body]:
        """Bodies of the joints, each after its parent; `Body.row` is the caller's order."""
        order = np.arange(self.n) if self._order is None else self._order
        row = np.argsort(order)
        return [body_of(self._model, k, int(row[k])) for k in range(self.n)]

    def parameters(self) -> Matrix:
        """Ten parameters of each joint's body (n, 10), as in `body_inertia.PARAMETERS`; a copy."""
        return np.array(
            [self._model.inertias[self._model.getJointId(j)].toDynamicParameters()
             for j in self.names]
        )  # fmt: skip

    def regressor(self, q: Vector, q_dot: Vector, q_ddot: Vector) -> Matrix:
        """Regressor of M q_ddot + C q_dot + g: torques per unit of each parameter of each joint's
        body, (n, n, 10); the first axis is that of the torques."""
        pair = np.empty((2, self.n))
        v, a = self._inward(q_dot, pair[0]), self._inward(q_ddot, pair[1])
        inward = self._inward(q, self._q)
        Y = pin.computeJointTorqueRegressor(self._model, self._data, inward, v, a)
        Y = np.asarray(Y).reshape(self.n, self.n, PARAMETERS)
        copy: Matrix = Y.copy() if self._order is None else Y[np.ix_(self._order, self._order)]
        return copy

    def gravity(self, q: Vector) -> Vector:
        """Gravity torques g(q) (n,) [Nm], which hold the arm still; a copy."""
        g = pin.computeGeneralizedGravity(self._model, self._data, self._inward(q, self._q))
        return self._outward(g.copy())

    def inertia(self, q: Vector) -> Vector:
        """Diagonal of M(q) (n,) [kg m2]: inertia of each joint about its axis; a copy."""
        M = pin.crba(self._model, self._data, self._inward(q, self._q))
        return self._outward(np.diag(M).copy())

    def tool_jacobian(self, q: Vector) -> Matrix:
        """Jacobian of the tool point (3, n): velocity [m/s] along the axes of the URDF's root per
        joint velocity [rad/s]; a copy. Its transpose maps a force at the tool to joint torques."""
        model, data, frame = self._model, self._data, self._tool
        axes = pin.LOCAL_WORLD_ALIGNED
        full = pin.computeFrameJacobian(model, data, self._inward(q, self._q), frame, axes)
        full = full.reshape(6, self.n)  # pinocchio returns a vector for a single joint
        J: Matrix = full[:3].copy() if self._order is None else full[:3, self._order]
        return J

    def payload_torques(self, q: Vector, down: Vector) -> tuple[Vector, Matrix]:
        """Joint torques of a point mass at the hand: (n,) per kg at the origin of the hand's frame,
        and (n, 3) per kg m along each of its axes. down: weight per kg along the axes of the URDF's
        root (3,) [m/s2]."""
        model, data, joint = self._model, self._data, self._model.njoints - 1
        axes = pin.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobians(model, data, self._inward(q, self._q))
        J = pin.getJointJacobian(model, data, joint, axes).reshape(6, self.n)
        J = J if self._order is None else J[:, self._order]
        R = data.oMi[joint].rotation
        force = _cross(R @ self._hand_place, down)
        turning = _cross(R @ self._hand_rotation, down)  # moment of each axis of the hand
        return J[:3].T @ down + J[3:].T @ force, J[3:].T @ turning

    def place(self, link: str = "") -> Place:
        """Tool point with the axes of the hand, or origin and axes of a link. Raises ModelError for
        a link that no joint moves."""
        if not link:
            point = self.in_joint(self.tool_place)
            return Place(self._model.njoints - 2, point, self._hand_rotation.copy())
        moved = [f for f in self._model.frames if f.type == pin.FrameType.BODY and f.parentJoint]
        for frame in moved:
            if frame.name == link:
                at = frame.placement
                return Place(frame.parentJoint - 1, at.translation.copy(), at.rotation.copy())
        there = ", ".join(frame.name for frame in moved)
        raise ModelError(f"the URDF moves no link {link!r}; it moves {there}")

    def axes(self, q: Vector, link: str = "") -> Matrix:
        """Axes of the frame of `place`, in columns (3, 3), in the root frame of the URDF."""
        place = self.place(link)
        pin.forwardKinematics(self._model, self._data, self._inward(q, self._q))
        turned: Matrix = self._data.oMi[place.body + 1].rotation @ place.axes
        return turned

    @property
    def hand_joint(self) -> int:
        """Row of the last joint, which moves the hand."""
        last = self._model.njoints - 2
        return last if self._order is None else int(np.flatnonzero(self._order == last)[0])

    def in_hand(self, place: Vector) -> Vector:
        """Point (3,) [m] given in the last joint's frame, in that of the hand."""
        there: Vector = self._hand_rotation.T @ (place - self._hand_place)
        return there

    def in_joint(self, place: Vector) -> Vector:
        """Point (3,) [m] given in the hand's frame, in that of the last joint."""
        there: Vector = self._hand_place + self._hand_rotation @ place
        return there

    def _inward(self, x: Vector, buffer: Vector) -> Vector:
        if self._order is None:
            return x
        buffer[self._order] = x
        return buffer

    def _outward(self, x: Vector) -> Vector:
        return x if self._order is None else x[self._order]


def _cross(x: Matrix, y: Vector) -> Matrix:
    """Cross product of x (3,), or of each column of x (3, n), with y (3,). numpy's takes three to
    ten times as long, and starting up computes thousands."""
    return np.array(
        [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
    )
