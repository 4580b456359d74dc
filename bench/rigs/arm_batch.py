"""Batch of arms in one plant, without a bus: contact-free motions of arms that all differ, quickly.

The links of all arms are branches of one tree, which one plant moves: what is done in Python
between its steps is done once for all of them. Servos, sensors, friction and gaps are those of the
simulator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from bench.rigs.reaching import RAMPING, Reaching
from common.arrays import Vector
from identification.motion_log import MotionLog
from simulator.description import ArmDescription, SimulationSettings
from simulator.mismatch import PlantParameters, contact
from simulator.plant import Plant
from simulator.profile import PROFILE
from simulator.sensors import Sensors
from simulator.servo import SERVO_PERIOD_S

Reference = Callable[[float], tuple[Vector, Vector]]  # Desired q, q_dot (n,) at a time [s]

Push = Callable[[float, Vector, Vector], Vector]
"""(t, q, q_dot) of the whole fleet to external joint torque [Nm]."""

POSITION_GAIN = 8.0
SETTLE_S = 0.5  # Held before the log begins: energised without current, the links drop at first


@dataclass(frozen=True, slots=True)
class Scatter:
    """Largest difference from the nominal arm: factors are log-uniform between 1/x and x."""

    friction: float = 1.5
    half_gap: float = 1.3
    rotor_inertia: float = 1.25
    torque_constant: float = 1.02
    mass: float = 1.03
    center_of_mass: float = 1.03


def random_arm(
    nominal: PlantParameters,
    scatter: Scatter,
    settings: SimulationSettings,
    rng: np.random.Generator,
) -> PlantParameters:
    """One arm of the fleet: every coefficient of every joint drawn on its own."""
    n = nominal.model.nv

    def factor(limit: float, size: int = n) -> Vector:
        factors: Vector = np.exp(np.log(limit) * rng.uniform(-1.0, 1.0, size))
        return factors

    model = nominal.model.copy()
    mass, lever = factor(scatter.mass), factor(scatter.center_of_mass)
    for i in range(n):
        body = model.inertias[i + 1]
        model.inertias[i + 1] = pin.Inertia(
            body.mass * mass[i], body.lever * lever[i], body.inertia * mass[i]
        )
    rotor = nominal.rotor_inertia * factor(scatter.rotor_inertia)
    stiffness, damping = contact(nominal.lightest_link, nominal.usual_link, rotor, settings)
    return replace(
        nominal,
        model=model,
        half_gap=nominal.half_gap * factor(scatter.half_gap),
        rotor_inertia=rotor,
        torque_constant=nominal.torque_constant * factor(scatter.torque_constant),
        coulomb=nominal.coulomb * np.tile(factor(scatter.friction), 2),
        viscous=nominal.viscous * np.tile(factor(scatter.friction), 2),
        stiffness=stiffness,
        damping=damping,
    )


def record_fleet(
    description: ArmDescription,
    arms: Sequence[PlantParameters],
    reference: Reference,
    seconds: float,
    settings: SimulationSettings,
    others: Sequence[SimulationSettings] = (),
    push: Push | None = None,
    *,
    motors_only: bool = False,
    reaching: Reaching = RAMPING,
) -> list[list[MotionLog]]:
    """Logs `[sensors][arm]` of one motion, as the sensors of `settings`, and those of each of
    `others`, report the same arms.

    The first sensors' link positions close the loop; motors_only: the motors follow the reference's
    velocity and the links are left to themselves.
    """
    n, count = len(description.joints), len(arms)
    parameters = joined(arms)
    fleet = replace(description, joints=description.joints * count)
    plant = Plant(parameters, settings.step_s, settings.law)
    start = np.tile(reference(0.0)[0], count)
    plant.place(start)
    servo = reaching.servo(fleet, parameters.usual_link)
    for joint in range(n * count):
        servo.energise(joint, 0.0)
    sensors = [Sensors(fleet, each, start) for each in (settings, *others)]
    gear = np.array([joint.gear for joint in fleet.joints])
    rated = np.array([joint.rated_current_A for joint in fleet.joints])
    scale = np.array(
        [rated * PROFILE.effort_unit, np.full_like(gear, 2 * np.pi / PROFILE.link_counts),
         PROFILE.velocity_unit / gear, 2 * np.pi / PROFILE.motor_counts / gear]
    )  # fmt: skip
    period = description.period_s
    ticks, inner = round(seconds / period), round(SERVO_PERIOD_S / settings.step_s)
    rows = np.empty((len(sensors), ticks, 5, n * count))  # setpoints last
    for k in range(-round(SETTLE_S / period), ticks):
        now = max(k, 0) * period
        for _ in range(round(period / SERVO_PERIOD_S)):
            servo.update(plant.theta_dot)
            np.multiply(parameters.torque_constant, servo.current, out=plant.motor_torque)
            if push is not None:
                plant.external_torque[:] = push(now, plant.q, plant.q_dot)
            plant.advance(inner)
            for each in sensors:
                each.update(plant.q, servo.current)
        # Row 0 is written again and again until the log begins.
        for each, row in zip(sensors, rows[:, max(k, 0)], strict=True):
            r = each.read(plant.q, plant.theta, plant.theta_dot)
            counts = (r.current, r.link_position, r.motor_velocity, r.motor_position)
            np.multiply(counts, scale, out=row[:4])
        q_d, qd_d = (np.tile(x, count) for x in reference(max(k + 1, 0) * period))
        velocity = qd_d
        if not motors_only:
            velocity = velocity + POSITION_GAIN * (q_d - rows[0, max(k, 0), 1])
        rows[:, max(k, 0), 4] = velocity
        reaching.reach(servo, velocity, period)
    time_s = period * np.arange(ticks, dtype=np.float64)
    names = tuple(joint.name for joint in description.joints)
    return [
        [
            MotionLog(names, time_s, *(rows[s, :, c, a * n : (a + 1) * n].copy() for c in range(5)))
            for a in range(count)
        ]
        for s in range(len(sensors))
    ]


def joined(arms: Sequence[PlantParameters]) -> PlantParameters:
    """One model with a branch for every arm; vectors side by side."""
    model, n = pin.Model(), arms[0].model.nv
    for a, arm in enumerate(arms):
        for i in range(1, n + 1):
            parent = arm.model.parents[i]
            joint = model.addJoint(
                parent and parent + a * n,
                arm.model.joints[i],
                arm.model.jointPlacements[i],
                f"{a}.{arm.model.names[i]}",
            )
            model.appendBodyToJoint(joint, arm.model.inertias[i], pin.SE3.Identity())

    def joined(field: str) -> Vector:
        rows = [getattr(arm, field) for arm in arms]
        halves = np.stack([row.reshape(-1, n) for row in rows], axis=1)  # (1 or 2, arms, n)
        return np.ascontiguousarray(halves.reshape(-1))

    vectors = {f: joined(f) for f in PlantParameters.__dataclass_fields__ if f != "model"}
    return PlantParameters(model=model, **vectors)


class SoftHand:
    """A hand that leads every link from beyond one border of its gap to beyond the other, and
    rests there: a `Push`. 0.9 s a visit; it carries gravity (n,), nominal at q0 (n,)."""

    def __init__(
        self, arms: Sequence[PlantParameters], q0: Vector, gravity: Vector, step_s: float
    ) -> None:
        count, n = len(arms), len(q0)
        link = np.concatenate([arm.coulomb[:n] for arm in arms])
        lightest = np.concatenate([arm.lightest_link for arm in arms])
        self._q0, self._gravity = np.tile(q0, count), np.tile(gravity, count)
        self._half_gap = np.concatenate([arm.half_gap for arm in arms])
        # Masses differ by some percent, and so does what there is to carry.
        self._strongest = np.maximum(0.05, 2.5 * link) + 0.1 * np.abs(self._gravity)
        # Its own strength moves it at half a radian per second; and no more than the step resolves.
        self._damping = np.minimum(2.0 * self._strongest, 0.3 * lightest / step_s)

    def __call__(self, t: float, q: Vector, q_dot: Vector) -> Vector:
        visit, phase = divmod(t, 0.9)
        lead = min(phase / 0.25 - 1.0, 1.0) * (1.0 if int(visit) % 2 == 0 else -1.0)
        further = 0.008 + 0.002 * np.sin(visit)
        error = self._q0 + lead * (self._half_gap + further) - q
        spring = np.clip(100.0 * self._strongest * error, -self._strongest, self._strongest)
        torque: Vector = self._gravity + spring - self._damping * q_dot
        return torque
