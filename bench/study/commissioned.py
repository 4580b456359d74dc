"""Figures of a commissioned arm: what failed, how true what is called good is, and how sure."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bench.report import Target
from bench.rigs.person import CommissionedArm, Person
from common.arrays import Vector
from daemon.config.identified import IdentifiedJoint
from daemon.config.load import load_robot
from daemon.config.vectors import limits_of
from simulator.mismatch import PlantParameters

_95 = 1.96  # Standard errors in half of a 95 % interval.
_POSES = 2000
_EDGE = 0.1  # [rad] of the limits, which strokes need
_LITTLE = 0.02  # of a joint's friction: gravity that is no more does not act
WIDEST = 15.0  # Interval of friction [%].

Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Stated:
    """One quantity of all joints: error over half the stated interval, and that interval's whole
    width [%]; both (n,), NaN where there is none."""

    error: Vector
    wide: Vector


def observable(arm: CommissionedArm) -> NDArray[np.bool_]:
    """(n,) True for a joint whose link meets both borders of its gap within the limits: gravity
    changes side there, or does not act, by the arm as it is in truth."""
    true = _true(arm)
    limits = limits_of(load_robot(arm.folder).configuration)
    shape = _POSES, len(arm.joints)
    drawn = np.random.default_rng(0).uniform(limits.lower + _EDGE, limits.upper - _EDGE, shape)
    data = true.model.createData()
    g = np.array([pin.computeGeneralizedGravity(true.model, data, q) for q in drawn])
    little = _LITTLE * _sum(true.coulomb)
    both = (g.min(axis=0) < -little) & (g.max(axis=0) > little)
    return np.asarray(both | (np.abs(g).max(axis=0) <= little))


def stated(arm: CommissionedArm) -> dict[str, Stated]:
    """Every quantity with an interval, by name."""
    found, truth = arm.found(), true_friction(arm)
    return {"alpha": _gaps(found, _true(arm).half_gap)} | {
        name: _friction(found, name, values) for name, values in truth.items()
    }


def true_friction(arm: CommissionedArm) -> dict[str, Vector]:
    """Friction of motor and link together, and the rotor, as they are in truth, (n,) each."""
    true = _true(arm)
    sums = {"K_theta_s": _sum(true.coulomb), "K_theta_v": _sum(true.viscous)}
    return sums | {"B": true.rotor_inertia}


def friction_values(joint: IdentifiedJoint) -> dict[str, float]:
    """The same as it was identified, NaN where it was not; and R2."""
    entry = joint.friction
    if entry is None:
        return dict.fromkeys(("K_theta_s", "K_theta_v", "B", "r2"), np.nan)
    f, rotor = entry.friction, entry.rotor_inertia
    return {
        "K_theta_s": f.motor_coulomb + f.link_coulomb,
        "K_theta_v": f.motor_viscous + f.link_viscous,
        "B": np.nan if rotor is None else rotor,
        "r2": entry.r2,
    }


def judged(name: str, person: Person, went: dict[str, bool]) -> tuple[list[Target], dict[str, Any]]:
    """Targets of the project for an arm that went from zero to armed, and numbers behind them."""
    arm, seen = person.arm, observable(person.arm)
    of = stated(arm)
    failed = [step for step, well in went.items() if not well]
    entries = zip(arm.joints, seen, arm.found(), strict=True)
    missing = [
        f"{joint} {step}"
        for joint, shows, found in entries
        for step in ("gap", "friction", "thresholds")
        if getattr(found, step) is None and (shows or step != "gap")
    ]
    friction = np.concatenate([of["K_theta_s"].wide, of["K_theta_v"].wide])
    targets = [
        Target(f"{name}: steps that failed, and not armed", len(failed), 0),
        Target(f"{name}: steps that observable joints failed", len(missing), 0),
        Target(f"{name}: error of what is good over its stated interval, worst",
               _worst(np.concatenate([one.error for one in of.values()])), 1.5),
        Target(f"{name}: widest interval of friction", _worst(friction), WIDEST, "%"),
        Target(f"{name}: time of `identify gap`", person.took["gap"] / 60.0, 10, "min"),
    ]  # fmt: skip
    data = {
        "joints": arm.joints,
        "observable": seen.tolist(),
        "missing": missing,
        "steps": went,
        "took_s": person.took,
        "position_gain": load_robot(arm.folder).configuration.control.position_gain,
        "error_over_interval": {name: _rounded(one.error) for name, one in of.items()},
        "interval_percent": {name: _rounded(one.wide) for name, one in of.items()},
    }
    return targets, data


def _true(arm: CommissionedArm) -> PlantParameters:
    assert arm.true is not None
    return arm.true


def _sum(both: Vector) -> Vector:
    """Of link and motor, (2n,), as (n,)."""
    return np.asarray(both.reshape(2, -1).sum(axis=0))


def _gaps(found: list[IdentifiedJoint], true: Vector) -> Stated:
    rows = [(j.gap.half_gap, j.gap.confidence) if j.gap else (np.nan, np.nan) for j in found]
    alpha, half = np.array(rows).T
    wide = 200.0 * half / np.where(alpha > 0.0, alpha, np.nan)
    return Stated(np.abs(alpha - true) / np.maximum(half, 1e-9), wide)


def _friction(found: list[IdentifiedJoint], name: str, true: Vector) -> Stated:
    values = np.array([friction_values(joint)[name] for joint in found])
    errors = [j.friction.errors.get(name, np.nan) if j.friction else np.nan for j in found]
    half = _95 * np.array(errors)
    return Stated(np.abs(values - true) / np.maximum(half, 1e-12), 200.0 * half / values)


def _worst(values: Vector) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else float("inf")


def _rounded(values: Vector) -> list[float | None]:
    return [round(float(v), 2) if np.isfinite(v) else None for v in values]
