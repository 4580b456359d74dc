"""Friction and rotor inertia by least squares on the residual, (8)-(11) with their misprints
corrected: `docs/estimator.md` has the table.

    r_nl = low_pass(d(M q_dot)/dt - beta - tau_M) = -tau_mu - B theta_ddot         engaged
    r_nl = low_pass(d(M q_dot)/dt - beta)         = -tau_mu                        in the gap

Engaged, motor and link friction rub together and only their sum K_theta can be found (the columns
of the two have a condition number in the thousands). Link friction K_q shows alone only in the
gap, and there poorly.
"""

from dataclasses import dataclass, replace

import numpy as np

from arrays import Matrix, Vector
from errors import LogError
from estimator.identification.coupling import coupled
from estimator.identification.friction_verdict import Verdict, verdict_on, wider
from estimator.identification.log_intervals import (
    Intervals,
    Mask,
    intervals,
    locate,
    low_pass,
    play,
)
from estimator.identification.motion_log import MotionLog
from estimator.identification.regression import (
    COLUMNS,
    GAIN,
    Regression,
    Solution,
    regression,
    solve_joint,
)
from estimator.identification.setpoint_steps import (
    NO_SETPOINTS,
    STEP_GAIN,
    STEPS,
    missed,
    stepping,
    unsure,
)
from estimator.identification.sticking import SURE, held
from estimator.identification.touches import near
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission, stiction_range

SHORTEST_S = 10.0
"""Least motion [s] unless less is asked for."""
_ROUNDS = 3
_BY_URDF, _IDENTIFIED = 0.03, 0.01
"""Least shares by which masses are believed to be off."""
_CONSTANT_OFF = 0.015
"""By which a torque constant is believed to be."""
WIDE = 0.15
"""Width of the interval of a friction over it, beyond which it is worth to know it better."""
_95 = 1.96  # standard errors in half of a 95 % interval
_MATTERS = 0.1
_SHOWS = 0.3
"""Of Coulomb friction, by which gravity changes at least where it is compared."""
_NEAR_REST = 0.002
"""Of Coulomb friction, by which it may seem to depend on speed: near rest it is not quite so."""
_SURE = 6.0
"""Standard errors from zero at which friction seen in the gap is believed: they are those of noise,
and it was up to four of them off the truth."""


