"""Rigid-body dynamics of the links: M(q), C(q, q_dot)^T q_dot and g(q), by pinocchio."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from errors import ModelError
from estimator.types import Vector


class Model:
    """An arm's URDF (a file, or the text of one), seen in the caller's order of joints.

    Every movable joint of the URDF must be in `joints`: one that is not measured would hang at an
    unknown angle and make gravity wrong, so it is refused; make it `fixed` in the URDF instead.
    The rotors are not in here: B is diagonal and belongs to the transmission.

    Raises ModelError if the file cannot be read, a joint is missing, named twice, not measured or
    not a joint of one coordinate with limits.
    """

    def __init__(self, urdf: Path | str, joints: Sequence[str]) -> None:
        model = _read(urdf)
        self.names = tuple(joints)
        self.n = len(self.names)
        where = "the URDF" if isinstance(urdf, str) else str(urdf)
        order = _order(model, self.names, where)
        model.armature[:] = 0.0
        self.lower: Vector = model.lowerPositionLimit[order]
        self.upper: Vector = model.upperPositionLimit[order]
        # Row i of the caller is coordinate order[i] of pinocchio; `None` spares the permutation.
        self._order = None if np.array_equal(order, np.arange(self.n)) else order
        self._model = model
        self._data = model.createData()
        self._q = np.zeros(self.n)
        self._qd = np.zeros(self.n)

    def dynamics(self, q: Vector, qd: Vector) -> tuple[Vector, Vector]:
        """Momentum M q_dot and beta = C^T q_dot - g, both (n,) [kg m2/s, Nm].

        beta equals M_dot q_dot - c(q, q_dot) of (12), as M_dot = C + C^T.
        The arrays are new.
        """
        model, data = self._model, self._data
        q, qd = self._inward(q, self._q), self._inward(qd, self._qd)
        M = pin.crba(model, data, q)
        C = pin.computeCoriolisMatrix(model, data, q, qd)
        g = pin.computeGeneralizedGravity(model, data, q)
        return self._outward(M @ qd), self._outward(qd @ C - g)

    def gravity(self, q: Vector) -> Vector:
        """g(q), a copy, shape (n,) [Nm]: the torque that holds the arm still."""
        g = pin.computeGeneralizedGravity(self._model, self._data, self._inward(q, self._q))
        return self._outward(g.copy())

    def _inward(self, x: Vector, buffer: Vector) -> Vector:
        if self._order is None:
            return x
        buffer[self._order] = x
        return buffer

    def _outward(self, x: Vector) -> Vector:
        return x if self._order is None else x[self._order]


def _read(urdf: Path | str) -> pin.Model:
    """Of a file, or of the text of one."""
    where = "the URDF" if isinstance(urdf, str) else str(urdf)
    try:
        text = urdf if isinstance(urdf, str) else urdf.read_text(encoding="utf-8")
        return pin.buildModelFromXML(text)
    except (OSError, ValueError, RuntimeError) as error:
        raise ModelError(f"{where}: not a URDF that can be read: {error}") from error


def _order(model: pin.Model, joints: tuple[str, ...], urdf: str) -> np.ndarray:
    """Coordinate of each of the caller's joints in pinocchio's vectors."""
    movable = list(model.names)[1:]
    for name in joints:
        if name not in movable:
            raise ModelError(f"{urdf}: no movable joint {name!r}; it has {', '.join(movable)}")
        if joints.count(name) > 1:
            raise ModelError(f"joint {name!r} is named twice")
    for name in movable:
        if name not in joints:
            raise ModelError(f"{urdf}: joint {name!r} moves but is not measured; make it fixed")
        joint = model.joints[model.getJointId(name)]
        if joint.nq != 1 or joint.nv != 1:
            raise ModelError(f"{urdf}: joint {name!r} must be revolute, with limits")
    return np.array([model.joints[model.getJointId(name)].idx_v for name in joints])
