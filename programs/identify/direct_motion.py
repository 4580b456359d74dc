"""Motion of the direct friction test: one joint at a time moves to and fro at several speeds, in
poses in which the model's gravity load on it is small, medium and large."""

from collections.abc import Sequence

import numpy as np

from common.arrays import Matrix, Vector
from daemon.config.schema import Configuration, Joint
from estimator.model import Model
from identification.direct_friction import grouped_strokes
from identification.excitation import point_to_point, smooth_path_times
from programs.identify.live_arm import LiveArm
from programs.identify.measured import Measured
from programs.identify.motions import SHARE, bounds_of, slow

STEP = "direct"
_SLOWEST, _SPEEDS, _STROKES = 0.03, 4, 4  # least speed [rad/s], number of speeds, strokes at each
_EVEN_S, _RAMP_S, _ROOM = 1.5, 0.2, 0.6  # constant speed, least ramp, largest share of the range
_POSES, _CHANGES = 500, 0.3  # poses compared; least change of load that counts, over friction
_DOUBTED = "if that was you, hands off; points of then scatter more"  # or friction is off there
_ENOUGH = (
    0.6  # share of planned points that completes a joint: some speeds toss the link in its gap
)


def direct_motion(c: Configuration, model: Model, i: int, here: Vector) -> tuple[Matrix, int]:
    """Path (N, n) [rad] for joint i of an arm at `here`, and the number of its poses times speeds;
    one row and 0 if the limits leave no room."""
    joint, period_s, bounds = c.joints[i], c.period_s, bounds_of(c).shrunk(SHARE)
    room = _ROOM * float(bounds.upper[i] - bounds.lower[i])
    tried = np.geomspace(_SLOWEST, max(bounds.velocity[i], _SLOWEST), 30).tolist()
    fits = [v for v in tried if np.ptp(_stroke(v, joint, period_s)) <= room]
    if not fits:
        return here[None], 0
    speeds = np.geomspace(fits[0], fits[-1], _SPEEDS).tolist()
    strokes = [_stroke(v, joint, period_s) for v in speeds]
    poses, parts = _poses(c, model, i, here, float(strokes[-1][-1])), [here[None]]
    for pose in poses:
        for stroke in strokes:
            up = np.tile(pose, (len(stroke), 1))
            up[:, i] += stroke
            parts.append(point_to_point(parts[-1][-1], up[0], slow(bounds_of(c)), period_s)[1:])
            parts += [up[1:], up[-2::-1]] * (_STROKES // 2)
    return np.vstack(parts), len(poses) * len(strokes)


def _stroke(speed: float, joint: Joint, period_s: float) -> Vector:
    """Stroke in one direction [rad] about its centre: ramp, gap, constant speed, ramp. The ramps'
    peak acceleration is at most 1.5 times their mean."""
    ramp_s = max(_RAMP_S, 1.5 * speed / (SHARE * joint.limits.acceleration))
    shape = speed * smooth_path_times(
        _EVEN_S + ramp_s + 2.0 * joint.half_gap / speed, ramp_s, period_s
    )
    return np.asarray(shape - 0.5 * shape[-1])


def _poses(c: Configuration, model: Model, i: int, here: Vector, reach: float) -> list[Vector]:
    """Poses with small, medium and large gravity load on joint i, which moves by `reach` [rad] to
    both sides; only the present pose if the load hardly varies."""
    bounds, friction = bounds_of(c).shrunk(SHARE), c.joints[i].friction
    edge = reach * (np.arange(len(here)) == i)
    lower, upper = bounds.lower + edge, bounds.upper - edge
    poses = np.random.default_rng(1).uniform(lower, upper, (_POSES, len(here)))
    carries = np.abs([model.gravity(pose)[i] for pose in poses])
    least, most = float(carries.min()), float(carries.max())
    if most - least < _CHANGES * (friction.motor_coulomb + friction.link_coulomb):
        return [np.clip(here, lower, upper)]
    wanted = (least, 0.5 * (least + most), most)
    return [poses[np.abs(carries - load).argmin()] for load in wanted]


def measure_directly(arm: LiveArm, joints: Sequence[str]) -> Measured:
    """Measure joint by joint, skipping those that an interrupted test has already measured. Raises
    as `LiveArm.before` and `Session.run` do."""
    c, before = arm.configuration, arm.before(STEP)
    for name in joints:
        i = c.joint_names.index(name)
        path, planned = direct_motion(c, arm.model, i, arm.link_position())
        done = 0 if before is None else len(grouped_strokes(before, i, 1.0, 0.0))
        if done < _ENOUGH * planned:
            between = f"{path[:, i].min():z.2f} and {path[:, i].max():z.2f} rad"
            arm.show(f"Poses within 70 % of every range; there {name} alone, between {between}. "
                     "Hands off.")  # fmt: skip
            text = f"{name} turns to and fro"
            arm.move(STEP, text, path, warning=lambda event: f"{event.text}: {_DOUBTED}")
    return arm.read(STEP)
