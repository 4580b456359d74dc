"""Plant of two masses per joint: links by articulated bodies, motors as reflected inertias."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy import (
    absolute,
    add,
    divide,
    dot,
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

from arrays import Matrix, Vector
from simulator.mismatch import PlantParameters

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
        # [phi, q, q_dot, theta_dot], and what changes the velocities: [q_dotdot, motors' torque].
        self._present = np.zeros(6 * n)
        self._phi_q, self._velocity = self._present[: 2 * n], self._present[2 * n : 4 * n]
        self._phi_q[n:] = parameters.initial_position
        self.phi: Vector = self._phi_q[:n]
        self.q: Vector = self._phi_q[n:]
        """q - theta and link positions (n,) [rad]; views, they change with every step."""
        self.q_dot: Vector = self._velocity[:n]
        self.theta_dot: Vector = self._velocity[n:]
        """Velocities of links and motors, at the link (n,) [rad/s]; views."""
        # [gear, stop, friction of links, friction of motors, external, motors]
        self._torque = np.zeros(6 * n)
        self.external_torque: Vector = self._torque[4 * n : 5 * n]
        self.motor_torque: Vector = self._torque[5 * n :]
        """tau_ext and tau_M (n,) [Nm]; views to write to before `advance`."""
        # The first four of them are `strain * stiff + damped`.
        self._strain, self._stiff = np.zeros((2, 4 * n))
        self._stiff[: 2 * n] = np.tile(parameters.stiffness, 2)
        self._deflection, self._scratch = np.zeros((2, 2 * n))
        # A Python float as operand costs numpy a conversion at each step; a vector does not.
        self._none, self._one = np.zeros(2 * n), np.ones(2 * n)
        self._per_slip = step_s / presliding if friction == "dahl" else 1.0 / friction_width
        self._closed = np.zeros(n, dtype=np.bool_)
        self._net = _net(n)
        # The state after a step, then `damped` and what `slide` starts from.
        self._after = np.zeros(10 * n)
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
        """Torque of the gear on the link (n,) [Nm], of the last step."""
        return np.negative(self._torque[: self.n])

    @property
    def friction_torque(self) -> Vector:
        """Torque of friction (2n,) [Nm], link then motor, of the last step."""
        return self._torque[2 * self.n : 4 * self.n].copy()

    @property
    def in_gap(self) -> NDArray[np.bool_]:
        """True where link and motor do not touch (n,)."""
        return np.asarray(np.abs(self.phi) < self.parameters.half_gap)

    def brake(self, joint: int, closed: bool) -> None:
        """Close or open a joint's brake; a closed one holds the motor where it is."""
        self._closed[joint] = closed
        if closed:
            self.theta_dot[joint] = 0.0
        self._compose()

    def scale_friction(self, factor: Vector) -> None:
        """Make the friction of each joint, both sides, `factor` (n,) times its own from now on."""
        both, n = np.tile(factor, 2), self.n
        self._coulomb = self.parameters.coulomb * both
        self._minus_coulomb = -self._coulomb
        self._stiff[2 * n :] = self._coulomb if self._friction == "smooth" else 1.0
        self._viscous = self.parameters.viscous * both
        self._compose()

    def place(self, q: Vector, phi: Vector | None = None) -> None:
        """Put the arm at rest at q (n,), with phi (n,) or in the middle of its gaps."""
        self._phi_q[self.n :] = q
        self._phi_q[: self.n] = 0.0 if phi is None else phi
        self._velocity[:] = self._deflection[:] = 0.0

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
        # A dozen passes over small vectors, where the calls are the cost: every name below is a
        # buffer or a view, `out` goes by position wherever numpy allows it.
        n, model, data = self.n, self._model, self._data
        present, after, net, flow = self._present, self._after, self._net, self._flow
        phi_q, q, q_dot, tau_ext = self._phi_q, self.q, self.q_dot, self.external_torque
        state, pushes, link = present[: 4 * n], present[4 * n :], present[4 * n : 5 * n]
        torque, strain, moved = self._torque, self._strain, self._scratch
        inner, contact = torque[: 4 * n], torque[: 2 * n]
        delta, slip = strain[: 2 * n], strain[2 * n :]
        low, high, none, stiff = self._low, self._high, self._none, self._stiff
        state_after, damped = after[: 4 * n], after[4 * n : 8 * n]
        slide = self._slide_smoothly if self._friction == "smooth" else self._slide_with_stiction
        dot(self._derived, state, after[4 * n :])  # others may have written to the velocities
        for _ in range(steps):
            if external is not None:
                external(q, q_dot, tau_ext)
            maximum(phi_q, low, out=delta)
            minimum(delta, high, out=delta)
            subtract(phi_q, delta, delta)
            slide(slip)
            multiply(strain, stiff, inner)
            add(inner, damped, inner)
            multiply(contact, delta, moved)
            heaviside(moved, none, moved)  # a border pushes, it never pulls
            multiply(contact, moved, contact)
            dot(net, torque, pushes)
            positive(aba(model, data, q, q_dot, link), link)
            dot(flow, present, after)
            positive(state_after, state)

    def _compose(self) -> None:
        """The linear part of a step, as two products.

        `_flow` (10n, 6n): from the state and what pushes, the state after the step, and of that the
        damping torques of all contacts and frictions, and the velocities as `slide` wants them;
        `_derived` (6n, 4n): those from a state that was written from outside.
        """
        n, h, p = self.n, self.step_s, self.parameters
        phi, q, q_dot, theta_dot, q_dotdot, pushed = np.eye(6 * n).reshape(6, n, 6 * n)
        slips = np.full(2 * n, self._per_slip)
        factors = np.concatenate((p.damping, p.damping, self._viscous, slips))[:, None]
        free = np.where(self._closed, 0.0, 1.0 / p.rotor_inertia)[:, None]

        def derived(q_dot: Matrix, theta_dot: Matrix) -> Matrix:
            rates = (q_dot - theta_dot, q_dot, q_dot, theta_dot, q_dot, theta_dot)
            return np.asarray(factors * np.vstack(rates))

        self._derived = derived(q_dot, theta_dot)[:, : 4 * n].copy()
        q_dot, theta_dot = q_dot + h * q_dotdot, theta_dot + h * free * pushed
        phi, q = phi + h * (q_dot - theta_dot), q + h * q_dot
        self._flow = np.vstack((phi, q, q_dot, theta_dot, derived(q_dot, theta_dot)))

    def _slide_smoothly(self, slip: Vector) -> None:
        """tanh(velocity / width), the factor of Coulomb's torque."""
        tanh(self._after[8 * self.n :], slip)

    def _slide_with_stiction(self, slip: Vector) -> None:
        """Dahl: z_dot = v - |v| z / z_max, torque = T_c z / z_max + sigma_1 z_dot, at most T_c.

        The implicit step z = (z + v h) / (1 + |v| h / z_max) keeps |z| <= z_max at any speed.
        Without LuGre's sigma_1 a joint at rest goes on swinging on its bristles and creeps away.
        """
        z, way, scratch = self._deflection, self._after[8 * self.n :], self._scratch
        negative(z, slip)
        add(z, way, z)  # in units of z_max
        absolute(way, scratch)
        add(scratch, self._one, scratch)
        divide(z, scratch, z)
        add(slip, z, slip)
        multiply(slip, self._bristle_damping, slip)
        multiply(z, self._coulomb, scratch)
        add(slip, scratch, slip)
        minimum(slip, self._coulomb, out=slip)
        maximum(slip, self._minus_coulomb, out=slip)


def _net(n: int) -> Matrix:
    """The sum of all torques on the links and on the motors, (2n, 6n): the gear pushes both."""
    gear, stop, link_friction, motor_friction, external, motor = np.eye(6 * n).reshape(6, n, 6 * n)
    links = external - gear - stop - link_friction
    return np.vstack((links, motor + gear - motor_friction))
