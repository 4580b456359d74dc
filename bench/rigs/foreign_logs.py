"""Logs of strangers' arms: CSV files as other programs write them, and the truth behind them.

An arm of `generated_arms` moves in the simulator, and what it measured is written with names,
units, rates and faults of another program: skew, jitter, pauses, vibration, eccentric encoders.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from bench.rigs.arm_batch import Push, record_fleet
from bench.rigs.generated_arms import URDF, GeneratedArm, generate
from bench.study.masses import EXACT, along, carrying, wrongly_weighed
from common.arrays import Matrix, Vector
from daemon.config.load import load_robot
from estimator.payload import Payload
from identification.motion_log import MotionLog
from programs.identify.motions import bounds_of, excitation
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.description import SimulationSettings
from simulator.mismatch import PlantParameters, true_parameters

FINE_S: Final = 0.002  # of what is written at other rates
_TURN: Final = 2.0 * np.pi


@dataclass(frozen=True, slots=True)
class Stranger:
    """An arm, its fine log, and the truth."""

    arm: GeneratedArm
    log: MotionLog
    truth: PlantParameters
    bodies: Matrix
    """(n, 10) parameters of what the joints move, without a load"""

    @property
    def friction(self) -> Vector:
        """Coulomb friction of motor and link together (n,) [Nm]."""
        rows: Vector = self.truth.coulomb.reshape(2, -1).sum(axis=0)
        return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """Format in which another program writes a log."""

    rate_Hz: float = 100.0
    late_s: dict[str, float] = field(default_factory=dict)
    """of `current` or `motor_velocity` behind the positions"""
    jitter: float = 0.0
    """of the period, a standard deviation"""
    pauses: int = 0
    without: tuple[str, ...] = ()
    """quantities that are not in it"""
    torque: bool = False
    """in the place of currents"""
    degrees: bool = False
    eccentric: float = 0.0
    """amplitude of the link encoders' error, once a turn, and half of it 3 and 5 times [rad]"""
    vibration: tuple[float, float] = (0.0, 1.0)
    """of the torque, in shares of each joint's friction, at a frequency [Hz]"""
    one_encoder: bool = False  # whose change the velocities are
    longest_s: float = np.inf
    seed: int = 0


def stranger(
    seed: int, seconds: float, folder: Path, push: Push | None = None, load_kg: float = 0.0,
    *, by_urdf: bool = True,
) -> Stranger:  # fmt: skip
    """Arm of a seed, moved for some seconds, without contact unless pushed, with a load at its tool
    point; its files go to a folder; its masses are those of its URDF, or not. Its
    gears are softer than its data sheets have it, or not."""
    arm = generate(seed)
    robot = load_robot(arm.write(folder))
    description = replace(describe(robot, read_simulation(robot)), period_s=FINE_S)
    settings = SimulationSettings(mismatch=EXACT, seed=seed)
    truth = true_parameters(description, settings)
    softer = np.random.default_rng((seed, 37)).uniform(0.25, 1.0, len(truth.stiffness))
    truth = replace(truth, stiffness=truth.stiffness * softer)
    if not by_urdf:
        truth = wrongly_weighed(truth, np.random.default_rng((seed, 41)))
    bodies = np.array([body.toDynamicParameters() for body in truth.model.inertias[1:]])
    if load_kg:
        load = Payload.of(load_kg, robot.model.tool_place.tolist())
        truth = carrying(truth, robot.model, load)
    motion = excitation(bounds_of(robot.configuration), robot.model, FINE_S, seed)
    path = motion.path(motion.motion.at(np.zeros(1))[0][0], seconds)
    ((log,),) = record_fleet(
        description, [truth], along(path, FINE_S), len(path) * FINE_S, settings, push=push
    )
    return Stranger(arm, log, truth, bodies)


def write_csv(of: Stranger, style: Style, path: Path) -> Path:
    """Write the log as a CSV with names such as `shoulder_pos_deg`; returns its path."""
    fine, rng = of.log, np.random.default_rng((style.seed, 31))
    step = 1.0 / style.rate_Hz
    t = np.arange(fine.time_s[0] + 0.05, fine.time_s[-1] - 0.05, step)
    t = t[t <= t[0] + style.longest_s]
    t = np.sort(t + style.jitter * step * rng.standard_normal(len(t)))
    for begin in rng.uniform(t[0], t[-1] - 3.0, style.pauses):
        t = t[(t < begin) | (t > begin + 2.0)]

    def at(values: Matrix, late_s: float = 0.0) -> Matrix:
        return np.stack([np.interp(t - late_s, fine.time_s, each) for each in values.T], axis=1)

    current = at(fine.current, style.late_s.get("current", 0.0))
    share, hertz = style.vibration
    shakes = np.sin(_TURN * hertz * t)[:, None] * share * of.friction / of.truth.torque_constant
    q = at(fine.link_position)
    change = np.gradient(fine.link_position, fine.time_s, axis=0)
    velocity = change if style.one_encoder else fine.motor_velocity
    wobble = np.cos(q + 1.0) + 0.5 * np.cos(3.0 * q) + 0.5 * np.sin(5.0 * q)
    angle, unit = (np.degrees, "deg") if style.degrees else (np.asarray, "rad")
    assert fine.motor_position is not None
    columns = {
        "pos": angle(q + style.eccentric * wobble),
        "motor_pos": angle(at(fine.motor_position)),
        "vel": angle(at(velocity, style.late_s.get("motor_velocity", 0.0))),
        "tau" if style.torque else "cur":
            (current + shakes) * (of.truth.torque_constant if style.torque else 1.0),
    }  # fmt: skip
    names, values = ["timestamp"], [t]
    for i, joint in enumerate(of.log.joints):
        for name, rows in columns.items():
            if name not in style.without:
                names.append(f"{joint}_{name}" + (f"_{unit}" if "pos" in name else ""))
                values.append(rows[:, i])
    np.savetxt(path, np.stack(values, axis=1), delimiter=",", header=",".join(names),
               comments="", fmt="%.9g")  # fmt: skip
    return path


def urdf_of(of: Stranger, folder: Path) -> Path:
    """URDF of the arm, as a file of a folder."""
    path = folder / URDF
    path.write_text(of.arm.urdf, encoding="utf-8")
    return path
