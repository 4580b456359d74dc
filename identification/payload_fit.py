"""Mass and centre of a load in the hand, by least squares on the residual of the model without it.

A point mass m at c adds torques linear in m and m c, except for its m c c^T, which is small and
taken from the previous fit. Friction and rotor of each joint are fitted, too, as a load changes
friction; and so are the errors of the arm's own bodies: else a load of which 2 % of the shoulder's
torque are a tenth would be reported with an error far below that.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from common.arrays import Matrix, Vector
from estimator.body_inertia import PARAMETERS, point_mass
from estimator.model import Model
from estimator.payload import FURTHEST_M, HEAVIEST_KG
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission
from identification.body_motion import body_motion, rows_of_joints, with_friction
from identification.body_rows import REWEIGHTED, JointRows, Normal, summed
from identification.friction_verdict import saturated, unexcited
from identification.log_intervals import Mask
from identification.motion_log import MotionLog
from identification.possible_bodies import USUAL, possible, prior
from identification.touches import near

SHORTEST_S = 8.0
"""Least motion [s]."""
_ROUNDS = 4
_LINEAR = 4  # parameters: m and m c
_SIGNIFICANT = 4.0  # standard errors from zero
_MASS_SHARE = 0.1
_MASS_KG = 0.005
_PLACE_M = 0.03
_STOOD = "the joints hardly moved: let them turn the hand and move it about"
_HIDDEN = (
    "the joints that moved cannot separate mass and place of a load: let others turn the hand "
    "(`limits`), or weigh the load and announce it by `contactctl payload KG --com X Y Z`"
)


class PayloadVerdict(StrEnum):
    """Verdict on a load; only a good one is written."""

    GOOD = "good"
    NOTHING = "no load"
    NOT_EXCITED = "not excited"
    SATURATED = "current saturated"
    IMPOSSIBLE = "no load of a hand"


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadFit:
    """Load [kg], its centre (3,) in the hand's frame [m], and their standard errors."""

    verdict: PayloadVerdict
    reason: str
    mass: float
    com: Vector
    mass_error: float
    com_error: float
    touched: tuple[str, ...]
    """Joints that a person touched"""
    discarded_s: float


def identify_payload(
    log: MotionLog,
    model: Model,
    transmission: Transmission,
    settings: EstimatorSettings,
    max_current: Vector,
    bodies_error: float,
) -> PayloadFit:
    """Load in the hand during a motion without contact; model: that of the empty hand.

    max_current (n,) [A]; bodies_error: relative error of the bodies that the joints move. Raises
    LogError for a log of less than `SHORTEST_S`.
    """
    width = transmission.sign_width
    motion = body_motion(log, model, settings, max_current, width, SHORTEST_S)
    of_hand = motion.regressor[:, :, model.hand_joint]
    all_rows, touched = np.ones(len(of_hand), dtype=np.bool_), np.zeros_like(motion.cut)
    period_s, load = motion.rows.period_s, np.zeros(PARAMETERS)
    arm, before = _bodies(motion.regressor, model, bodies_error)
    asked = np.concatenate([of_hand[:, :, :_LINEAR], arm], axis=2)
    no_offset = np.zeros(log.n, dtype=np.bool_)
    for _ in range(_ROUNDS):
        joints = rows_of_joints(motion, asked, transmission, settings, touched, no_offset)
        bent = of_hand[:, :, _LINEAR:] @ load[_LINEAR:]
        joints = [replace(one, torque=one.torque - bent[:, i]) for i, one in enumerate(joints)]
        found, information = _solved(joints, all_rows, period_s, before)
        if found is None:
            break
        load = point_mass(float(found[0]), found[1:_LINEAR] / found[0])
        friction = [Normal(one, all_rows).friction(found) for one in joints]
        touched = motion.touched(joints, found, friction)
        transmission = with_friction(transmission, friction)
    discarded_s = float(motion.rows.dt @ near(motion.rows, touched))
    by_hand = tuple(log.joints[i] for i in np.flatnonzero(touched.any(axis=0)))
    none = PayloadFit(
        verdict=PayloadVerdict.NOT_EXCITED, reason="", mass=float("nan"), com=np.full(3, np.nan),
        mass_error=float("inf"), com_error=float("inf"), touched=by_hand, discarded_s=discarded_s,
    )  # fmt: skip
    cut = motion.cut.mean(axis=0)
    worst = int(np.argmax(cut))
    if about := saturated(float(cut[worst])):
        about = f"{log.joints[worst]}: {about}. A load that its motor does not hold shows nothing"
        return replace(none, verdict=PayloadVerdict.SATURATED, reason=about)
    if found is None:
        still = all(unexcited(theta_dot) for theta_dot in motion.rows.theta_dot.T)
        return replace(none, reason=_STOOD if still else _HIDDEN)
    mass_error, com_error = _errors(joints, information, found, period_s, before)
    com = model.in_hand(found[1:_LINEAR] / found[0])
    fit = replace(
        none, mass=float(found[0]), com=com, mass_error=mass_error, com_error=com_error
    )  # fmt: skip
    verdict, reason = _verdict(fit)
    return replace(fit, verdict=verdict, reason=reason)


