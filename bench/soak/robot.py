"""The arm of a soak, and the hand that is on it: seven joints that all move, motor positions
integrated from velocities, brakes that hold what is not energised."""

from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np
import yaml

from bench.rigs.lockstep import ROMEO
from common.arrays import Vector
from daemon.config.load import Robot
from daemon.config.schema import Configuration, Joint
from daemon.faults.plausibility import GAP_TOLERANCE
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.hand_script import AnyAct, Guide, Hold, Push, Release
from simulator.mismatch import true_parameters
from simulator.servo import Servo

# Amplitude [rad] and frequency [Hz] per joint: incommensurable, so that all poses are met.
MOTION: Final = {
    "LShoulderPitch": (0.35, 0.15),
    "LShoulderYaw": (0.15, 0.23),
    "LElbowRoll": (0.5, 0.19),
    "LElbowYaw": (0.3, 0.29),
    "LWristRoll": (0.6, 0.13),
    "LWristYaw": (0.2, 0.31),
    "LWristPitch": (0.4, 0.37),
}
AMPLITUDE = 0.5  # of MOTION's


def write_robot(folder: Path, stale_ticks: int = 3) -> Path:
    """A copy of Romeo's arm in `folder`, changed to be soaked; returns the folder."""
    folder.mkdir()
    for file in ROMEO.iterdir():
        if file.name != "third_experiment.yaml":
            (folder / file.name).write_bytes(file.read_bytes())
    path = folder / "config.yaml"
    c: dict[str, Any] = yaml.safe_load(path.read_text())
    c["trajectory"]["sinusoids"] = {
        name: {"amplitude": AMPLITUDE * amplitude, "frequency_Hz": frequency}
        for name, (amplitude, frequency) in MOTION.items()
    }
    c["estimator"]["motor_position"] = "integrated"
    c["estimator"]["beside"] = []
    c["supervisor"]["stale_ticks"] = stale_ticks
    for joint in c["joints"]:
        # A drive that is reset lets go for a moment; nothing lifts the arm up again.
        joint["end"] = "brake"
    path.write_text(yaml.safe_dump(c, sort_keys=False))
    return folder


def strongest(joint: Joint) -> float:
    """Torque of the hand [Nm]: up to 40 % of the drive's, but above the threshold."""
    drive = joint.torque_constant * joint.wiring.max_current_A
    return max(0.4 * drive, 2.0 * joint.thresholds.contact)


def gives_way(robot: Robot) -> Vector:
    """Largest way (n,) [rad] that the hand may press the joints beyond where the daemon holds them.

    At most, the velocity loop of the simulated drive gives way to it like a spring, and like a
    damper to the blow of a link that the hand has driven through the gap; the daemon then leads the
    joint back. Besides, the daemon's gap is only as good as its tolerance.
    """
    simulation = read_simulation(robot)
    description = describe(robot, simulation)
    link = true_parameters(description, simulation.settings).usual_link
    servo = Servo(description, link)
    torque = np.array([strongest(joint) for joint in robot.configuration.joints])
    gap = np.array([2.0 * joint.half_gap for joint in robot.configuration.joints])
    momentum = np.sqrt(2.0 * torque * gap * link)
    unknown = (GAP_TOLERANCE - 1.0) * gap
    return np.asarray(torque / servo.stiffness + momentum / servo.damping + unknown)


def hand_script(rng: Random, c: Configuration, seconds: float) -> tuple[AnyAct, ...]:
    """Pushes, guiding and holding, each followed by some quiet."""
    acts: list[AnyAct] = []
    at_s = 4.0
    while at_s < seconds:
        kind = rng.choices(("push", "guide", "hold"), (6, 3, 1))[0]
        joint = rng.choice(c.joints)
        most = strongest(joint)
        if kind == "push":
            strength = rng.uniform(1.2 * joint.thresholds.contact, most)
            push = Push(
                at_s=at_s,
                joint=joint.name,
                torque=rng.choice((-1, 1)) * strength,
                duration_s=rng.uniform(0.1, 2.0),
                shape=rng.choice(("step", "ramp", "pulse")),
            )
            acts.append(push)
            at_s += push.duration_s
        else:
            grip = {"stiffness": 40.0, "damping": 2.0, "max_torque": most}
            reach = rng.uniform(-0.1, 0.1) + rng.choice((joint.limits.lower, joint.limits.upper))
            goal = {joint.name: rng.choice((reach, rng.uniform(-0.5, 0.5)))}
            speed = rng.uniform(0.1, 0.5)
            acts.append(
                Guide(at_s=at_s, to=goal, speed=speed, **grip)
                if kind == "guide"
                else Hold(at_s=at_s, joints=(joint.name,), **grip)
            )
            at_s += rng.uniform(1.0, 8.0)
            acts.append(Release(at_s=at_s))
        at_s += 0.5 + rng.expovariate(1 / 6.0)
    return tuple(acts)
