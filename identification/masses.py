"""Masses, centres and inertias of the joints' bodies, by least squares on the residual.

Motion determines only some combinations of the parameters (the base parameters); the others stay as
near to the URDF as physically possible bodies allow: `possible_bodies`. All joints are fitted
together, each with a friction of its own: `body_motion`.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.linalg import block_diag

from common.arrays import Matrix, Vector
from estimator.body_inertia import BodyInertia
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission
from identification.body_motion import (
    OFFSET,
    BodyMotion,
    body_motion,
    rows_of_joints,
    with_friction,
)
from identification.body_rows import (
    CORRELATED_S,
    LASTING_S,
    BodiesFit,
    JointRows,
    fitted,
    unbent,
    without_bodies,
)
from identification.coupling import coupled
from identification.friction_verdict import saturated, unexcited, wider
from identification.gravity_errors import GravityErrors, gravity_errors
from identification.log_intervals import Mask, play
from identification.motion_log import MotionLog
from identification.possible_bodies import off_center, possible, prior
from identification.regression import GAIN, HELD_OUT, NORMAL_95
from identification.touches import near

SHORTEST_S = 20.0
"""Least motion [s], unless less is requested."""
_ROUNDS = 3
_WORSE = 1.02  # times the held-out |r| by the URDF, from which on a fit is worse: less is noise
_NOTHING = 0.001  # of Coulomb friction, by which |r| may grow in any case
_NO_FIT = 1.1  # the same, if nothing is better and the URDF's masses stay
_WORTH, _AS_SURE = 0.9, 0.5  # the same of some joint: if masses changed clearly, or not
_UNKNOWN = 0.5  # of gravity's error by the URDF, that may remain over all poses
_MATTERS = 0.1  # of Coulomb friction: gravity that is known so well needs no motion
_UNLIKELY = 3.0  # factor on the URDF's gravity, up or down, that masses cannot explain


class MassesVerdict(StrEnum):
    """Verdict on one joint; unless all are `good`, all joints keep their masses."""

    GOOD = "good"
    AS_GOOD = "the URDF is as good"
    NOT_EXCITED = "not excited"
    SATURATED = "current saturated"
    WRONG_GAP = "the gap is wider"
    COUPLED = "coupled with another joint"
    WRONG_GRAVITY = "current and gravity disagree"
    WORSE = "worse on held-out motion"
    SWINGS = "swings by itself"


@dataclass(frozen=True, slots=True, kw_only=True)
class MassesFit:
    """Result for one joint: rms of |r| [Nm] on held-out motion, by the URDF's bodies and by those
    found, with friction fitted alike."""

    joint: str
    verdict: MassesVerdict
    reason: str
    """Explanation with the figures; empty if it is good."""
    body: BodyInertia | None
    """None if the URDF has no mass between this joint and the next"""
    by_urdf: float
    by_this: float
    errors: Vector | None = None
    """Standard errors (10,) of the body's parameters, by the URDF where motion shows no more"""

    @property
    def good(self) -> bool:
        """True if the masses found, or the URDF's, are right."""
        return self.verdict in (MassesVerdict.GOOD, MassesVerdict.AS_GOOD)


@dataclass(frozen=True, slots=True)
class Masses:
    """Fits of all joints, which are used together or not at all."""

    fits: list[MassesFit]
    determined: int
    """Combinations of the `parameters` that the motion determines better than the URDF does"""
    parameters: int
    touched: tuple[str, ...]
    """Joints that a person touched"""
    discarded_s: float
    """time discarded because of these touches [s]"""
    late: Vector
    """Delay of each link encoder behind the motor's (n,) [s]; 0 if it does not show"""
    offset: Vector
    """Constant torque (n,) [Nm] in the current that nothing explains; 0 without one"""

    @property
    def usable(self) -> bool:
        """True if every joint is good."""
        return all(fit.verdict is MassesVerdict.GOOD for fit in self.fits)


