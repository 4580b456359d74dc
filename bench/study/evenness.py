"""How even an arm feels in a hand: force at the hand, joint by joint, over a path of ten poses.

The hand leads the whole arm from pose to pose and, at each, every joint by itself. What a joint
asks for is the torque while it is led, over its lever: the force of a hand that holds the tool.
"""

from dataclasses import dataclass

import msgspec
import numpy as np

from arrays import Matrix
from bench.rigs.lockstep import lockstep_rig
from bench.study.leading import lead
from daemon.commands.gain import balance_of
from daemon.config.motion import limits_of
from daemon.config.schema import Configuration
from daemon.motion.balance import levers
from estimator.model import Model

POSES = 10
# Of each joint's range, in its middle: nobody leads an arm from stop to stop.
SHARE = 0.6
STROKE_RAD = 0.2


@dataclass(frozen=True, slots=True)
class Evenness:
    """Forces at the hand (poses, joints) [N] that joints ask for, each led alone."""

    led: Matrix  # while it is led
    peak: Matrix  # on the way, setting out included

    @property
    def ratio(self) -> float:
        """Largest of all forces on the way, of the smallest."""
        return float(self.led.max() / self.led.min())

    @property
    def ratio_at_a_pose(self) -> float:
        """The same at one pose; the worst one."""
        return float((self.led.max(axis=1) / self.led.min(axis=1)).max())


def path_of(c: Configuration, seed: int) -> Matrix:
    """The poses (POSES, n) [rad]."""
    limits = limits_of(c)
    middle, half = (limits.lower + limits.upper) / 2.0, (limits.upper - limits.lower) / 2.0
    offsets = np.random.default_rng(seed).uniform(-SHARE, SHARE, (POSES, len(c.joints)))
    path: Matrix = middle + half * offsets
    return path


def balanced_of(c: Configuration, urdf: str) -> Configuration:
    """The arm with the gains that `contactctl gain --balance` proposes."""
    gains = balance_of(c, urdf).gain.tolist()
    joints = [
        msgspec.structs.replace(joint, admittance_gain=gain)
        for joint, gain in zip(c.joints, gains, strict=True)
    ]
    return msgspec.structs.replace(c, joints=joints)


def evenness(c: Configuration, speed: float, seed: int) -> Evenness:
    """Lead the simulated Romeo arm, configured as `c`, over the path."""
    with lockstep_rig(
        configure=lambda _: unbounded(c),
        simulate=lambda s: msgspec.structs.replace(s, seed=seed),
    ) as rig:
        rig.enable()
        rig.run(1.0)
        if reasons := rig.permit("the bench"):
            raise AssertionError(reasons)
        model = Model(rig.robot.urdf, c.joint_names)
        middle = path_of(c, seed).mean(axis=0)
        led, peak = [], []
        for pose in path_of(c, seed):
            lead(rig, dict(enumerate(pose.tolist())), speed)
            rows = []
            for i in range(len(c.joints)):
                q = rig.arm.plant.q.copy()
                goal = float(q[i] + np.copysign(STROKE_RAD, middle[i] - q[i]))
                (row_,) = lead(rig, {i: goal}, speed)[1]
                q[i] = goal - np.copysign(0.25 * STROKE_RAD, goal - q[i])  # where it counts
                lever = levers(model.tool_jacobian(q)[np.newaxis])[0, i]
                rows.append((row_.usual_nm / lever, row_.peak_nm / lever))
            led.append([each[0] for each in rows])
            peak.append([each[1] for each in rows])
        return Evenness(np.array(led), np.array(peak))


def unbounded(c: Configuration) -> Configuration:
    """The arm with a short quiet time and no end of being led: it is led for minutes."""
    admittance = msgspec.structs.replace(
        c.admittance, quiet_s=0.5, max_duration_s=3600.0, max_excursion=1e3
    )
    return msgspec.structs.replace(c, admittance=admittance)
