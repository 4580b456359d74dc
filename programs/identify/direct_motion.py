"""Motion of the direct test of friction: each joint alone to and fro at several speeds, in poses
chosen by the model's gravity, in which it carries little, something and much."""

from collections.abc import Sequence

import numpy as np

from common.arrays import Matrix, Vector
from daemon.config.schema import Configuration, Joint
from estimator.model import Model
from identification.direct_friction import to_and_fro
from identification.excitation import point_to_point, soft_run
from programs.identify.live_arm import LiveArm
from programs.identify.measured import Measured
from programs.identify.motions import SHARE, bounds_of, slow

STEP = "direct"
_SLOWEST, _SPEEDS, _WAYS = 0.03, 4, 4  # [rad/s]; of them, of each of which there are so many ways
_EVEN_S, _RAMP_S, _ROOM = 1.5, 0.2, 0.6  # of a way, and of the range that it takes at most
_POSES, _CHANGES = 500, 0.3  # that are compared; less change of load over friction is none
_DOUBTED = "if that was you, hands off; points of then scatter more"  # no touch where friction errs
_ENOUGH = 0.6  # of what was planned, to go on after a stop: some speeds throw a link in its gap


def direct_motion(c: Configuration, model: Model, i: int, here: Vector) -> tuple[Matrix, int]:
    """Path (N, n) [rad] of joint i of an arm that stands at `here`, and number of its poses times
    that of its speeds; one row and 0 where the limits leave no room."""
    joint, period_s, bounds = c.joints[i], c.period_s, bounds_of(c).shrunk(SHARE)
    room = _ROOM * float(bounds.upper[i] - bounds.lower[i])
    tried = np.geomspace(_SLOWEST, max(bounds.velocity[i], _SLOWEST), 30).tolist()
    fits = [v for v in tried if np.ptp(_way(v, joint, period_s)) <= room]
    if not fits:
        return here[None], 0
    ways = [_way(v, joint, period_s) for v in np.geomspace(fits[0], fits[-1], _SPEEDS).tolist()]
    poses, parts = _poses(c, model, i, here, float(ways[-1][-1])), [here[None]]
    for pose in poses:
        for way in ways:
            up = np.tile(pose, (len(way), 1))
            up[:, i] += way
            parts.append(point_to_point(parts[-1][-1], up[0], slow(bounds_of(c)), period_s)[1:])
            parts += [up[1:], up[-2::-1]] * (_WAYS // 2)
    return np.vstack(parts), len(poses) * len(ways)


def _way(speed: float, joint: Joint, period_s: float) -> Vector:
    """One way [rad] about its middle: the gap, even motion, and ramps, whose acceleration is 1.5
    times the mean at most."""
    ramp_s = max(_RAMP_S, 1.5 * speed / (SHARE * joint.limits.acceleration))
    shape = speed * soft_run(_EVEN_S + ramp_s + 2.0 * joint.half_gap / speed, ramp_s, period_s)
    return np.asarray(shape - 0.5 * shape[-1])


def _poses(c: Configuration, model: Model, i: int, here: Vector, reach: float) -> list[Vector]:
    """Poses in which joint i, which goes `reach` [rad] to both sides, carries little, something and
    much; the one here where that is all the same."""
    bounds, rubs = bounds_of(c).shrunk(SHARE), c.joints[i].friction
    edge = reach * (np.arange(len(here)) == i)
    lower, upper = bounds.lower + edge, bounds.upper - edge
    poses = np.random.default_rng(1).uniform(lower, upper, (_POSES, len(here)))
    carries = np.abs([model.gravity(pose)[i] for pose in poses])
    least, most = float(carries.min()), float(carries.max())
    if most - least < _CHANGES * (rubs.motor_coulomb + rubs.link_coulomb):
        return [np.clip(here, lower, upper)]
    wanted = (least, 0.5 * (least + most), most)
    return [poses[np.abs(carries - load).argmin()] for load in wanted]


def measure_directly(arm: LiveArm, joints: Sequence[str]) -> Measured:
    """Measure joint by joint, without those that a test which was stopped has measured. Raises as
    `LiveArm.before` and `Session.run` do."""
    c, before = arm.configuration, arm.before(STEP)
    for name in joints:
        i = c.joint_names.index(name)
        path, planned = direct_motion(c, arm.model, i, arm.link_position())
        done = 0 if before is None else len(to_and_fro(before, i, 1.0, 0.0))
        if done < _ENOUGH * planned:
            between = f"{path[:, i].min():z.2f} and {path[:, i].max():z.2f} rad"
            arm.show(f"Poses within 70 % of every range; there {name} alone, between {between}. "
                     "Hands off.")  # fmt: skip
            text = f"{name} turns to and fro"
            arm.move(STEP, text, path, warning=lambda event: f"{event.text}: {_DOUBTED}")
    return arm.read(STEP)