def identify_masses(
    log: MotionLog, model: Model, transmission: Transmission, settings: EstimatorSettings,
    max_current: Vector, limits: tuple[Vector, Vector], shortest_s: float = SHORTEST_S,
) -> Masses:  # fmt: skip
    """Bodies of all joints from contact-free motion.

    model: by the URDF alone; transmission: identified half-gaps, and initial friction; max_current
    (n,) [A]; limits: lower and upper (n,) [rad], between which gravity has to be known. Raises
    LogError for a log of less than `shortest_s`.
    """
    width = transmission.sign_width
    motion = body_motion(log, model, settings, max_current, width, shortest_s)
    by_urdf = model.parameters()
    massive = np.flatnonzero(by_urdf[:, 0] > 0.0)  # links without mass in the URDF get none
    nominal = np.array([possible(row) for row in by_urdf[massive]])  # (k, 10)
    bodies = motion.regressor[:, :, massive].reshape(len(motion.rows.dt), log.n, -1)
    shift = bodies @ (nominal - by_urdf[massive]).ravel()
    all_rows, period_s = np.ones(len(bodies), dtype=np.bool_), motion.rows.period_s

    def rounds(offset: Mask) -> tuple[list[JointRows], BodiesFit, Mask, Transmission]:
        """Rows and fit; each round locates the gap with the friction of the previous one, and
        leaves out what that could not explain."""
        t, touched = transmission, np.zeros_like(motion.cut)
        for _ in range(_ROUNDS):
            joints = rows_of_joints(motion, bodies, t, settings, touched, offset)
            joints = [replace(one, torque=one.torque - shift[:, i]) for i, one in enumerate(joints)]
            fit = fitted(joints, all_rows, nominal, period_s)
            touched = motion.touched(joints, *unbent(joints, all_rows, nominal, period_s))
            t = with_friction(t, fit.friction)
        return joints, fit, touched, t

    # A constant current offset looks like gravity, and vice versa: held-out motion separates them.
    none, every = np.zeros(log.n, dtype=np.bool_), np.ones(log.n, dtype=np.bool_)
    joints, fit, touched, known = rounds(none)
    left = _rms(_held_out(joints, nominal, period_s)[1])
    with_offset = _rms(_held_out(rounds(every)[0], nominal, period_s)[1])
    offset = with_offset < _WORTH * left
    if offset.any():
        joints, fit, touched, known = rounds(offset)
    gravity = gravity_errors(model, nominal, massive, limits, fit)
    reasons = _reasons(log, motion, joints, fit, known, gravity)
    found = {i: BodyInertia.of(x) for i, x in zip(massive.tolist(), fit.parameters, strict=True)}
    errors = _errors(nominal, fit)
    others = (np.abs(fit.parameters - nominal) > 2.0 * NORMAL_95 * errors).any()
    fits = _judged(log.joints, joints, nominal, period_s, found, reasons, known.engaged_coulomb,
                   _WORTH if others else _AS_SURE)  # fmt: skip
    for i, error in zip(massive.tolist(), errors, strict=True):
        fits[i] = replace(fits[i], errors=error)
    return Masses(
        fits,
        _determined(nominal, fit),
        nominal.size,
        tuple(log.joints[i] for i in np.flatnonzero(touched.any(axis=0))),
        float(motion.rows.dt @ near(motion.rows, touched)),
        np.array([one.late for one in joints]),
        np.array([x[OFFSET] for x in fit.friction]),
    )


Reason = tuple[MassesVerdict, str]


def _reasons(
    log: MotionLog, motion: BodyMotion, joints: list[JointRows], fit: BodiesFit, t: Transmission,
    gravity: GravityErrors,
) -> list[Reason]:  # fmt: skip
    """Reasons why joints cannot be judged by their fit; `good` where there is none."""
    left = np.stack(
        [one.left(fit.difference, x) for one, x in zip(joints, fit.friction, strict=True)], axis=1
    )
    weight = np.stack([one.weight for one in joints], axis=1)
    late = np.array([one.late for one in joints])
    coulomb, moved = t.engaged_coulomb, play(motion.rows, late)
    pairs = coupled(left, weight, coulomb, motion.rows, t.sign_width, GAIN)
    found: list[Reason] = []
    for i in range(log.n):
        share, before, scale = gravity.share[i], gravity.before[i], gravity.scale[i]
        if about := unexcited(motion.rows.theta_dot[:, i]):
            found.append((MassesVerdict.NOT_EXCITED, about))
        elif about := saturated(float(motion.cut[:, i].mean())):
            found.append((MassesVerdict.SATURATED, about))
        elif about := wider(float(moved[i]), float(t.half_gap[i])):
            found.append((MassesVerdict.WRONG_GAP, about))
        elif (rubs := fit.friction[i][0]) < 0.0 or np.ptp(log.current[:, i]) <= 0.0:
            about = (f"friction comes out as {rubs:.2g} Nm: check column, sign and unit of the "
                     "current")  # fmt: skip
            found.append((MassesVerdict.WRONG_GRAVITY, about))
        elif i in pairs:
            about = (f"its residual follows the motion of {log.joints[pairs[i]]}, and vice versa: "
                     "give positions and currents of the joints, not of the motors")  # fmt: skip
            found.append((MassesVerdict.COUPLED, about))
        elif share > _UNKNOWN and before > _MATTERS * coulomb[i]:
            about = (f"the motion leaves {share:.0%} of gravity's possible error within the "
                     f"limits, {before:.2g} Nm: let this joint and those behind it move "
                     "further")  # fmt: skip
            found.append((MassesVerdict.NOT_EXCITED, about))
        elif before > _MATTERS * coulomb[i] and not 1.0 < _UNLIKELY * scale < _UNLIKELY**2:
            about = (f"the motor carries {scale:.2g} times the URDF's gravity: check sign and "
                     "unit of the current, and `torque_constant`")  # fmt: skip
            found.append((MassesVerdict.WRONG_GRAVITY, about))
        else:
            found.append((MassesVerdict.GOOD, ""))
    return found


