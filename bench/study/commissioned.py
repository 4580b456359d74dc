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
    joints = load_robot(arm.folder).configuration.joints
    lower = np.array([joint.limits.lower for joint in joints]) + _EDGE
    upper = np.array([joint.limits.upper for joint in joints]) - _EDGE
    drawn = np.random.default_rng(0).uniform(lower, upper, (_POSES, len(joints)))
    data = true.model.createData()
    g = np.array([pin.computeGeneralizedGravity(true.model, data, q) for q in drawn])
    little = _LITTLE * _sum(true.coulomb)
    both = (g.min(axis=0) < -little) & (g.max(axis=0) > little)
    return np.asarray(both | (np.abs(g).max(axis=0) <= little))


def stated(arm: CommissionedArm) -> dict[str, Stated]:
    """Every quantity with an interval, by name."""
    true, found = _true(arm), arm.found()
    truth = {
        "K_theta_s": _sum(true.coulomb),
        "K_theta_v": _sum(true.viscous),
        "B": true.rotor_inertia,
    }
    return {"alpha": _gaps(found, true.half_gap)} | {
        name: _friction(found, name, values) for name, values in truth.items()
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
    values, errors = np.full((2, len(found)), np.nan)
    for i, joint in enumerate(found):
        entry = joint.friction
        if entry is None or name not in entry.errors:
            continue
        f = entry.friction
        own = {
            "K_theta_s": f.motor_coulomb + f.link_coulomb,
            "K_theta_v": f.motor_viscous + f.link_viscous,
            "B": entry.rotor_inertia,
        }[name]
        values[i], errors[i] = np.nan if own is None else own, entry.errors[name]
    half = _95 * errors
    return Stated(np.abs(values - true) / np.maximum(half, 1e-12), 200.0 * half / values)


def _worst(values: Vector) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else float("inf")


def _rounded(values: Vector) -> list[float | None]:
    return [round(float(v), 2) if np.isfinite(v) else None for v in values]
