"""Friction and rotor inertia by least squares on the residual, (8)-(11) with their misprints
corrected: `docs/estimator.md` has the table.

    r_nl = low_pass(d(M q_dot)/dt - beta - tau_M) = -tau_mu - B theta_ddot         engaged
    r_nl = low_pass(d(M q_dot)/dt - beta)         = -tau_mu                        in the gap

Engaged, motor and link friction act together, and only their sum K_theta is identifiable (the
columns of the two have a condition number in the thousands). Link friction K_q shows separately
only in the gap, and there poorly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import LogError
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission
from identification.coupling import coupled
from identification.friction_errors import with_model_errors
from identification.friction_fit import FrictionFit, adopt
from identification.friction_verdict import Verdict, verdict_on, wider
from identification.log_intervals import Intervals, Mask, intervals, locate, play
from identification.motion_log import MotionLog
from identification.own_loop import rotors_of_whole_periods
from identification.regression import COLUMNS, GAIN, Solution, regression, solve, solve_joint
from identification.setpoint_steps import (
    NO_SETPOINTS,
    OR_MASSES,
    STEP_GAIN,
    STEPS,
    hidden,
    missed,
    stepping,
)
from identification.sticking import held
from identification.touches import near

SHORTEST_S = 10.0
"""Least motion [s], unless less is requested."""
_ROUNDS = 3
_SPARSE = 50  # intervals per pose at which the links' inertia is sampled
_B = COLUMNS.index("B")
_SHOWS = 0.3
"""Least change of gravity that is evaluated, as a share of Coulomb friction."""
_LEAST = 1e-3
"""Least change for a joint without friction, such as one without torque in the log [Nm]."""
_NOTHING = (
    "it came out as zero, which is impossible: a current that is later than "
    "estimator.current_delay_ms hides it; B keeps its value"
)
_OF_OTHERS = (
    "its `torque_constant` is a guess, copied from other joints: look it up, and remove the mark"
)
_UNFILTERED = (
    "the drives do not filter their current (estimator.current_delay_ms is 0), and it is sampled "
    "between two steps: B keeps its value"
)


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """r_nl and its reconstruction (14), (N, n) [Nm], and phi (N, n) [rad], for plots."""

    time_s: Vector
    r_nl: Matrix
    reconstructed: Matrix
    phi: Matrix
    touched: tuple[str, ...]
    """Joints that a person touched"""
    discarded_s: float
    """time discarded because of these touches [s]"""
    late: Vector
    """Delay of each link encoder behind the motor's (n,) [s]; 0 if it does not show"""


def identify_friction(
    log: MotionLog,
    model: Model,
    transmission: Transmission,
    settings: EstimatorSettings,
    max_current: Vector,
    shortest_s: float = SHORTEST_S,
    *,
    weighed: bool = False,
    by_urdf: Model | None = None,
    makes: Sequence[str] = (),
    guessed: Vector | None = None,
) -> tuple[list[FrictionFit], Reconstruction]:
    """Coefficients of every joint from contact-free motion.

    transmission: identified half-gaps, and initial friction; max_current (n,) [A]; weighed: the
    model has identified masses; by_urdf: the model before that; makes: of the joints' drives, as
    drives of one make step, or ramp, alike; by default a single one; guessed: shares (n,) by which
    guessed torque constants may be off, infinite where nothing shows them. Raises LogError for a
    log of less than `shortest_s`.
    """
    if log.measured_s + log.period_s < shortest_s - 1e-6:
        raise LogError(
            f"the log is too short: {log.measured_s:.1f} s, at least {shortest_s:g} s of motion"
        )
    rows = intervals(log, model, settings)
    cut: Mask = np.abs(rows.current) > 0.98 * max_current
    touched = np.zeros_like(cut)
    sticking, unknown = held(rows, transmission.sign_width)
    # Each round locates the gap with the friction of the last, and omits what that did not explain.
    for _ in range(_ROUNDS):
        where = locate(rows, transmission, settings)
        found = regression(rows, transmission, where, sticking)
        alpha, spoilt = transmission.half_gap.tolist(), near(rows, touched)
        solved = [
            solve_joint(i, found, rows, alpha[i], where, cut, spoilt, unknown) for i in range(log.n)
        ]
        touched = np.stack([one.touched for one in solved], axis=1)
        moved = play(rows, where.late).tolist()
        fits = [
            _judged(log.joints[i], i, one, rows, transmission, cut, moved[i], settings)
            for i, one in enumerate(solved)
        ]
        transmission = adopt(transmission, fits)
    before = None if by_urdf is None else intervals(log, by_urdf, settings)
    guessed = np.zeros(log.n) if guessed is None else guessed
    unknown_constant = ~np.isfinite(guessed)
    fits = with_model_errors(
        fits, solved, found, rows, model, weighed=weighed, by_urdf=before,
        guessed=np.where(unknown_constant, 0.0, guessed),
    )  # fmt: skip
    fits = [
        replace(fit, verdict=Verdict.NO_CONSTANT, reason=_OF_OTHERS) if unknown_ else fit
        for fit, unknown_ in zip(fits, unknown_constant, strict=True)
    ]
    fits = _uncoupled(fits, solved, rows, transmission.sign_width)
    if log.setpoint is None:
        fits = [replace(fit, rotor_doubt=fit.rotor_doubt or NO_SETPOINTS) for fit in fits]
    else:
        quick = regression(rows, transmission, where, sticking, STEP_GAIN)
        more, error = missed(quick, solved, rows)

        def refit(corrected: Intervals) -> Vector:
            again = regression(corrected, transmission, where, sticking)
            return np.array([
                solve(again.columns[:, i], again.nuisance[:, i], again.r_nl[:, i], one.weight,
                      np.isfinite(one.errors), rows.time_s)[0][_B]
                for i, one in enumerate(solved)
            ])  # fmt: skip

        rotors = np.full(log.n, np.nan)
        steps = stepping(more, error, makes or [""] * log.n)
        if steps.any():
            links = np.median([model.inertia(q) for q in rows.q[::_SPARSE]], axis=0)
            fitted = np.array([fit.values.get("B", 0.0) for fit in fits])
            delay_s = 1e-3 * settings.current_delay_ms
            constants = transmission.torque_constant
            rotors = rotors_of_whole_periods(log, rows, fitted, links, constants, delay_s, refit)
        fits = _doubted(fits, steps, hidden(more, error), rotors, weighed=weighed)
    shown = np.stack([found.columns[:, i] @ s.coefficients for i, s in enumerate(solved)], axis=1)
    by_hand = tuple(log.joints[i] for i in np.flatnonzero(touched.any(axis=0)))
    discarded_s = float(rows.dt @ near(rows, touched))
    return fits, Reconstruction(
        rows.time_s, found.r_nl, shown, where.phi, by_hand, discarded_s, where.late
    )


