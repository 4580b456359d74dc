"""The upright arm from zero to armed without a hand, and how true what is called good is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from arrays import Vector
from bench.report import Target
from bench.rigs import upright_arm
from bench.rigs.person import Mistakes, Person, Written, poor_guesses
from daemon.commands.simulated_robot import true_arm
from daemon.config.identified import IdentifiedJoint

_95 = 1.96
"""Standard errors in half of a 95 % interval."""


def guessed(written: Written) -> None:
    """Poor guesses, and the current as these drives report it."""
    poor_guesses(written)


def turned_shoulder(written: Written) -> None:
    """The shoulder's motor counts the other way, and gravity pulls at it."""
    guessed(written)
    written["joints"][1]["wiring"]["motor_sign"] = -1


def turned_elbow(written: Written) -> None:
    """The elbow's likewise."""
    guessed(written)
    written["joints"][2]["wiring"]["motor_sign"] = -1


def turned_link(written: Written) -> None:
    """The wrist's link encoder counts the other way."""
    guessed(written)
    written["joints"][4]["wiring"]["link_sign"] = -1


def wrong_gear(written: Written) -> None:
    """A gear ratio that is wrong by a tenth."""
    guessed(written)
    written["joints"][1]["wiring"]["gear"] *= 1.1


UPRIGHT_MISTAKES: Mistakes = {
    "motor_sign of the loaded shoulder": (turned_shoulder, "shoulder"),
    "motor_sign of the loaded elbow": (turned_elbow, "elbow"),
    "link_sign of the wrist": (turned_link, "wrist_pitch"),
    "gear of the shoulder wrong by 10 %": (wrong_gear, "shoulder"),
}


def upright(
    folder: Path, seed: int, show: Callable[[str], None]
) -> tuple[list[Target], dict[str, Any]]:
    """Commission it; targets of the project, and numbers behind them."""
    person = Person(
        folder,
        seed,
        show,
        upright_arm.write(folder / "upright"),
        pose=None,
        change=guessed,
        described=lambda robot, _: true_arm(robot)[0],
    )
    went = person.from_zero_to_armed()
    arm = person.arm
    assert arm.true is not None
    true, n = arm.true, len(arm.joints)
    gap = _gaps(arm.found(), true.half_gap)
    sums = [true.coulomb[:n] + true.coulomb[n:], true.viscous[:n] + true.viscous[n:]]
    friction = {
        name: _friction(arm.found(), name, truth)
        for name, truth in zip(("K_theta_s", "K_theta_v"), sums, strict=True)
    }
    friction["B"] = _friction(arm.found(), "B", true.rotor_inertia)
    mistakes = person.mistakes_found(UPRIGHT_MISTAKES)
    stated = np.concatenate([gap[0], *(one[0] for one in friction.values())])
    wide = np.concatenate([one[1] for one in friction.values()])
    failed = [step for step, well in went.items() if not well]
    targets = [
        Target("upright arm: steps that failed", len(failed), 0, "", "lower"),
        Target("upright arm: error of what is good over its stated interval, worst",
               _worst(stated), 1.5, "", "lower"),
        Target("upright arm: widest interval of friction and rotor", _worst(wide), 15, "%",
               "lower"),
        Target(f"upright arm: mistakes of wiring found, of {len(mistakes)}",
               sum(mistakes.values()), len(mistakes), "", "higher"),
    ]  # fmt: skip
    data = {
        "joints": arm.joints,
        "steps": went,
        "took_s": person.took,
        "mistakes": mistakes,
        "gap_error_over_interval": _rounded(gap[0]),
        "friction_error_over_interval": {k: _rounded(one[0]) for k, one in friction.items()},
        "friction_interval_percent": {k: _rounded(one[1]) for k, one in friction.items()},
    }
    return targets, data


def _gaps(found: list[IdentifiedJoint], true: Vector) -> tuple[Vector]:
    """Error of each half-gap over half its stated interval, NaN without one."""
    rows = [(j.gap.half_gap, j.gap.confidence) if j.gap else (np.nan, np.nan) for j in found]
    alpha, half = np.array(rows).T
    return (np.abs(alpha - true) / np.maximum(half, 1e-9),)


def _friction(found: list[IdentifiedJoint], name: str, true: Vector) -> tuple[Vector, Vector]:
    """Error of each coefficient over half its 95 % interval, and the interval's width [%]."""
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
    return np.abs(values - true) / np.maximum(half, 1e-12), 200.0 * half / values


def _worst(values: Vector) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else float("inf")


def _rounded(values: Vector) -> list[float | None]:
    return [round(float(v), 2) if np.isfinite(v) else None for v in values]
