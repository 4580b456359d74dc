"""Plant with two masses per joint: links as a tree of bodies, motors as reflected inertias."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from common.arrays import Matrix, Vector
from common.compiled import uncompiled
from simulator.friction_law import FrictionLaw
from simulator.gear_settings import GearSettings
from simulator.gears import Gears
from simulator.links import Links
from simulator.mismatch import PlantParameters
from simulator.two_masses import TwoMasses

SMOOTH: Final = FrictionLaw()
_OFF_AXIS: Final = 0.01  # distance below which a load has no lever about the last joint [m]
External = Callable[[Vector, Vector, Vector], None]
"""(q, q_dot, out): writes the present external joint torque [Nm] to `out` (n,)."""


class ArticulatedBodies:
    """Replacement of `Links` by pinocchio, used if that is not compiled: in plain Python it would
    be slower than real time."""

    def __init__(self, model: pin.Model) -> None:
        self.n, self._model, self._data = model.nv, model, model.createData()

    @property
    def gravity(self) -> Any:
        """Gravity of the model (3,) [m/s^2]; writable."""
        return self._model.gravity.linear

    def load(self, i: int, mass: float, lever: Vector, inertia: Matrix) -> None:
        """Replace a body, as `Links.load`."""
        self._model.inertias[i + 1] = pin.Inertia(mass, lever, inertia)

    def accelerate(self, q: Vector, q_dot: Vector, tau: Vector, out: Vector) -> None:
        """Write the accelerations to `out`, as `Links.accelerate`."""
        out[:] = pin.aba(self._model, self._data, q, q_dot, tau)


def links_of(model: pin.Model) -> Links:
    """Dynamics of the links, by the fastest available implementation."""
    if "simulator.links" in uncompiled():
        return cast(Links, ArticulatedBodies(model))
    return Links(model)


def last_link(model: pin.Model) -> pin.Frame:
    """Frame of the URDF's last link."""
    return [
        frame
        for frame in model.frames
        if frame.parentJoint == model.njoints - 1 and frame.type == pin.FrameType.BODY
    ][-1]