def _uncoupled(
    fits: list[FrictionFit], solved: list[Solution], rows: Intervals, sign_width: float
) -> list[FrictionFit]:
    """Fits, with those refused whose motors turn each other's joint, too."""
    left, weight = (
        np.stack([getattr(s, name) for s in solved], axis=1) for name in ("left", "weight")
    )
    coulomb = np.array([s.coefficients[0] for s in solved])
    pairs = coupled(left, weight, coulomb, rows, sign_width, GAIN)
    new = list(fits)
    for i, j in pairs.items():
        if fits[i].verdict in (Verdict.GOOD, Verdict.BAD_FIT):
            about = (f"its residual follows the motion of {fits[j].joint}, and vice versa: one "
                     "motor turns both, and the friction of either is not its own. "
                     "Give positions and currents of the joints, not of the motors")  # fmt: skip
            new[i] = replace(fits[i], verdict=Verdict.COUPLED, reason=about)
    return new


def _doubted(
    fits: list[FrictionFit], steps: Mask, shares: Vector, rotors: Vector, *, weighed: bool
) -> list[FrictionFit]:
    """Fits whose error of B includes the share that drives may have hidden from it. Drives that
    step get the B of whole periods, two standard errors above the sampled one, so that drives that
    ramp are not excluded; B is doubted if their loop does not show it."""
    why = STEPS if weighed else f"{STEPS}; {OR_MASSES}"
    new = []
    for fit, stepped, share, rotor in zip(fits, steps, shares, rotors, strict=True):
        errors = dict(fit.errors)
        if stepped and rotor > 0.0:
            errors["B"] = float(np.hypot(errors["B"], 0.5 * (rotor - fit.values["B"])))
            new.append(replace(fit, values={**fit.values, "B": float(rotor)}, errors=errors))
            continue
        if "B" in errors:
            errors["B"] = float(np.hypot(errors["B"], share * fit.values["B"]))
        doubt = fit.rotor_doubt or (why if stepped else "")
        new.append(replace(fit, errors=errors, rotor_doubt=doubt))
    return new


def _judged(
    name: str,
    i: int,
    solved: Solution,
    rows: Intervals,
    t: Transmission,
    cut: Mask,
    play_of_joint: float,
    settings: EstimatorSettings,
) -> FrictionFit:
    change = float(np.ptp(rows.gravity[:, i]))
    shows = change >= max(_SHOWS * solved.coefficients[0], _LEAST)
    gravity = solved.gravity if shows else float("nan")
    verdict, reason = verdict_on(rows.theta_dot[:, i], float(cut[:, i].mean()), gravity, solved)
    if about := wider(play_of_joint, float(t.half_gap[i])):
        verdict, reason = Verdict.WRONG_GAP, about
    known = np.isfinite(solved.errors)
    doubt = "" if settings.current_delay_ms > 0.0 else _UNFILTERED
    if not doubt and known[2] and solved.coefficients[2] <= solved.errors[2]:
        doubt = _NOTHING
    noise = {c: float(solved.errors[k]) for k, c in enumerate(COLUMNS) if known[k]}
    return FrictionFit(
        joint=name,
        verdict=verdict,
        reason=reason,
        values={c: float(solved.coefficients[k]) for k, c in enumerate(COLUMNS) if known[k]},
        errors=noise,
        noise=noise,
        seconds=float(rows.dt.sum()),
        r2=solved.r2,
        condition=solved.condition,
        gravity_scale=gravity,
        gravity_change=change,
        offset=solved.offset,
        rotor_doubt=doubt,
        stiction=solved.stiction,
        stiction_error=solved.stiction_error,
        load_bound=solved.load_bound,
    )
