# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Two-mass model of each joint, link and motor, with gap, end stop and friction: one step.

Ordinary Python that also runs uncompiled; `two_masses.pxd` declares the C types (decision 0037).
Other modules use it by `Plant`.
"""

from collections.abc import Callable

import numpy as np

from common.elementary import decay, smooth_sign
from simulator.friction_law import FrictionLaw
from simulator.gears import Gears
from simulator.links import Links
from simulator.mismatch import PlantParameters


class TwoMasses:
    """State of all joints; vectors (n,) in SI units at the link. `external` and `motor` are input
    torques; `gear`, `stop` and `friction` (2, n) of link and motor are torques of the last step.
    """

    def __init__(
        self,
        links: Links,
        parameters: PlantParameters,
        step_s: float,
        law: FrictionLaw,
        gears: Gears,
    ) -> None:
        p = parameters
        n = self.n = links.n
        self.links, self.gears = links, gears
        self._step, self._stiction = step_s, law.kind == "dahl"
        self.phi, self.q_dot, self.theta_dot, self.external, self.motor = np.zeros((5, n))
        self.q = p.initial_position.copy()
        self.gear, self.stop, self._link = np.zeros((3, n))
        self.friction = np.zeros((2, n))
        self.half_gap, self._mean_half_gap = p.half_gap.copy(), p.half_gap.copy()
        self._rotor = p.rotor_inertia.copy()
        self._lower, self._upper = p.lower.copy(), p.upper.copy()
        self._stiffness, self._damping = p.stiffness.copy(), p.damping.copy()
        self.free = np.ones(n)
        """0 if a brake holds the motor, else 1."""
        # Of link and motor: friction, and bristle deflection relative to its maximum.
        self.coulomb, self.viscous = p.coulomb.reshape(2, n).copy(), p.viscous.reshape(2, n).copy()
        self.deflection = np.zeros((2, n))
        presliding = law.presliding
        self._per_slip = step_s / presliding if self._stiction else 1.0 / law.width
        self._breakaway, self._per_stribeck = law.stribeck - 1.0, 1.0 / law.stribeck_velocity
        # sigma_1 gives the oscillation of each mass on its bristles a damping ratio of 0.7; times
        # z_max / step, as it multiplies the change of z in a step.
        masses = np.stack((p.lightest_link, p.rotor_inertia))
        sigma_1 = 1.4 * np.sqrt(p.coulomb.reshape(2, n) / presliding * masses)
        self._bristle_damping = sigma_1 * presliding / step_s

    def advance(self, steps: int, touch: Callable[[], None] | None) -> None:
        """Integrate `steps` steps; `touch`, if given, writes to `external` before each."""
        for _ in range(steps):
            if touch is not None:
                touch()
            for i in range(self.n):
                self._push(i)
            self.links.accelerate(self.q, self.q_dot, self._link, self._link)
            for i in range(self.n):
                self._move(i)

    def _push(self, i: int) -> None:
        """Compute all torques on link and motor of joint i."""
        q, q_dot, theta_dot, phi = self.q[i], self.q_dot[i], self.theta_dot[i], self.phi[i]
        alpha, gears = self.half_gap[i], self.gears
        if gears.active:
            gears.update(i, q, q - phi, theta_dot)
            alpha = self.half_gap[i] = gears.half_gap(i, self._mean_half_gap[i], q)
        gear = self._border(i, phi - min(max(phi, -alpha), alpha), q_dot - theta_dot)
        stop = self._border(i, q - min(max(q, self._lower[i]), self._upper[i]), q_dot)
        self.gear[i], self.stop[i] = gear, stop
        self.friction[0, i] = self._rub(0, i, q_dot, 0.0)
        load = gears.coulomb(gear, theta_dot) if gears.active else 0.0
        self.friction[1, i] = self._rub(1, i, theta_dot, load)
        if gears.active:
            self.friction[1, i] += gears.cog(i, q - phi)
        self._link[i] = self.external[i] - gear - stop - self.friction[0, i]

    def _border(self, i: int, delta: float, delta_dot: float) -> float:
        """Torque of a unilateral spring-damper at penetration delta: it pushes, but never pulls."""
        torque = delta * self._stiffness[i] + self._damping[i] * delta_dot
        return float(torque) if torque * delta > 0.0 else 0.0

    def _rub(self, side: int, i: int, velocity: float, load: float) -> float:
        """Friction torque: Coulomb with tanh of the velocity, or Dahl's model with stiction; plus
        viscous. Near rest the Stribeck effect increases the Coulomb torque; Dahl with Stribeck is
        LuGre. load: Coulomb friction due to the torque that the gear transmits."""
        factor = self.gears.factor[side, i] if self.gears.active else 1.0
        way, coulomb = self._per_slip * velocity, factor * self.coulomb[side, i] + load
        slow = velocity * self._per_stribeck
        share = 1.0 + self._breakaway * decay(slow * slow) if self._breakaway > 0.0 else 1.0
        if self._stiction:
            torque = self._slide(side, i, way, coulomb, share)
        else:
            torque = smooth_sign(way) * (share * coulomb)
        return float(torque + factor * self.viscous[side, i] * velocity)

    def _slide(self, side: int, i: int, way: float, coulomb: float, share: float) -> float:
        """Dahl: z_dot = v - |v| z / (s z_max), torque = T_c z / z_max + sigma_1 z_dot, at most
        s T_c; s: Stribeck factor, 1 without.

        The implicit step z = (z + v h) / (1 + |v| h / (s z_max)) keeps |z| <= s z_max at any speed.
        Without LuGre's sigma_1 a joint at rest would keep oscillating on its bristles and creep.
        """
        before = self.deflection[side, i]
        z = (before + way) / (abs(way) / share + 1.0)
        self.deflection[side, i] = z
        torque = (z - before) * self._bristle_damping[side, i] + z * coulomb
        return float(max(min(torque, share * coulomb), -share * coulomb))

    def _move(self, i: int) -> None:
        """Integrate joint i by semi-implicit Euler: positions use the new velocities."""
        h = self._step
        self.q_dot[i] += h * self._link[i]
        push = self.motor[i] + self.gear[i] - self.friction[1, i]
        self.theta_dot[i] += h * self.free[i] / self._rotor[i] * push
        self.phi[i] += h * (self.q_dot[i] - self.theta_dot[i])
        self.q[i] += h * self.q_dot[i]
