"""Errors of friction that no log shows: those of masses, torque constants and motors' own loops.

A fit is as good as ever where the model's inertial torque is a share too large: rotor and friction
take it. So stated errors bear it, beside the noise.
"""

from dataclasses import replace

import numpy as np

from common.arrays import Vector
from estimator.model import Model
from identification.body_errors import by_bodies
from identification.friction_fit import FrictionFit
from identification.friction_verdict import GRAVITY_TOLERANCE
from identification.log_intervals import Intervals, low_pass
from identification.regression import COLUMNS, GAIN, NORMAL_95, Regression, Solution
from identification.setpoint_steps import OF_POSITIONS

_BY_URDF, _IDENTIFIED = 0.03, 0.01
"""Least shares by which masses are believed to be off."""
_CONSTANT_OFF = 0.03
"""Share by which a torque constant is believed to be off before gravity shows it: data sheets state
those of motors to 5 or 10 %, and efficiencies of gears no better (95 %)."""
_ALIKE = 2  # joints
_LOAD_OFF = 0.06
"""Least share by which friction per transmitted torque is believed to be off: gears differ for
driving and being driven, and what the link alone rubs is not known apart."""
_FALLS = 0.6
"""Standard error per change of a coefficient beside friction that falls with speed: 95 % intervals
hold truths whose friction is up to 1.3 times Coulomb's near rest, and falls within 0.1 rad/s."""
_NEAR_REST = 0.002
"""Share of Coulomb friction that may seem to depend on speed, as it is lower near rest."""


def with_what_is_believed(
    fits: list[FrictionFit],
    solved: list[Solution],
    found: Regression,
    rows: Intervals,
    model: Model,
    *,
    weighed: bool,
    by_urdf: Intervals | None = None,
    guessed: Vector,
) -> list[FrictionFit]:
    """Fits whose errors include those that a log cannot show: the torque constant's own, as
    `constant_off` has it; the model's inertial torque, which comes out as rotor and friction, off
    by as much as gravity is, or by the least error of a URDF's masses, and its bodies off as
    `by_bodies` has it, or by the error of those that were `weighed`, with what that changed of
    intervals `by_urdf`; friction that falls with speed
    (Stribeck's), of which the model knows nothing; and Coulomb friction taken for viscous. Torque
    constants that were `guessed` may be off by these shares (n,)."""
    scales = np.array([fit.gravity_scale for fit in fits])
    shown = scales[np.isfinite(scales)]
    off = masses_off(shown, _IDENTIFIED if weighed else _BY_URDF)
    inertial = low_pass(rows.inertial - rows.gravity, rows, GAIN)
    moved = np.zeros_like(inertial)
    if by_urdf is not None:  # what weighing changed is as little sure: gravity shows no inertia
        moved = inertial - low_pass(by_urdf.inertial - by_urdf.gravity, by_urdf, GAIN)
    of_bodies = np.zeros((len(fits), 3)) if weighed else by_bodies(solved, found, rows, model)
    alike = max(constant_off(shared(shown)), _CONSTANT_OFF)
    new = []
    for i, (fit, one) in enumerate(zip(fits, solved, strict=True)):
        columns = np.concatenate([found.columns[:, i, :3], found.nuisance[:, i]], axis=1)
        weighted = one.weight[:, None] * columns
        torques = one.weight[:, None] * np.column_stack([inertial[:, i], moved[:, i]])
        bias, change = np.linalg.lstsq(weighted, torques, rcond=None)[0].T
        errors, weighs = dict(fit.errors), float(np.sqrt(max(off**2 - _IDENTIFIED**2, 0.0)))
        constant = constant_off(float("nan") if weighed else fit.gravity_scale)
        if not (weighed or np.isfinite(fit.gravity_scale)):
            constant = alike
        constant = max(constant, guessed[i])
        for k, name in enumerate(COLUMNS[:3]):
            if name in errors:
                parts = (
                    *(errors[name], _FALLS * one.falls[k]),
                    *(of_bodies[i, k], change[k], off * bias[k]),
                    constant * (fit.values[name] + abs(bias[k])),
                )
                errors[name] = float(np.linalg.norm(parts))
        if "K_load" in errors:
            errors["K_load"] = float(np.hypot(errors["K_load"], _LOAD_OFF * fit.values["K_load"]))
        if "K_theta_v" in errors:
            speed = max(float(np.sqrt(np.square(rows.theta_dot[:, i]).mean())), 1e-9)
            near_rest = _NEAR_REST * fit.values["K_theta_s"] / speed
            errors["K_theta_v"] = float(np.hypot(errors["K_theta_v"], near_rest))
        of_masses = {
            name: float(np.hypot(weighs * bias[k], of_bodies[i, k]))
            for k, name in enumerate(COLUMNS[:3])
            if name in errors
        }
        new.append(replace(fit, errors=errors, of_masses=of_masses))
    return new


def masses_off(scales: Vector, least: float) -> float:
    """Share by which masses are believed to be off, by gravity's scales (k,). Of a joint whose
    torque is refused, in another unit or none, one counts as the largest that is not."""
    off = np.clip(scales - 1.0, -GRAVITY_TOLERANCE, GRAVITY_TOLERANCE)
    return max(float(np.sqrt(np.square(off).mean())) if len(off) else 0.0, least)


def shared(scales: Vector) -> float:
    """Gravity's scale that all joints that show one (k,) share, else NaN: currents of one log are
    in one unit, so that an axis that gravity does not turn is as far off."""
    off = scales - 1.0
    agree = len(off) >= _ALIKE and abs(np.sign(off).sum()) == len(off)
    return float(1.0 + off[np.argmin(np.abs(off))]) if agree else float("nan")


def constant_off(gravity_scale: float) -> float:
    """Share by which a torque constant is believed to be off: by data sheets alone (NaN: gravity
    does not change, or its masses were identified by this constant), or by gravity too, of which
    constant and URDF's masses take their parts by their variances."""
    if not np.isfinite(gravity_scale):
        return _CONSTANT_OFF
    both = float(np.hypot(_CONSTANT_OFF, _BY_URDF))
    part = (_CONSTANT_OFF / both) ** 2
    return float(np.hypot(part * (gravity_scale - 1.0), _CONSTANT_OFF * _BY_URDF / both))


def with_steps(fits: list[FrictionFit], falls: Vector) -> list[FrictionFit]:
    """Fits of motors that get a position once a period: until the next their torque falls, by
    `falls` (n,) = stiffness T [Nm s/rad] with their velocity, and is sampled at one moment. Up to
    half of that is in the viscous friction, which the residual needs so; the gear's own is not."""
    new, name = list(fits), COLUMNS[1]
    for i in np.flatnonzero(falls):
        error = float(np.hypot(fits[i].errors.get(name, 0.0), 0.5 * falls[i] / NORMAL_95))
        doubt = fits[i].rotor_doubt or OF_POSITIONS
        new[i] = replace(fits[i], errors=fits[i].errors | {name: error}, rotor_doubt=doubt)
    return new
