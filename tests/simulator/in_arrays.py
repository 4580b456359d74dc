"""The plant once more, in numpy and by pinocchio: the loops are held against it."""

import numpy as np
import pinocchio as pin

from simulator.description import SimulationSettings
from simulator.mismatch import PlantParameters


class Plant:
    """`Plant` with vectors of all joints."""

    def __init__(self, parameters: PlantParameters, settings: SimulationSettings) -> None:
        p, s, n = parameters, settings, parameters.model.nv
        self.p, self.s, self.data = p, s, p.model.createData()
        self.q = p.initial_position.copy()
        self.phi, self.q_dot, self.theta_dot, self.motor, self.external = np.zeros((5, n))
        self.closed, self.z = np.zeros(n, dtype=bool), np.zeros(2 * n)
        self.scale = np.ones(2 * n)
        masses = np.concatenate((p.lightest_link, p.rotor_inertia))
        self.sigma_1 = 1.4 * np.sqrt(p.coulomb / s.presliding * masses)

    def step(self) -> None:
        p, h = self.p, self.s.step_s
        velocity = np.concatenate((self.q_dot, self.theta_dot))
        self.gear = self.border(self.phi, -p.half_gap, p.half_gap, self.q_dot - self.theta_dot)
        stop = self.border(self.q, p.lower, p.upper, self.q_dot)
        self.friction = self.slide(velocity) + self.scale * p.viscous * velocity
        link, motor = np.split(self.friction, 2)
        torque = self.external - self.gear - stop - link
        self.q_dot = self.q_dot + h * pin.aba(p.model, self.data, self.q, self.q_dot, torque)
        rotor = h / p.rotor_inertia * (self.motor + self.gear - motor)
        self.theta_dot = self.theta_dot + np.where(self.closed, 0.0, rotor)
        self.phi = self.phi + h * (self.q_dot - self.theta_dot)
        self.q = self.q + h * self.q_dot

    def border(self, x: np.ndarray, low: np.ndarray, high: np.ndarray, x_dot: np.ndarray):
        delta = x - np.clip(x, low, high)
        torque = self.p.stiffness * delta + self.p.damping * x_dot
        return np.where(torque * delta > 0.0, torque, 0.0)

    def slide(self, velocity: np.ndarray) -> np.ndarray:
        s = self.s
        share = 1.0 + (s.stribeck - 1.0) * np.exp(-((velocity / s.stribeck_velocity) ** 2))
        coulomb = self.scale * self.p.coulomb
        if s.friction == "smooth":
            return share * coulomb * np.tanh(velocity / s.friction_width)
        z, z_max = self.z, s.presliding
        self.z = (z + velocity * s.step_s) / (1.0 + np.abs(velocity) * s.step_s / (share * z_max))
        torque = coulomb * self.z / z_max + self.sigma_1 * (self.z - z) / s.step_s
        return np.clip(torque, -share * coulomb, share * coulomb)