def _judged(
    names: tuple[str, ...], joints: list[JointRows], nominal: Matrix, period_s: float,
    bodies: dict[int, BodyInertia], reasons: list[Reason], coulomb: Vector, least: float,
) -> list[MassesFit]:  # fmt: skip
    """Fits with their verdicts, from the errors on the end of the motion by a fit to the rest, and
    on its beginning likewise; coulomb (n,) [Nm]; least: times |r| by the URDF, to be worth it."""
    by_urdf, by_this = _held_out(joints, nominal, period_s)
    worth = bool((_rms(by_this) < least * _rms(by_urdf)).any())
    most, fits = _WORSE if worth else _NO_FIT, []
    for i, against in enumerate(reasons):
        verdict, reason = against
        bound = np.maximum(most * by_urdf[:, i], by_urdf[:, i] + _NOTHING * coulomb[i])
        worse = ~(by_this[:, i] <= bound)  # NaN, too: too little counted
        if verdict is MassesVerdict.GOOD and worse.any():
            k, verdict = int(np.argmax(worse)), MassesVerdict.WORSE
            reason = (f"|r| {by_this[k, i]:.3g} Nm, by the URDF {by_urdf[k, i]:.3g}, on the "
                      f"{('last', 'first')[k]} third of the motion by a fit to the rest: run a "
                      "longer motion (`--seconds`) over the whole range")  # fmt: skip
        elif verdict is MassesVerdict.GOOD and not worth:
            verdict = MassesVerdict.AS_GOOD
        fits.append(
            MassesFit(
                joint=names[i], verdict=verdict, reason=reason, body=bodies.get(i),
                by_urdf=float(_rms(by_urdf)[i]), by_this=float(_rms(by_this)[i]),
            )
        )  # fmt: skip
    return fits


def _rms(parts: Matrix) -> Vector:
    return np.asarray(np.sqrt(np.square(parts).mean(axis=0)))


def _held_out(joints: list[JointRows], nominal: Matrix, period_s: float) -> tuple[Matrix, Matrix]:
    """rms [Nm] of the residual by nominal bodies and by found ones, (2, n) each: on the end of the
    motion by a fit to the rest, and on its beginning likewise."""
    size = len(joints[0].torque)
    place = np.arange(size) / size
    by_nominal, by_found = [], []
    for tested in (place >= 1.0 - HELD_OUT, place < HELD_OUT):
        fit = fitted(joints, ~tested, nominal, period_s)
        none = np.zeros_like(fit.difference)
        usual = without_bodies(joints, ~tested)
        pairs = zip(joints, usual, strict=True)
        by_nominal.append([one.rms(none, x, tested) for one, x in pairs])
        pairs = zip(joints, fit.friction, strict=True)
        by_found.append([one.rms(fit.difference, x, tested) for one, x in pairs])
    return np.array(by_nominal), np.array(by_found)


def _errors(nominal: Matrix, fit: BodiesFit) -> Matrix:
    """Standard errors (k, 10) by what no column explains, the prior, and what motion leaves of
    displaced centres: with motion H, prior P, C = 1 / (H + P) and the centres' displacements S,
    those of C (t H + P) C and (1 - C H) S. The first lasts t times as long as the filter's
    noise."""
    inverse = np.linalg.inv(fit.information)
    lasting = (LASTING_S / CORRELATED_S - 1.0) * fit.of_motion
    covariance = inverse @ (fit.information + lasting) @ inverse
    centers = block_diag(*map(off_center, nominal))
    left = centers - inverse @ fit.of_motion @ centers
    errors = np.sqrt(np.diag(covariance) + np.square(left).sum(axis=1))
    return np.asarray(errors.reshape(nominal.shape))


def _determined(nominal: Matrix, fit: BodiesFit) -> int:
    """Number of directions of the parameters that motion determines better than the prior does."""
    root = np.linalg.cholesky(np.linalg.inv(prior(nominal)))
    return int(np.count_nonzero(np.linalg.eigvalsh(root.T @ fit.of_motion @ root) > 1.0))
