"""Errors of friction that no log shows: of masses, torque constants and the motors' own loops.

A fit is as good as ever if the model's inertial torque is too large by some share: rotor and
friction absorb it. So the stated errors include it, besides the noise.
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
"""Least relative errors that are assumed of masses."""
_CONSTANT_OFF = 0.03
"""Relative error that is assumed of a torque constant until gravity shows it: data sheets state
those of motors to 5 or 10 %, and efficiencies of gears no better (95 %)."""
_ALIKE = 2  # joints
_LOAD_OFF = 0.06
"""Least relative error that is assumed of load friction: gears differ between driving and being
driven, and the friction of the link alone is not known separately."""
_FALLS = 0.6
"""Standard error per change of a coefficient by friction that falls with speed: 95 % intervals
cover friction of up to 1.3 times Coulomb's near rest that falls within 0.1 rad/s."""
_NEAR_REST = 0.002
"""Share of Coulomb friction that may seem to depend on speed, as it is lower near rest."""


def with_model_errors(
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
    """Fits whose errors include those that a log cannot show: of the torque constant
    (`constant_off`); of the model's inertial torque, which appears as rotor and friction, and is
    off by as much as gravity, at least by the error of a URDF's masses; of its bodies
    (`by_bodies`), or of those that were `weighed`, with the change from intervals `by_urdf`; of
    friction that falls with speed (Stribeck's), which the model lacks; and of Coulomb friction
    taken for viscous. Guessed torque constants may be off by the shares `guessed` (n,)."""
    scales = np.array([fit.gravity_scale for fit in fits])
    shown = scales[np.isfinite(scales)]
    off = masses_off(shown, _IDENTIFIED if weighed else _BY_URDF)
    inertial = low_pass(rows.inertial - rows.gravity, rows, GAIN)
    moved = np.zeros_like(inertial)
    if by_urdf is not None:  # what weighing changed is as uncertain: gravity shows no inertia
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
    """Scale of gravity that is common to all joints that show one (k,), else NaN: the currents of
    one log have one unit, so that an axis that gravity does not turn is as far off."""
    off = scales - 1.0
    agree = len(off) >= _ALIKE and abs(np.sign(off).sum()) == len(off)
    return float(1.0 + off[np.argmin(np.abs(off))]) if agree else float("nan")


def constant_off(gravity_scale: float) -> float:
    """Relative error that is assumed of a torque constant: by data sheets alone (NaN: gravity does
    not change, or its masses were identified with this constant), or by gravity, too, whose
    deviation is divided between the constant and the URDF's masses by their variances."""
    if not np.isfinite(gravity_scale):
        return _CONSTANT_OFF
    both = float(np.hypot(_CONSTANT_OFF, _BY_URDF))
    part = (_CONSTANT_OFF / both) ** 2
    return float(np.hypot(part * (gravity_scale - 1.0), _CONSTANT_OFF * _BY_URDF / both))


def with_steps(fits: list[FrictionFit], falls: Vector) -> list[FrictionFit]:
    """Fits of motors that get a position once a period: until the next one their torque falls with
    their velocity, by `falls` (n,) = stiffness T [Nm s/rad], and is sampled at one moment. Up to
    half of that is in the viscous friction, as the residual needs it, but not in the gear's own."""
    new, name = list(fits), COLUMNS[1]
    for i in np.flatnonzero(falls):
        error = float(np.hypot(fits[i].errors.get(name, 0.0), 0.5 * falls[i] / NORMAL_95))
        doubt = fits[i].rotor_doubt or OF_POSITIONS
        new[i] = replace(fits[i], errors=fits[i].errors | {name: error}, rotor_doubt=doubt)
    return new
