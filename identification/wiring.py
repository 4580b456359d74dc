"""Check that motor velocity, link position and current of a joint agree in sign and scale, with
each other and with the URDF's gravity. A wrong sign means positive feedback in motion."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from estimator.model import Model
from identification.motion_log import MotionLog
from identification.wiring_strokes import LEAST_MOTION, PIECE, between, follows_by, strokes_in

SCALE_TOLERANCE = 0.05
GRAVITY_TOLERANCE = 0.25
# Deviation from 1 of the ratio of reported to requested torque, and its largest error: in sum less
# than that of 14 Nm read as 17.
_RANGE_TOLERANCE, _RANGE_SURE = 0.1, 0.06
_BOUNCES = 0.3  # relative deviation that a light link's motion may show
_POSES = 200
_PRODUCT = 0.02  # deviation from 1 of the product of two ratios of swapped gears
# Deviation of the ratio from 1, and its difference between strokes, beyond which a link may float
# and hide a wrong gear.
_SURE, _ALIKE = 0.025, 0.06
_ALIKE_CURRENT = 0.7  # correlation of a current with the motion that is asked for


OTHER_WAY = (
    "the link moves opposite to the motor: link_sign or motor_sign is wrong in its `wiring` "
    "(motor_sign, if `identify zero` found the link's)"
)
# Samples per piece of motion; share of its motor's motion from which on a link moves; share of the
# motor's motion against which a link with a wrong sign moves.
_BLOCK, _MOVES, _AGAINST = 10, 0.3, 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class WiringResult:
    """Result of moving one joint to and fro; passed if nothing is wrong or undetermined."""

    joint: str
    problems: tuple[str, ...]
    undetermined: tuple[str, ...] = ()
    """Required quantities that this motion does not show, and what to do"""
    notes: tuple[str, ...] = ()
    """Checks that were not possible, with the reason"""
    follows: float = float("nan")
    """Link motion over motor motion while the gear is engaged: 1"""
    friction: float = float("nan")
    """Half the difference of the torques in both directions [Nm]; positive"""
    held: float = float("nan")
    """Their mean [Nm]: gravity by K_c times current"""
    gravity: float = float("nan")
    """Gravity by the URDF [Nm]"""

    @property
    def passed(self) -> bool:
        return not self.problems and not self.undetermined


def check_wiring(log: MotionLog, joint: int, model: Model, torque_constant: float) -> WiringResult:
    """Check of one joint, from a log in which only this joint was driven, slowly, in both
    directions, through its gap."""
    name = log.joints[joint]
    steps = np.diff(log.time_s, prepend=log.time_s[0] - log.period_s)
    theta = np.cumsum(log.motor_velocity[:, joint] * steps)
    turned = float(np.ptp(theta))
    if turned < LEAST_MOTION:
        return _did_not_turn(log, joint, turned, torque_constant)
    problems = [*_current_stays(log.current[:, joint]), *_position_disagrees(log, joint, theta)]
    strokes = strokes_in(log, joint)
    if not follows_both_ways(log, joint):
        moved = np.ptp(log.link_position, axis=0)
        other = int(np.argmax(moved))
        about = (f"the motor turned {1e3 * turned:.3g} mrad, and its link did not follow it both "
                 f"ways (it moved {1e3 * moved[joint]:.2g} mrad)")  # fmt: skip
        if other != joint and moved[other] > PIECE:
            about += f"; {log.joints[other]} moved {1e3 * moved[other]:.3g}: are they swapped?"
        else:
            about += (f": wrong gear, link_position object or scale, or a half-gap of more than "
                      f"{1e3 * (0.5 * turned - PIECE):.0f} mrad")  # fmt: skip
        return WiringResult(joint=name, problems=(*problems, about))
    engaged = np.zeros(len(theta), dtype=np.bool_)
    for stroke in strokes:
        engaged[stroke.rows] |= stroke.carried
    follows, (least, most) = follows_by(strokes), between(strokes)
    notes, undetermined = list[str](), list[str]()
    if follows < 0.0:
        problems.append(OTHER_WAY)
    elif abs(follows - 1.0) > SCALE_TOLERANCE + most - least:
        problems.append(
            f"the link moves {follows:.3f} times as far as the motor reports: gear, or a scale"
        )
    elif abs(follows - 1.0) > SCALE_TOLERANCE:
        undetermined.append(
            f"the link moves {least:.3f} to {most:.3f} times as far as the motor reports: it "
            "floats in its gap, which hides whether gear and scales are right; repeat it, and "
            "brake the link a little with a finger, or choose a pose in which gravity acts on it"
        )
    friction, held, gravity = _torques(log, joint, model, torque_constant, engaged)
    noise = _noise(torque_constant * log.current[:, joint])
    if friction < -2.0 * noise:
        problems.append(
            f"torque is {-2 * friction:.3g} Nm less in the direction of motion than against it: "
            "the sign of the current is wrong"
        )
    elif friction < 2.0 * noise:
        notes.append("too little friction to see the sign of the current")
    allowed = GRAVITY_TOLERANCE * abs(gravity) + 0.3 * abs(friction)
    # With a wrong motor_sign the current has the wrong sign, too.
    off = min(abs(held - gravity), abs(held + gravity) if follows < 0.0 else np.inf)
    if off > allowed:
        problems.append(
            f"the current holds {in_Nm(held)}, gravity is {in_Nm(gravity)} by the URDF: "
            "torque_constant, object, scale or torque_max_Nm of the current, link_offset, masses, "
            "or another joint than this one moved"
        )
    elif abs(gravity) < abs(friction):
        most = _most_gravity(model, joint)
        swapped = ", nor whether drives are swapped (did this joint move?)" if log.n > 1 else ""
        why = (f"a pose shows it in which the joint carries more, up to {in_Nm(most)}"
               if most > abs(friction) else "gravity hardly acts on this joint")  # fmt: skip
        notes.append(f"K_c is not checked{swapped}: {why}")
    return WiringResult(joint=name, problems=tuple(problems), undetermined=tuple(undetermined),
                  notes=tuple(notes), follows=follows, friction=friction, held=held,
                  gravity=gravity)  # fmt: skip


def with_torque_range(found: WiringResult, ratio: float, error: float) -> WiringResult:
    """Result with the range of the motor's torque, which no register reports. ratio: torque
    reported over torque that its loop was asked for; error of that."""
    if error > _RANGE_SURE:
        note = "torque_max_Nm is not checked: friction and load move its torque by too little"
        return replace(found, notes=(*found.notes, note))
    if abs(ratio - 1.0) <= _RANGE_TOLERANCE + error:
        return found
    problem = (
        f"its torque reads {ratio:.2f} times what its stiffness and damping give: torque_max_Nm "
        f"(about {1.0 / ratio:.2f} times as much), or another model"
    )
    return replace(found, problems=(*found.problems, problem))


def swapped_pairs(follows: Mapping[str, float]) -> list[tuple[str, str]]:
    """Pairs of joints whose ratios of link to motor motion are both off, with a product of 1: the
    gears of two joints whose drives are swapped."""
    off = {
        name: ratio
        for name, ratio in follows.items()
        if ratio > 0.0 and abs(ratio - 1.0) > SCALE_TOLERANCE
    }
    pairs = itertools.combinations(off, 2)
    return [(a, b) for a, b in pairs if abs(off[a] * off[b] - 1.0) < _PRODUCT]


def _did_not_turn(log: MotionLog, joint: int, turned: float, constant: float) -> WiringResult:
    """Result for a motor that turned by so little [rad], by its drive or by what holds it."""
    about = f"the motor turned only {1e3 * turned:.2g} mrad at the link"
    if pressed := _held_by_friction(log, joint):
        about += (f", but pressed with {in_Nm(constant * pressed)} along its setpoints: its "
                  "drive obeys, and friction holds it, or a brake that is closed: raise the gains "
                  "of its velocity loop by the maker's tool (docs/porting.md, step 8)")  # fmt: skip
        return WiringResult(joint=log.joints[joint], problems=(), undetermined=(about,))
    about += ": does the drive get its setpoints, is the unit of motor_velocity right?"
    return WiringResult(joint=log.joints[joint], problems=(about,))


def _held_by_friction(log: MotionLog, joint: int) -> float:
    """Current [A] with which a standing motor pressed along its setpoints; 0 if it did not."""
    if log.setpoint is None or np.ptp(log.link_position[:, joint]) > LEAST_MOTION:
        return 0.0
    steps = np.diff(log.time_s, prepend=log.time_s[0])
    asked, current = np.cumsum(log.setpoint[:, joint] * steps), log.current[:, joint]
    moved = np.ptp(asked) > 0.0 and np.ptp(current) > 0.0
    alike = moved and np.corrcoef(asked, current)[0, 1] > _ALIKE_CURRENT
    return float(0.5 * np.ptp(current)) if alike else 0.0


def _current_stays(current: Vector) -> list[str]:
    """Problem of a current that does not change while the motor turns to and fro."""
    if np.ptp(current) > 0.0:
        return []
    return [f"the current read {current[0]:.3g} A throughout, even while the motor turned: its "
            "object is a limit, a rated or another set value, not a measurement"]  # fmt: skip


def _position_disagrees(log: MotionLog, joint: int, theta: Vector) -> list[str]:
    """Problem of a motor position that disagrees with its velocity."""
    if log.motor_position is None:
        return []
    position = log.motor_position[:, joint] - log.motor_position[0, joint]
    turned = theta - theta[0]
    scale = float(position @ turned / (turned @ turned))
    if abs(scale - 1.0) <= SCALE_TOLERANCE + _half_a_count(log.motor_velocity[:, joint]):
        return []
    about = f"motor_position changes {scale:.3g} times as much as by motor_velocity"
    return [f"{about}: a scale, or velocity_max"]


def _half_a_count(velocity: Vector) -> float:
    """Largest relative error of a steady velocity by its resolution: half a count."""
    counts = np.diff(np.unique(velocity.round(6)))
    fast = float(np.percentile(np.abs(velocity), 90.0))
    return 0.5 * float(counts.min()) / fast if len(counts) and fast > 0.0 else 0.0


def follows_both_ways(log: MotionLog, joint: int) -> bool:
    """True if the motor went so far in both directions that its link followed."""
    return {s.upward for s in strokes_in(log, joint) if s.carried} == {True, False}


def scale_uncertain(log: MotionLog, joint: int) -> bool:
    """True if the link's ratio deviates by no more than an encoder error over so short a motion, or
    a link that bounces or floats, may cause, or differs between directions: move it once more."""
    strokes = strokes_in(log, joint)
    least, most = between(strokes)
    off = abs(follows_by(strokes) - 1.0)
    return _SURE < off < _BOUNCES or (off <= _SURE and most - least > _ALIKE)


def in_Nm(torque: float) -> str:
    """Torque [Nm] as text, rounded to a mNm."""
    return f"{round(torque, 3) + 0.0:.3g} Nm"


def share_of_motor(log: MotionLog, joint: int) -> tuple[float, bool]:
    """Motion of the link over that of its motor, in a log that ends when they are too far apart;
    True if it moved in the opposite direction, and did not just fall back through its gap."""
    steps = np.diff(log.time_s, prepend=log.time_s[0])
    theta = np.cumsum(log.motor_velocity[:, joint] * steps)[::_BLOCK]
    turned, moved = np.diff(theta), np.diff(log.link_position[::_BLOCK, joint])
    total = float(np.abs(turned).sum()) + 1e-12
    against = moved * np.sign(turned) < -_MOVES * np.abs(turned)
    share = float(moved @ np.sign(turned)) / total
    return share, bool(np.abs(turned[against]).sum() > _AGAINST * total)


def _torques(
    log: MotionLog, joint: int, model: Model, torque_constant: float, engaged: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Half the difference, and mean, of the torques in both directions; the URDF's gravity [Nm]."""
    torque, velocity = torque_constant * log.current[:, joint], log.motor_velocity[:, joint]
    ways = [engaged & (velocity > 0.0), engaged & (velocity < 0.0)]
    if not all(way.any() for way in ways):
        return float("nan"), float("nan"), float("nan")
    up, down = (float(np.median(torque[way])) for way in ways)
    rows = np.flatnonzero(engaged)[:: max(1, int(engaged.sum()) // 50)]
    gravity = float(np.mean([model.gravity(log.link_position[k])[joint] for k in rows]))
    return 0.5 * (up - down), 0.5 * (up + down), gravity


def _most_gravity(model: Model, joint: int) -> float:
    """Largest gravity of the joint over a fixed set of random poses within its limits [Nm]."""
    poses = np.random.default_rng(0).uniform(model.lower, model.upper, (_POSES, len(model.lower)))
    return float(max(abs(model.gravity(q)[joint]) for q in poses))


def _noise(torque: Vector) -> float:
    """Noise of single samples [Nm], from the differences between neighbours."""
    return float(1.4826 * np.median(np.abs(np.diff(torque))) / np.sqrt(2.0))