def _bodies(regressor: Matrix, model: Model, unsure: float) -> tuple[Matrix, Matrix]:
    """Regressor of the arm's own bodies (N, n, 10 k), and the prior information (4 + 10 k, ...) on
    load and bodies: none on the load."""
    parameters = model.parameters()
    massive = np.flatnonzero(parameters[:, 0] > 0.0)
    known = prior(np.array([possible(row) for row in parameters[massive]]))
    before = np.zeros((_LINEAR + len(known), _LINEAR + len(known)))
    before[_LINEAR:, _LINEAR:] = known * (USUAL / unsure) ** 2
    arm = regressor[:, :, massive].reshape(*regressor.shape[:2], -1)
    return arm, before


def _solved(
    joints: list[JointRows], chosen: Mask, period_s: float, before: Matrix
) -> tuple[Vector | None, Matrix]:
    """m, m c [kg, kg m] and errors of bodies, by the chosen rows; None if these do not determine
    the load; and the information (4 + 10 k, ...)."""
    normals = [Normal(one, chosen) for one in joints]
    found = np.zeros(len(before))
    for _ in range(REWEIGHTED):
        square, product = summed(normals, found, period_s)
        values = np.linalg.eigvalsh(square[:_LINEAR, :_LINEAR])
        if not values[0] > 1e-9 * values[-1] > 0.0:
            return None, square
        found = np.asarray(np.linalg.solve(square + before, product), dtype=np.float64)
    return (found if abs(found[0]) > 1e-6 else None), square + before


def _errors(
    joints: list[JointRows], information: Matrix, found: Vector, period_s: float, before: Matrix
) -> tuple[float, float]:
    """Standard errors of mass [kg] and centre [m]: by noise, by errors of the arm's bodies, and by
    the difference between both halves of the motion."""
    size = len(joints[0].torque)
    halves = [
        _solved(joints, chosen, period_s, before)[0]
        for chosen in (np.arange(size) < size // 2, np.arange(size) >= size // 2)
    ]
    if any(half is None for half in halves):
        return float("inf"), float("inf")
    one, other = (_mass_and_place(half) for half in halves if half is not None)
    apart = 0.5 * np.abs(one - other)
    # c = (m c) / m: an error of m moves it, too.
    covariance = np.linalg.inv(information)[:_LINEAR, :_LINEAR]
    slope = np.hstack([-found[1:_LINEAR, None] / found[0], np.eye(3)]) / found[0]
    place = slope @ covariance @ slope.T
    mass_error = float(np.hypot(np.sqrt(covariance[0, 0]), apart[0]))
    return mass_error, float(np.hypot(np.sqrt(np.trace(place)), np.linalg.norm(apart[1:])))


def _mass_and_place(found: Vector) -> Vector:
    return np.append(found[0], found[1:_LINEAR] / found[0])


def _verdict(fit: PayloadFit) -> tuple[PayloadVerdict, str]:
    if not np.isfinite(fit.mass_error):
        return PayloadVerdict.NOT_EXCITED, "half of the motion shows nothing of the load"
    about = f"{fit.mass:.3g} +- {fit.mass_error:.2g} kg"
    if fit.mass < -_SIGNIFICANT * fit.mass_error:
        return PayloadVerdict.NOT_EXCITED, (
            f"{about}: the arm is lighter than its model: `contactd identify masses`, with an "
            "empty hand"
        )
    if fit.mass < _SIGNIFICANT * fit.mass_error:
        return PayloadVerdict.NOTHING, f"{about}: the hand is empty, as far as the motion shows"
    if fit.mass_error > _MASS_SHARE * fit.mass + _MASS_KG or fit.com_error > _PLACE_M:
        return PayloadVerdict.NOT_EXCITED, (
            f"{about}, its centre within {1e3 * fit.com_error:.0f} mm: a longer motion "
            "(`--seconds`) in which the hand turns; or the arm's masses are wrong: "
            "`contactd identify masses` with an empty hand"
        )
    if fit.mass > HEAVIEST_KG or np.abs(fit.com).max() > FURTHEST_M:
        place = " ".join(f"{x:.2f}" for x in fit.com)
        return PayloadVerdict.IMPOSSIBLE, f"{about} at ({place}) m of the hand's frame"
    return PayloadVerdict.GOOD, ""
