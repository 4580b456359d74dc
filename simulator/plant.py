"""Two masses per joint: the links by articulated bodies, the motors as reflected inertias."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from simulator.mismatch import PlantParameters

Vector = NDArray[np.float64]
External = Callable[[Vector, Vector, Vector], None]
"""(q, q_dot, out): writes the external joint torque of this instant [Nm] into out (n,)."""


class Plant:
    """Integrates the arm by semi-implicit Euler with a fixed step.

    M(q) q_dotdot + c(q, q_dot) = tau_gear - friction_q + tau_stop + tau_ext
    B theta_dotdot              = tau_M - tau_gear - friction_theta

    The gear is a dead zone of half-width alpha in phi = q - theta; beyond it a spring-damper acts
    on the penetration delta = phi - sign(phi) alpha, and pushes only. End stops are the same
    element in q. Inside, links come first and motors second in every (2n,) vector.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        step_s: float,
        friction: Literal["smooth", "dahl"] = "smooth",
        friction_width: float = 0.02,
        presliding: float = 0.001,
    ) -> None:
        n = parameters.model.nv
        self.parameters, self.n, self.step_s = parameters, n, step_s
        self._model, self._data = parameters.model, parameters.model.createData()
        self._friction = friction
        # Dead zones: rows 0..n-1 are phi, n..2n-1 are q.
        self._low = np.concatenate((-parameters.half_gap, parameters.lower))
        self._high = np.concatenate((parameters.half_gap, parameters.upper))
        self._stiffness = np.tile(parameters.stiffness, 2)
        self._damping = np.tile(parameters.damping, 2)
        self._phi_q = np.concatenate((np.zeros(n), parameters.initial_position))
        self._rates = np.zeros(2 * n)
        self._velocity = np.zeros(2 * n)
        self._acceleration = np.zeros(2 * n)
        self._applied = np.zeros(2 * n)
        self._rubbing = np.zeros(2 * n)
        self._deflection = np.zeros(2 * n)
        self._contact = np.zeros(2 * n)
        self._delta, self._scratch, self._sign = np.zeros((3, 2 * n))
        # Torque of the motors to change of speed in a step; the links' inertia is in their ABA.
        self._gain = step_s / np.concatenate((np.ones(n), parameters.rotor_inertia))
        # A Python float as operand costs numpy a conversion at each step; a vector does not.
        self._steps, self._none, self._one = np.full(2 * n, step_s), np.zeros(2 * n), np.ones(2 * n)
        self._per_width = np.full(2 * n, 1.0 / friction_width)
        self._per_presliding = np.full(2 * n, step_s / presliding)
        self._coulomb, self._viscous = parameters.coulomb.copy(), parameters.viscous.copy()
        self._minus_coulomb = -parameters.coulomb
        # sigma_1 damps the swinging of each mass on its bristles to 0.7; times z_max / step, as it
        # meets the change of z in a step.
        masses = np.concatenate((parameters.lightest_link, parameters.rotor_inertia))
        sigma_1 = 1.4 * np.sqrt(parameters.coulomb / presliding * masses)
        self._bristle_damping = sigma_1 * presliding / step_s

    @property
    def q(self) -> Vector:
        """Link positions (n,) [rad]; a view, valid until the next step."""
        return self._phi_q[self.n :]

    @property
    def theta(self) -> Vector:
        """Motor positions seen at the link (n,) [rad]."""
        return np.subtract(self.q, self.phi)

    @property
    def phi(self) -> Vector:
        """q - theta (n,) [rad]; a view."""
        return self._phi_q[: self.n]

    @property
    def q_dot(self) -> Vector:
        """Link velocities (n,) [rad/s]; a view."""
        return self._velocity[: self.n]

    @property
    def theta_dot(self) -> Vector:
        """Motor velocities at the link (n,) [rad/s]; a view."""
        return self._velocity[self.n :]

    @property
    def motor_torque(self) -> Vector:
        """tau_M (n,) [Nm]; a view to write to before `advance`."""
        return self._applied[self.n :]

    @property
    def external_torque(self) -> Vector:
        """tau_ext (n,) [Nm]; a view to write to before `advance`."""
        return self._applied[: self.n]

    @property
    def gear_torque(self) -> Vector:
        """What the gear hands to the link (n,) [Nm], of the last step."""
        return np.negative(self._contact[: self.n])

    @property
    def friction_torque(self) -> Vector:
        """What friction takes (2n,) [Nm], link then motor, of the last step."""
        return self._rubbing.copy()

    @property
    def in_gap(self) -> NDArray[np.bool_]:
        """True where link and motor do not touch (n,)."""
        return np.asarray(np.abs(self.phi) < self.parameters.half_gap)

    def brake(self, joint: int, closed: bool) -> None:
        """A closed brake holds the motor where it is."""
        rotor = self.parameters.rotor_inertia[joint]
        self._gain[self.n + joint] = 0.0 if closed else self.step_s / rotor
        if closed:
            self.theta_dot[joint] = 0.0
            self._rates[joint] = self.q_dot[joint]

    def scale_friction(self, factor: Vector) -> None:
        """From now on the friction of each joint, both sides, is `factor` (n,) times its own."""
        both = np.tile(factor, 2)
        np.multiply(self.parameters.coulomb, both, out=self._coulomb)
        np.multiply(self.parameters.viscous, both, out=self._viscous)
        np.negative(self._coulomb, out=self._minus_coulomb)

    def place(self, q: Vector, phi: Vector | None = None) -> None:
        """Put the arm at rest at q (n,), with phi (n,) or in the middle of its gaps."""
        self._phi_q[self.n :] = q
        self._phi_q[: self.n] = 0.0 if phi is None else phi
        self._velocity[:] = self._rates[:] = self._deflection[:] = 0.0

    def energy(self) -> float:
        """Kinetic, potential and elastic energy [J]: constant without friction and damping."""
        kinetic = pin.computeKineticEnergy(self._model, self._data, self.q, self.q_dot)
        potential = pin.computePotentialEnergy(self._model, self._data, self.q)
        rotors = 0.5 * float(self.parameters.rotor_inertia @ self.theta_dot**2)
        delta = self._phi_q - np.clip(self._phi_q, self._low, self._high)
        return float(kinetic + potential) + rotors + 0.5 * float(self._stiffness @ delta**2)

    def advance(self, steps: int, external: External | None = None) -> None:
        """Integrate over `steps` steps with constant motor torque; external is asked each step."""
        # One pass of small vectors: every name below is a buffer or a view, nothing is allocated.
        n, model, data = self.n, self._model, self._data
        phi_q, rates, velocity = self._phi_q, self._rates, self._velocity
        q, q_dot, theta_dot = phi_q[n:], velocity[:n], velocity[n:]
        rates_phi, rates_q = rates[:n], rates[n:]
        applied, rubbing, contact = self._applied, self._rubbing, self._contact
        gear, stop = contact[:n], contact[n:]
        acceleration = self._acceleration
        link, motor = acceleration[:n], acceleration[n:]
        tau_ext = applied[:n]
        delta, scratch, sign = self._delta, self._scratch, self._sign
        rub = self._rub_smoothly if self._friction == "smooth" else self._rub_with_stiction
        for _ in range(steps):
            if external is not None:
                external(q, q_dot, tau_ext)
            np.maximum(phi_q, self._low, out=scratch)
            np.minimum(scratch, self._high, out=scratch)
            np.subtract(phi_q, scratch, out=delta)
            np.sign(delta, out=sign)
            np.multiply(self._stiffness, delta, out=contact)
            np.multiply(self._damping, rates, out=scratch)
            np.add(contact, scratch, out=contact)
            np.multiply(contact, sign, out=contact)
            np.maximum(contact, self._none, out=contact)  # a border pushes, it never pulls
            np.multiply(contact, sign, out=contact)
            rub(scratch)
            np.subtract(applied, rubbing, out=acceleration)
            np.subtract(link, gear, out=link)
            np.subtract(link, stop, out=link)
            np.add(motor, gear, out=motor)
            link[:] = pin.aba(model, data, q, q_dot, link)
            np.multiply(acceleration, self._gain, out=acceleration)
            np.add(velocity, acceleration, out=velocity)
            np.subtract(q_dot, theta_dot, out=rates_phi)
            rates_q[:] = q_dot
            np.multiply(rates, self._steps, out=scratch)
            np.add(phi_q, scratch, out=phi_q)

    def _rub_smoothly(self, scratch: Vector) -> None:
        """Coulomb * tanh(velocity / width) + viscous * velocity."""
        rubbing, velocity = self._rubbing, self._velocity
        np.multiply(velocity, self._per_width, out=rubbing)
        np.tanh(rubbing, out=rubbing)
        np.multiply(rubbing, self._coulomb, out=rubbing)
        np.multiply(velocity, self._viscous, out=scratch)
        np.add(rubbing, scratch, out=rubbing)

    def _rub_with_stiction(self, scratch: Vector) -> None:
        """Dahl: z_dot = v - |v| z / z_max, torque = T_c z / z_max + sigma_1 z_dot, at most T_c.

        The implicit step z = (z + v h) / (1 + |v| h / z_max) keeps |z| <= z_max at any speed.
        Without LuGre's sigma_1 a joint at rest goes on swinging on its bristles and creeps away.
        """
        rubbing, velocity, z = self._rubbing, self._velocity, self._deflection
        np.negative(z, out=rubbing)
        np.multiply(velocity, self._per_presliding, out=scratch)  # z in units of z_max
        np.add(z, scratch, out=z)
        np.abs(scratch, out=scratch)
        np.add(scratch, self._one, out=scratch)
        np.divide(z, scratch, out=z)
        np.add(rubbing, z, out=rubbing)
        np.multiply(rubbing, self._bristle_damping, out=rubbing)
        np.multiply(z, self._coulomb, out=scratch)
        np.add(rubbing, scratch, out=rubbing)
        np.minimum(rubbing, self._coulomb, out=rubbing)
        np.maximum(rubbing, self._minus_coulomb, out=rubbing)
        np.multiply(velocity, self._viscous, out=scratch)
        np.add(rubbing, scratch, out=rubbing)
