"""Hands that press on a simulated arm: forces at points of its links, each for a limited time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin

from bench.rigs.arm_without_bus import Harness
from common.arrays import Matrix, Vector
from estimator.model import Model

PRESSES_S: Final = 0.7
FORCES_N: Final = (2.0, 60.0)
THICK: Final = 0.035  # [m]: from the middle of a link to its surface
_STRENGTH: Final = 0.8  # of the motors, gravity included


@dataclass(frozen=True, slots=True)
class Touch:
    """Force along the axes of the URDF's root (3,) [N], on the link of joint `row`, at a point of
    that joint's frame (3,) [m]."""

    row: int
    point: Vector
    force: Vector


@dataclass(frozen=True, slots=True)
class Press:
    """Simultaneous touches, from a time on [s]; `place` is tool, beside, link or two."""

    onset_s: float
    place: str
    touches: tuple[Touch, ...]


class Hands:
    """Hands that act on one arm, callable as `Scenario.act`."""

    def __init__(self, model: Model, urdf: str, presses: Sequence[Press] = ()) -> None:
        self.model, self.presses = model, presses
        self._pin = pin.buildModelFromXML(urdf)
        self._data = self._pin.createData()
        self._order = [self._pin.joints[self._pin.getJointId(name)].idx_v for name in model.names]

    def jacobian(self, q: Vector, row: int, point: Vector) -> Matrix:
        """Jacobian (3, n) of a point of a link, along the root's axes."""
        inward = np.zeros(len(q))
        inward[self._order] = q
        joint = self._order[row] + 1
        pin.computeJointJacobians(self._pin, self._data, inward)
        J = pin.getJointJacobian(self._pin, self._data, joint, pin.LOCAL_WORLD_ALIGNED)
        away = self._data.oMi[joint].rotation @ point
        at_point: Matrix = (J[:3] - pin.skew(away) @ J[3:])[:, self._order]
        return at_point

    def at_tool(self, q: Vector) -> tuple[Vector, Matrix]:
        """Position of the tool point along the root's axes (3,) [m], and its Jacobian (3, n)."""
        row, point = self.model.hand_joint, self.model.in_joint(self.model.tool_place)
        J, body = self.jacobian(q, row, point), self._data.oMi[self._order[row] + 1]
        return body.translation + body.rotation @ point, J

    def turned(self, q: Vector, row: int) -> Matrix:
        """Axes of a joint's frame in columns, in the root frame (3, 3)."""
        self.jacobian(q, row, np.zeros(3))
        R: Matrix = self._data.oMi[self._order[row] + 1].rotation.copy()
        return R

    def place(self, q: Vector, row: int, point: Vector) -> Vector:
        """Point of a joint's frame, in the root frame (3,) [m]."""
        self.jacobian(q, row, point)
        at: Vector = self._data.oMi[self._order[row] + 1].act(point)
        return at

    def end(self, row: int) -> Vector:
        """Far end of a link: at the next joint, or as far again beyond its centre of mass."""
        joint = self._order[row] + 1
        nexts = [
            self._pin.jointPlacements[k].translation
            for k in range(joint + 1, self._pin.njoints)
            if self._pin.parents[k] == joint
        ]
        if nexts and np.linalg.norm(nexts[0]) > THICK:
            return np.array(nexts[0])
        return 2.0 * np.array(self._pin.inertias[joint].lever)

    def __call__(self, harness: Harness, t: float) -> Vector:
        torque = np.zeros(self.model.n)
        for press in self.presses:
            if press.onset_s <= t < press.onset_s + PRESSES_S:
                for touch in press.touches:
                    J = self.jacobian(harness.plant.q, touch.row, touch.point)
                    torque += J.T @ touch.force
        return torque


def drawn(
    hands: Hands, onsets_s: Sequence[float], poses: Matrix, strength: Vector, seed: int
) -> list[Press]:
    """Random presses, one per onset, of every direction and size; poses (onsets, n) [rad] then.

    Of twenty, six are at the tool point, six up to 3 cm beside it, six anywhere on a link's
    surface, two at the tool and on a link at once. strength (n,) [Nm]: no force overcomes a motor.
    """
    rng, model = np.random.default_rng((seed, 77)), hands.model
    tool, last = model.in_joint(model.tool_place), model.hand_joint
    presses = []
    for onset_s, q in zip(onsets_s, poses, strict=True):
        place = str(rng.choice(["tool", "beside", "link", "two"], p=[0.3, 0.3, 0.3, 0.1]))
        room = np.maximum(_STRENGTH * strength - np.abs(model.gravity(q)), 0.1 * strength)
        touches = []
        for where in {"two": ("tool", "link")}.get(place, (place,)):
            row, point = last, tool
            if where == "beside":
                point = tool + 0.03 * rng.uniform() ** (1 / 3) * any_way(rng)
            if where == "link":
                row = int(rng.integers(model.n))
                end, way = hands.end(row), any_way(rng)
                along = end / max(float(np.linalg.norm(end)), 1e-9)
                aside = way - along * (along @ way)
                aside *= THICK / max(float(np.linalg.norm(aside)), 1e-9)
                point = rng.uniform(0.2, 1.0) * end + aside
            force = np.exp(rng.uniform(*np.log(FORCES_N))) * any_way(rng)
            needed = np.abs(hands.jacobian(q, row, point).T @ force)
            force *= min(1.0, float(np.min(room / np.maximum(needed, 1e-9))))
            touches.append(Touch(row, point, force))
        presses.append(Press(onset_s, place, tuple(touches)))
    return presses


def any_way(rng: np.random.Generator) -> Vector:
    way = rng.normal(size=3)
    unit: Vector = way / np.linalg.norm(way)
    return unit
