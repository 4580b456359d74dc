"""Plant of two masses per joint: links as a tree of bodies, motors as reflected inertias."""

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
_OFF_AXIS: Final = 0.01  # [m]; nearer to the last joint, a load has no lever about it
External = Callable[[Vector, Vector, Vector], None]
"""(q, q_dot, out): writes the external joint torque of this instant [Nm] into out (n,)."""


class ArticulatedBodies:
    """Replacement of `Links` by pinocchio, where that is not compiled and takes longer in plain
    Python than the time that it simulates."""

    def __init__(self, model: pin.Model) -> None:
        self.n, self._model, self._data = model.nv, model, model.createData()

    @property
    def gravity(self) -> Any:
        """The model's own (3,)."""
        return self._model.gravity.linear

    def load(self, i: int, mass: float, lever: Vector, inertia: Matrix) -> None:
        """As that of `Links`."""
        self._model.inertias[i + 1] = pin.Inertia(mass, lever, inertia)

    def accelerate(self, q: Vector, q_dot: Vector, tau: Vector, out: Vector) -> None:
        """As that of `Links`."""
        out[:] = pin.aba(self._model, self._data, q, q_dot, tau)


def links_of(model: pin.Model) -> Links:
    """Dynamics of the links, as fast as can be."""
    if "simulator.links" in uncompiled():
        return cast(Links, ArticulatedBodies(model))
    return Links(model)


def last_link(model: pin.Model) -> pin.Frame:
    """The frame of the URDF's last link."""
    return [
        frame
        for frame in model.frames
        if frame.parentJoint == model.njoints - 1 and frame.type == pin.FrameType.BODY
    ][-1]


class Plant:
    """Integrates the arm by semi-implicit Euler with a fixed step.

    M(q) q_dotdot + c(q, q_dot) = tau_gear - friction_q + tau_stop + tau_ext
    B theta_dotdot              = tau_M - tau_gear - friction_theta

    The gear is a dead zone of half-width alpha in phi = q - theta; beyond it a spring-damper acts
    on the penetration delta = phi - sign(phi) alpha, and pushes only. End stops are the same
    element in q. The step itself is in `two_masses`.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        step_s: float,
        law: FrictionLaw = SMOOTH,
        gears: Gears | None = None,
    ) -> None:
        """Without `gears`, they are as the estimator models them."""
        self.parameters, self.n, self.step_s = parameters, parameters.model.nv, step_s
        self._model, self._data = parameters.model, parameters.model.createData()
        gears = gears or Gears(GearSettings(), np.ones(self.n), np.ones(self.n), step_s, 0)
        links = links_of(parameters.model)
        self.masses = masses = TwoMasses(links, parameters, step_s, law, gears)
        self.phi: Vector = np.asarray(masses.phi)
        self.q: Vector = np.asarray(masses.q)
        """q - theta and link positions (n,) [rad]; views, they change with every step."""
        self.q_dot: Vector = np.asarray(masses.q_dot)
        self.theta_dot: Vector = np.asarray(masses.theta_dot)
        """Velocities of links and motors, at the link (n,) [rad/s]; views."""
        self.external_torque: Vector = np.asarray(masses.external)
        self.motor_torque: Vector = np.asarray(masses.motor)
        """tau_ext and tau_M (n,) [Nm]; views to write to before `advance`."""
        self._gear, self._friction = np.asarray(masses.gear), np.asarray(masses.friction)
        self._coulomb, self._viscous = np.asarray(masses.coulomb), np.asarray(masses.viscous)
        self._hand = parameters.model.inertias[self.n].copy()

    @property
    def theta(self) -> Vector:
        """Motor positions seen at the link (n,) [rad]."""
        return np.subtract(self.q, self.phi)

    @property
    def gear_torque(self) -> Vector:
        """Torque of the gear on the link (n,) [Nm], of the last step."""
        return np.asarray(np.negative(self._gear))

    @property
    def friction_torque(self) -> Vector:
        """Torque of friction (2n,) [Nm], link then motor, of the last step."""
        return np.asarray(self._friction.flatten())

    @property
    def in_gap(self) -> NDArray[np.bool_]:
        """True where link and motor do not touch (n,)."""
        return np.asarray(np.abs(self.phi) < np.asarray(self.masses.half_gap))

    def brake(self, joint: int, closed: bool) -> None:
        """Close or open a joint's brake; a closed one holds the motor where it is."""
        self.masses.free[joint] = 0.0 if closed else 1.0
        if closed:
            self.theta_dot[joint] = 0.0

    @property
    def coulomb(self) -> Vector:
        """Coulomb friction of link and motor as it is now (2, n) [Nm]."""
        return self._coulomb.copy()

    def scale_friction(self, factor: Vector) -> None:
        """Make the friction of each joint, both sides, `factor` (n,) times its own from now on."""
        self._coulomb[:] = self.parameters.coulomb.reshape(2, self.n) * factor
        self._viscous[:] = self.parameters.viscous.reshape(2, self.n) * factor

    @property
    def held_at(self) -> Vector:
        """Place of a load in the hand (3,), in the frame of the last joint [m]: the origin of the
        URDF's last link if that is off the joint's axis, as a tool's is; else the centre of mass of
        the bodies that the joint moves."""
        origin = last_link(self._model).placement.translation
        return np.array(origin if np.linalg.norm(origin) > _OFF_AXIS else self._hand.lever)

    def carry(self, mass: float, place: ArrayLike | None = None) -> None:
        """Have the hand carry a point mass [kg] from now on, at a place (3,) in the frame of the
        URDF's last link [m], without one `held_at`, instead of what it carried; 0 takes that
        away."""
        frame = last_link(self._model)
        at = self.held_at if place is None else frame.placement.act(np.array(place))
        load = pin.Inertia(mass, at, np.zeros((3, 3)))
        body = self._hand + load if mass > 0.0 else self._hand
        self._model.inertias[self.n] = body  # of `energy`, too
        self.masses.links.load(self.n - 1, body.mass, body.lever.copy(), body.inertia.copy())

    def place(self, q: Vector, phi: Vector | None = None) -> None:
        """Put the arm at rest at q (n,), with phi (n,) or in the middle of its gaps."""
        self.q[:] = q
        self.phi[:] = 0.0 if phi is None else phi
        self.q_dot[:] = self.theta_dot[:] = 0.0
        np.asarray(self.masses.deflection)[:] = 0.0

    def weigh(self, gravity: Vector) -> None:
        """Let another gravity (3,) [m/s^2] act from now on."""
        self._model.gravity.linear[:] = gravity
        np.asarray(self.masses.links.gravity)[:] = gravity

    def weight(self, q: Vector) -> Vector:
        """Torque that holds the links at q (n,) against gravity (n,) [Nm]; a copy."""
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, np.asarray(q)))

    def pressed(self, q: Vector, force: Vector) -> Vector:
        """Torque on the joints (n,) [Nm] of a force at `held_at` (3,) [N], along the axes of the
        URDF's last link, at q (n,)."""
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
        """Integrate over `steps` steps with constant motor torque; external is asked each step."""
        self.masses.advance(steps, self.touched_by(external))

    def touched_by(self, external: External | None) -> Callable[[], None] | None:
        """Function that `two_masses` calls before each step to have `external` write its torque."""
        if external is None:
            return None
        return partial(external, self.q, self.q_dot, self.external_torque)
