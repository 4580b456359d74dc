"""Plant, servo and sensors once more, in numpy and by pinocchio: the loops are held against it."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from simulator.description import ArmDescription, SimulationSettings
from simulator.mismatch import PlantParameters
from simulator.profile import PROFILE, TURN


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


class Servo:
    """`Servo` with vectors of all joints, all of them on; its gains are those of another."""

    def __init__(self, description: ArmDescription, damping: np.ndarray) -> None:
        joints = description.joints
        self.kp = damping / np.array([joint.torque_constant for joint in joints])
        self.limit = np.array([joint.max_current_A for joint in joints])
        self.target, self.reference, self.rate, self.integral = np.zeros((4, len(joints)))

    def update(self, velocity: np.ndarray) -> np.ndarray:
        self.reference = self.reference + np.clip(
            self.target - self.reference, -self.rate, self.rate
        )
        error = self.reference - velocity
        self.integral = self.integral + 0.02 * self.kp * error
        wanted = self.kp * error + self.integral
        current = np.clip(wanted, -self.limit, self.limit)
        self.integral = self.integral + current - wanted
        return current


class Sensors:
    """`Sensors` with vectors of all joints."""

    def __init__(self, description: ArmDescription, settings: SimulationSettings) -> None:
        self.s = settings
        self.gear, self.rated = (
            np.array([getattr(joint, name) for joint in description.joints])
            for name in ("gear", "rated_current_A")
        )
        self.rng = np.random.default_rng((settings.seed, 1))
        self.q: list[np.ndarray] = []
        self.current = np.zeros(len(self.gear))

    def update(self, q: np.ndarray, current: np.ndarray) -> None:
        self.q.append(q)
        share = 1.0 - np.exp(-1.0 / self.s.current_filter_ms)
        self.current = self.current + share * (current - self.current)

    def read(self, plant: Plant) -> SimpleNamespace:
        """After that many milliseconds that link positions can be late."""
        s, profile = self.s, PROFILE
        whole, share = divmod(s.link_latency_ms, 1.0)
        newer, older = self.q[-int(whole) - 1], self.q[-int(whole) - 2]
        late = newer + share * (older - newer) if s.link_latency_ms else plant.q
        noise = self.rng.standard_normal((2, len(late)))
        velocity = plant.theta_dot * (1.0 + s.velocity_scale_error) + s.velocity_bias
        velocity = (velocity + s.velocity_noise * noise[0]) * self.gear
        permille = self.current / self.rated / profile.effort_unit
        permille = permille + s.current_noise_permille * noise[1]
        return SimpleNamespace(
            link_position=np.rint(late * profile.link_counts / TURN + profile.link_zero),
            motor_position=np.rint((plant.q - plant.phi) * self.gear * profile.motor_counts / TURN),
            motor_velocity=np.rint(velocity / profile.measured_velocity_unit),
            current=np.rint(np.clip(permille, -32768.0, 32767.0)),
        )