_UNFILTERED = (
    "the drives do not filter their current (estimator.current_delay_ms is 0), and it is sampled "
    "between two steps: B keeps its value"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionFit:
    """Coefficients fitted to one joint's motion; SI at the link side."""

    joint: str
    verdict: Verdict
    reason: str
    """Explanation with the figures; empty when good."""
    values: dict[str, float]
    """Coefficients by names of `COLUMNS`; those that were not fitted are missing."""
    errors: dict[str, float]
    """Standard errors, from the scatter between blocks of 1 s, and from masses and torque constants
    that may be wrong."""
    r2: float
    """R2 on held-out motion, of the friction alone (14)."""
    condition: float
    """Condition number of the scaled columns that count while engaged."""
    gravity_scale: float
    """Gravity that the motor carries, by K_c, over the model's: 1 where they agree; NaN where
    gravity hardly changes."""
    rotor_doubt: str
    """Reason why B is not that of the rotor, and what to do; empty where it is."""
    stiction: float
    """Share of K_theta_s that near rest is what the last motion left; NaN where it did not show"""
    stiction_error: float
    """Its standard error"""

    @property
    def rotor_trusted(self) -> bool:
        """True where B may be used."""
        return not self.rotor_doubt

    @property
    def stiction_known(self) -> bool:
        """True where `stiction` showed clearly."""
        return self.stiction_error < SURE

    @property
    def unsure(self) -> float:
        """Width of the 95 % interval of the friction over it, the wider of Coulomb and viscous;
        viscous friction that is a tenth of the other at 1 rad/s does not matter."""
        coulomb, viscous = self.values["K_theta_s"], self.values["K_theta_v"]
        least = max(_MATTERS * coulomb, 1e-9)
        wide = (self.errors["K_theta_s"] / max(coulomb, least),
                self.errors["K_theta_v"] / max(viscous, least))  # fmt: skip
        return 2.0 * _95 * max(wide)

    def link_friction(self, name: str) -> float | None:
        """K_q_s or K_q_v where the gap showed it clearly, else None."""
        value = self.values.get(name)
        return value if value is not None and value > _SURE * self.errors[name] else None


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
    """discarded because of these touches [s]"""


def identify_friction(
    log: MotionLog,
    model: Model,
    transmission: Transmission,
    settings: EstimatorSettings,
    max_current: Vector,
    shortest_s: float = SHORTEST_S,
    *,
    weighed: bool = False,
) -> tuple[list[FrictionFit], Reconstruction]:
    """Coefficients of every joint from contact-free motion.

    transmission: half-gaps as identified, and friction to begin with; max_current (n,) [A];
    weighed: the model has identified masses.
    Raises LogError for a log of less than `shortest_s`.
    """
    if log.measured_s + log.period_s < shortest_s - 1e-6:
        raise LogError(
            f"the log is too short: {log.measured_s:.1f} s, at least {shortest_s:g} s of motion"
        )
    rows = intervals(log, model, settings)
    cut: Mask = np.abs(rows.current) > 0.98 * max_current
    touched, moved = np.zeros_like(cut), play(rows).tolist()
    sticking, unknown = held(rows, transmission.sign_width)
    # Each round sees the gap with the friction of the one before, and what the one before could not
    # explain.
    for _ in range(_ROUNDS):
        where = locate(rows, transmission, settings)
        found = regression(rows, transmission, where, sticking)
        alpha, spoilt = transmission.half_gap.tolist(), near(rows, touched)
        solved = [
            solve_joint(i, found, rows, alpha[i], where, cut, spoilt, unknown) for i in range(log.n)
        ]
        touched = np.stack([one.touched for one in solved], axis=1)
        fits = [
            _judged(log.joints[i], i, one, rows, transmission, cut, moved[i], settings)
            for i, one in enumerate(solved)
        ]
        transmission = adopt(transmission, fits)
    fits = _with_what_is_believed(fits, solved, found, rows, _IDENTIFIED if weighed else _BY_URDF)
    fits = _uncoupled(fits, solved, rows, transmission.sign_width)
    if log.setpoint is None:
        fits = [replace(fit, rotor_doubt=fit.rotor_doubt or NO_SETPOINTS) for fit in fits]
    else:
        quick = regression(rows, transmission, where, sticking, STEP_GAIN)
        fits = _doubted(fits, *missed(quick, solved, rows))
    shown = np.stack([found.columns[:, i] @ s.coefficients for i, s in enumerate(solved)], axis=1)
    by_hand = tuple(log.joints[i] for i in np.flatnonzero(touched.any(axis=0)))
    discarded_s = float(rows.dt @ near(rows, touched))
    return fits, Reconstruction(rows.time_s, found.r_nl, shown, where.phi, by_hand, discarded_s)


def _with_what_is_believed(
    fits: list[FrictionFit],
    solved: list[Solution],
    found: Regression,
    rows: Intervals,
    least_off: float,
) -> list[FrictionFit]:
    """Fits whose errors also bear what a log cannot tell: the torque constant's own error; the
    model's inertial torque, which comes out as rotor and friction, off by as much as gravity is,
    and by a share of `least_off` at least; and Coulomb friction that is taken for viscous."""
    scales = np.array([fit.gravity_scale for fit in fits])
    shown = scales[np.isfinite(scales)]
    off = max(float(np.sqrt(np.square(shown - 1.0).mean())) if len(shown) else 0.0, least_off)
    inertial = low_pass(rows.inertial - rows.gravity, rows, GAIN)
    new = []
    for i, (fit, one) in enumerate(zip(fits, solved, strict=True)):
        columns = np.concatenate([found.columns[:, i, :3], found.nuisance[:, i]], axis=1)
        weighted = one.weight[:, None] * columns
        bias = np.linalg.lstsq(weighted, one.weight * inertial[:, i], rcond=None)[0]
        errors = dict(fit.errors)
        for k, name in enumerate(COLUMNS[:3]):
            if name in errors:
                parts = (errors[name], off * bias[k], _CONSTANT_OFF * fit.values[name])
                errors[name] = float(np.linalg.norm(parts))
        if "K_theta_v" in errors:
            speed = max(float(np.sqrt(np.square(rows.theta_dot[:, i]).mean())), 1e-9)
            near_rest = _NEAR_REST * fit.values["K_theta_s"] / speed
            errors["K_theta_v"] = float(np.hypot(errors["K_theta_v"], near_rest))
        new.append(replace(fit, errors=errors))
    return new


def _uncoupled(
    fits: list[FrictionFit], solved: list[Solution], rows: Intervals, sign_width: float
) -> list[FrictionFit]:
    """Fits, in which those are refused whose motors turn each other's joint, too."""
    left, weight = (
        np.stack([getattr(s, name) for s in solved], axis=1) for name in ("left", "weight")
    )
    coulomb = np.array([s.coefficients[0] for s in solved])
    pairs = coupled(left, weight, coulomb, rows, sign_width, GAIN)
    new = list(fits)
    for i, j in pairs.items():
        if fits[i].verdict in (Verdict.GOOD, Verdict.BAD_FIT):
            about = (f"what is left follows the motion of {fits[j].joint}, and the other way "
                     "round: one motor turns both, and the friction of either is not its own. "
                     "Give positions and currents of the joints, not of the motors")  # fmt: skip
            new[i] = replace(fits[i], verdict=Verdict.COUPLED, reason=about)
    return new


def _doubted(fits: list[FrictionFit], more: Vector, error: Vector) -> list[FrictionFit]:
    """Fits with what drives may have kept from B, by shares and errors of `missed`, in its error;
    and without the B of those that step."""
    new = []
    for i, (fit, steps) in enumerate(zip(fits, stepping(more, error), strict=True)):
        errors = dict(fit.errors)
        if "B" in errors:
            hidden = fit.values["B"] * unsure(float(more[i]), float(error[i]))
            errors["B"] = float(np.hypot(errors["B"], hidden))
        doubt = fit.rotor_doubt or (STEPS if steps else "")
        new.append(replace(fit, errors=errors, rotor_doubt=doubt))
    return new


_ADOPTED = (
    *("motor_coulomb", "motor_viscous", "link_coulomb", "link_viscous"),
    *("gap_coulomb", "gap_viscous", "least_stiction", "most_stiction"),
    *("rotor_inertia", "contact_stiffness", "contact_damping"),
)


def adopt(t: Transmission, fits: list[FrictionFit]) -> Transmission:
    """The transmission with what was identified; joints that are not good keep what they have.

    The sum K_theta is divided: the link gets K_q where the gap showed it clearly, else its old
    share; the rotor gets the rest, K_theta - K_q, so that `motor_*` is the rotor's own.
    """
    new = {name: getattr(t, name).copy() for name in _ADOPTED}
    for i, fit in enumerate(fits):
        if fit.verdict is not Verdict.GOOD:
            continue
        v = fit.values
        for kind, letter in (("coulomb", "s"), ("viscous", "v")):
            whole = v[f"K_theta_{letter}"]
            link, rotor = new[f"link_{kind}"][i], new[f"motor_{kind}"][i]
            share = link / (link + rotor) if link + rotor > 0.0 else 0.0
            alone = fit.link_friction(f"K_q_{letter}")
            link = min(share * whole if alone is None else alone, whole)
            new[f"link_{kind}"][i], new[f"motor_{kind}"][i] = link, whole - link
            new[f"gap_{kind}"][i] = v.get(f"K_phi_{letter}", 0.0)
        if fit.stiction_known:
            least, most = stiction_range(fit.stiction)
            new["least_stiction"][i], new["most_stiction"][i] = least, most
        if fit.rotor_trusted:
            new["rotor_inertia"][i] = v["B"]
        new["contact_stiffness"][i] = v.get("K_phi_p", 0.0)
        new["contact_damping"][i] = v.get("K_phi_d", 0.0)
    return replace(t, **new)


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
    shows = float(np.ptp(rows.gravity[:, i])) >= _SHOWS * solved.coefficients[0]
    gravity = solved.gravity if shows else float("nan")
    verdict, reason = verdict_on(rows.theta_dot[:, i], float(cut[:, i].mean()), gravity, solved)
    if about := wider(play_of_joint, float(t.half_gap[i])):
        verdict, reason = Verdict.WRONG_GAP, about
    known = np.isfinite(solved.errors)
    return FrictionFit(
        joint=name,
        verdict=verdict,
        reason=reason,
        values={c: float(solved.coefficients[k]) for k, c in enumerate(COLUMNS) if known[k]},
        errors={c: float(solved.errors[k]) for k, c in enumerate(COLUMNS) if known[k]},
        r2=solved.r2,
        condition=solved.condition,
        gravity_scale=gravity,
        rotor_doubt="" if settings.current_delay_ms > 0.0 else _UNFILTERED,
        stiction=solved.stiction,
        stiction_error=solved.stiction_error,
    )