class Plant:
    """Plant of the arm, integrated by semi-implicit Euler with a fixed step.

    M(q) q_dotdot + c(q, q_dot) = tau_gear - friction_q + tau_stop + tau_ext
    B theta_dotdot              = tau_M - tau_gear - friction_theta

    The gear is a dead zone of half-width alpha in phi = q - theta; beyond it a unilateral
    spring-damper acts on the penetration delta = phi - sign(phi) alpha. End stops are the same
    element in q. The integration step is in `two_masses`.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        step_s: float,
        law: FrictionLaw = SMOOTH,
        gears: Gears | None = None,
    ) -> None:
        """gears: None for gears as the estimator models them."""
        self.parameters, self.n, self.step_s = parameters, parameters.model.nv, step_s
        self._model, self._data = parameters.model, parameters.model.createData()
        gears = gears or Gears(GearSettings(), np.ones(self.n), np.ones(self.n), step_s, 0)
        links = links_of(parameters.model)
        self.masses = masses = TwoMasses(links, parameters, step_s, law, gears)
        self.phi: Vector = np.asarray(masses.phi)
        self.q: Vector = np.asarray(masses.q)
        """phi = q - theta and link positions q (n,) [rad]; views that change with every step."""
        self.q_dot: Vector = np.asarray(masses.q_dot)
        self.theta_dot: Vector = np.asarray(masses.theta_dot)
        """Velocities of links and motors at the link (n,) [rad/s]; views."""
        self.external_torque: Vector = np.asarray(masses.external)
        self.motor_torque: Vector = np.asarray(masses.motor)
        """tau_ext and tau_M (n,) [Nm]; writable views, to be set before `advance`."""
        self._gear, self._friction = np.asarray(masses.gear), np.asarray(masses.friction)
        self._coulomb, self._viscous = np.asarray(masses.coulomb), np.asarray(masses.viscous)
        self._hand = parameters.model.inertias[self.n].copy()

    @property
    def theta(self) -> Vector:
        """Motor positions seen at the link (n,) [rad]."""
        return np.subtract(self.q, self.phi)

    @property
    def gear_torque(self) -> Vector:
        """Torque of the gear on the link in the last step (n,) [Nm]."""
        return np.asarray(np.negative(self._gear))

    @property
    def friction_torque(self) -> Vector:
        """Friction torque in the last step (2n,) [Nm], link then motor."""
        return np.asarray(self._friction.flatten())

    @property
    def in_gap(self) -> NDArray[np.bool_]:
        """True for joints in the gap, where link and motor do not touch (n,)."""
        return np.asarray(np.abs(self.phi) < np.asarray(self.masses.half_gap))

    def brake(self, joint: int, closed: bool) -> None:
        """Close or open a joint's brake; a closed one holds the motor in place."""
        self.masses.free[joint] = 0.0 if closed else 1.0
        if closed:
            self.theta_dot[joint] = 0.0

    @property
    def coulomb(self) -> Vector:
        """Present Coulomb friction of link and motor (2, n) [Nm]."""
        return self._coulomb.copy()

    def scale_friction(self, factor: Vector) -> None:
        """Set the friction of each joint, both sides, to `factor` (n,) times its original value."""
        self._coulomb[:] = self.parameters.coulomb.reshape(2, self.n) * factor
        self._viscous[:] = self.parameters.viscous.reshape(2, self.n) * factor

    @property
    def held_at(self) -> Vector:
        """Position of a carried load (3,) in the frame of the last joint [m]: the origin of the
        URDF's last link if it is off the joint's axis, as for a tool; otherwise the centre of mass
        of the bodies that the joint moves."""
        origin = last_link(self._model).placement.translation
        return np.array(origin if np.linalg.norm(origin) > _OFF_AXIS else self._hand.lever)

    def carry(self, mass: float, place: ArrayLike | None = None) -> None:
        """Carry a point mass [kg] from now on, in place of any other, at a position (3,) in the
        frame of the URDF's last link [m] (default: `held_at`); 0 removes it."""
        frame = last_link(self._model)
        at = self.held_at if place is None else frame.placement.act(np.array(place))
        load = pin.Inertia(mass, at, np.zeros((3, 3)))
        body = self._hand + load if mass > 0.0 else self._hand
        self._model.inertias[self.n] = body  # of `energy`, too
        self.masses.links.load(self.n - 1, body.mass, body.lever.copy(), body.inertia.copy())

    def place(self, q: Vector, phi: Vector | None = None) -> None:
        """Place the arm at rest at q (n,), with phi (n,) or in the middle of its gaps."""
        self.q[:] = q
        self.phi[:] = 0.0 if phi is None else phi
        self.q_dot[:] = self.theta_dot[:] = 0.0
        np.asarray(self.masses.deflection)[:] = 0.0

    def weigh(self, gravity: Vector) -> None:
        """Set the gravity (3,) [m/s^2]."""
        self._model.gravity.linear[:] = gravity
        np.asarray(self.masses.links.gravity)[:] = gravity

    def weight(self, q: Vector) -> Vector:
        """Torque (n,) [Nm] that holds the links at q (n,) against gravity; a copy."""
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, np.asarray(q)))

    def pressed(self, q: Vector, force: Vector) -> Vector:
        """Joint torque (n,) [Nm] at q (n,) of a force (3,) [N] at `held_at`, along the axes of the
        URDF's last link."""
        J = pin.computeJointJacobian(self._model, self._data, np.asarray(q), self.n)
        along = last_link(self._model).placement.rotation @ force
        moment = np.cross(self.held_at, along)
        return np.asarray(J.reshape(6, self.n).T @ np.concatenate((along, moment)))

    def energy(self) -> float:
        """Kinetic, potential and elastic energy [J]: constant without friction and damping."""
        p = self.parameters
        kinetic = pin.computeKineticEnergy(self._model, self._data, self.q, self.q_dot)
        potential = pin.computePotentialEnergy(self._model, self._data, self.q)
        rotors = 0.5 * float(p.rotor_inertia @ self.theta_dot**2)
        gear = self.phi - np.clip(self.phi, -p.half_gap, p.half_gap)
        stop = self.q - np.clip(self.q, p.lower, p.upper)
        elastic = 0.5 * float(p.stiffness @ (gear**2 + stop**2))
        return float(kinetic + potential) + rotors + elastic

    def advance(self, steps: int, external: External | None = None) -> None:
        """Integrate `steps` steps with constant motor torque; `external` is called at each step."""
        self.masses.advance(steps, self.touched_by(external))

    def touched_by(self, external: External | None) -> Callable[[], None] | None:
        """Function for `two_masses` to call before each step, which lets `external` write its
        torque."""
        if external is None:
            return None
        return partial(external, self.q, self.q_dot, self.external_torque)
