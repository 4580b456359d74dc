"""Two masses per joint: the links by articulated bodies, the motors as reflected inertias."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy import (
    absolute,
    add,
    divide,
    heaviside,
    maximum,
    minimum,
    multiply,
    negative,
    positive,
    subtract,
    tanh,
)
from numpy.typing import NDArray
from pinocchio import aba

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
        stiffness, damping = np.tile((parameters.stiffness, parameters.damping), 2)
        self._phi_q = np.concatenate((np.zeros(n), parameters.initial_position))
        # [phi_dot, q_dot, q_dot, theta_dot]: the links' velocities stand twice, so that contacts
        # and friction, which meet different velocities, are worked out in one pass.
        self._rates = np.zeros(4 * n)
        self._velocity = self._rates[2 * n :]
        self._acceleration, self._applied, self._deflection = np.zeros((3, 2 * n))
        self.phi: Vector = self._phi_q[:n]
        self.q: Vector = self._phi_q[n:]
        """q - theta and link positions (n,) [rad]; views, they change with every step."""
        self.q_dot: Vector = self._velocity[:n]
        self.theta_dot: Vector = self._velocity[n:]
        """Velocities of links and motors, at the link (n,) [rad/s]; views."""
        self.external_torque: Vector = self._applied[:n]
        self.motor_torque: Vector = self._applied[n:]
        """tau_ext and tau_M (n,) [Nm]; views to write to before `advance`."""
        # [gear, stop, friction of links, friction of motors] as `strain * stiff + rates * damp`.
        self._torque = np.zeros(4 * n)
        self._strain, self._stiff, self._damp, self._scratch = np.zeros((4, 4 * n))
        self._stiff[: 2 * n], self._damp[: 2 * n] = stiffness, damping
        # Torque of the motors to change of speed in a step; the links' inertia is in their ABA.
        self._gain = step_s / np.concatenate((np.ones(n), parameters.rotor_inertia))
        # A Python float as operand costs numpy a conversion at each step; a vector does not.
        self._steps, self._none, self._one = np.full(2 * n, step_s), np.zeros(2 * n), np.ones(2 * n)
        self._per_width = np.full(2 * n, 1.0 / friction_width)
        self._per_presliding = np.full(2 * n, step_s / presliding)
        self.scale_friction(np.ones(n))
        # sigma_1 damps the swinging of each mass on its bristles to 0.7; times z_max / step, as it
        # meets the change of z in a step.
        masses = np.concatenate((parameters.lightest_link, parameters.rotor_inertia))
        sigma_1 = 1.4 * np.sqrt(parameters.coulomb / presliding * masses)
        self._bristle_damping = sigma_1 * presliding / step_s

    @property
    def theta(self) -> Vector:
        """Motor positions seen at the link (n,) [rad]."""
        return np.subtract(self.q, self.phi)

    @property
    def gear_torque(self) -> Vector:
        """What the gear hands to the link (n,) [Nm], of the last step."""
        return np.negative(self._torque[: self.n])

    @property
    def friction_torque(self) -> Vector:
        """What friction takes (2n,) [Nm], link then motor, of the last step."""
        return self._torque[2 * self.n :].copy()

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
        both, n = np.tile(factor, 2), self.n
        self._coulomb = self.parameters.coulomb * both
        self._minus_coulomb = -self._coulomb
        self._stiff[2 * n :] = self._coulomb if self._friction == "smooth" else 1.0
        self._damp[2 * n :] = self.parameters.viscous * both

    def place(self, q: Vector, phi: Vector | None = None) -> None:
        """Put the arm at rest at q (n,), with phi (n,) or in the middle of its gaps."""
        self._phi_q[self.n :] = q
        self._phi_q[: self.n] = 0.0 if phi is None else phi
        self._rates[:] = self._deflection[:] = 0.0

    def energy(self) -> float:
        """Kinetic, potential and elastic energy [J]: constant without friction and damping."""
        kinetic = pin.computeKineticEnergy(self._model, self._data, self.q, self.q_dot)
        potential = pin.computePotentialEnergy(self._model, self._data, self.q)
        rotors = 0.5 * float(self.parameters.rotor_inertia @ self.theta_dot**2)
        delta = self._phi_q - np.clip(self._phi_q, self._low, self._high)
        return (
            float(kinetic + potential) + rotors + 0.5 * float(self._stiff[: 2 * self.n] @ delta**2)
        )

    def advance(self, steps: int, external: External | None = None) -> None:
        """Integrate over `steps` steps with constant motor torque; external is asked each step."""
        # Some twenty passes over small vectors, where the calls are the cost: every name below is a
        # buffer or a view, `out` goes by position wherever numpy allows it.
        n, model, data = self.n, self._model, self._data
        phi_q, rates, velocity = self._phi_q, self._rates, self._velocity
        q, q_dot, theta_dot, tau_ext = self.q, self.q_dot, self.theta_dot, self.external_torque
        rates_phi, rates_q, rates_phi_q = rates[:n], rates[n : 2 * n], rates[: 2 * n]
        torque, strain, scratch = self._torque, self._strain, self._scratch
        gear, stop = torque[:n], torque[n : 2 * n]
        contact, rubbing = torque[: 2 * n], torque[2 * n :]
        delta, slip, moved = strain[: 2 * n], strain[2 * n :], scratch[: 2 * n]
        acceleration, gain, applied = self._acceleration, self._gain, self._applied
        link, motor = acceleration[:n], acceleration[n:]
        low, high, none, stiff, damp = self._low, self._high, self._none, self._stiff, self._damp
        slide = self._slide_smoothly if self._friction == "smooth" else self._slide_with_stiction
        for _ in range(steps):
            if external is not None:
                external(q, q_dot, tau_ext)
            maximum(phi_q, low, out=delta)
            minimum(delta, high, out=delta)
            subtract(phi_q, delta, delta)
            slide(slip)
            multiply(strain, stiff, torque)
            multiply(rates, damp, scratch)
            add(torque, scratch, torque)
            multiply(contact, delta, moved)
            heaviside(moved, none, moved)  # a border pushes, it never pulls
            multiply(contact, moved, contact)
            subtract(applied, rubbing, acceleration)
            subtract(link, gear, link)
            subtract(link, stop, link)
            add(motor, gear, motor)
            positive(aba(model, data, q, q_dot, link), link)
            multiply(acceleration, gain, acceleration)
            add(velocity, acceleration, velocity)
            subtract(q_dot, theta_dot, rates_phi)
            positive(q_dot, rates_q)
            multiply(rates_phi_q, self._steps, moved)
            add(phi_q, moved, phi_q)

    def _slide_smoothly(self, slip: Vector) -> None:
        """tanh(velocity / width), what Coulomb's torque is to be multiplied by."""
        multiply(self._velocity, self._per_width, slip)
        tanh(slip, slip)

    def _slide_with_stiction(self, slip: Vector) -> None:
        """Dahl: z_dot = v - |v| z / z_max, torque = T_c z / z_max + sigma_1 z_dot, at most T_c.

        The implicit step z = (z + v h) / (1 + |v| h / z_max) keeps |z| <= z_max at any speed.
        Without LuGre's sigma_1 a joint at rest goes on swinging on its bristles and creeps away.
        """
        z, scratch = self._deflection, self._scratch[: 2 * self.n]
        negative(z, slip)
        multiply(self._velocity, self._per_presliding, scratch)  # z in units of z_max
        add(z, scratch, z)
        absolute(scratch, scratch)
        add(scratch, self._one, scratch)
        divide(z, scratch, z)
        add(slip, z, slip)
        multiply(slip, self._bristle_damping, slip)
        multiply(z, self._coulomb, scratch)
        add(slip, scratch, slip)
        minimum(slip, self._coulomb, out=slip)
        maximum(slip, self._minus_coulomb, out=slip)
