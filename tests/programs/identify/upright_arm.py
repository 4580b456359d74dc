"""Upright six-joint arm with soft gears and weak wrists, as built at home.

Gears of 1000 Nm/rad, 13 Nm of gravity at the shoulder, friction that slides 0.3 mrad before it
gives, encoders off by 0.5 mrad, masses 10 % off the URDF: where identification on Romeo's hanging
arm met no difficulty, and on this one did.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.rigs.generated_arms import EDS, URDF, Body, GeneratedArm, in_yaml, urdf_of
from bench.rigs.generated_makes import MAKES

NAMES = ("base", "shoulder", "elbow", "forearm", "wrist_pitch", "wrist_roll")
_AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
_BODIES = (
    Body(2.0, 0.10), Body(1.8, 0.25), Body(1.2, 0.22), Body(0.6, 0.12), Body(0.3, 0.08),
    Body(0.2, 0.06),
)  # fmt: skip
_STOPS = ((-2.0, 2.0), (-1.6, 1.6), (-2.0, 2.0), (-2.5, 2.5), (-1.8, 1.8), (-2.5, 2.5))
_GEARS = (100.0, 100.0, 100.0, 80.0, 50.0, 50.0)
_CONSTANTS = (3.0, 6.0, 4.0, 1.5, 0.7, 0.5)  # Torque constants at the link [Nm/A].
_MOST = (6.0, 7.0, 6.0, 4.0, 3.0, 2.0)  # Largest currents [A].
_ROTORS = (0.12, 0.14, 0.08, 0.02, 0.006, 0.003)
_HALF_GAPS = (0.004, 0.006, 0.008, 0.005, 0.012, 0.010)
_COULOMB = (0.5, 0.9, 0.6, 0.25, 0.10, 0.06)
_VISCOUS = (0.4, 0.6, 0.4, 0.15, 0.05, 0.03)
_LINK_SHARE = 0.15
STIFFNESS = 1000.0  # Of every gear [Nm/rad].
MASSES_OFF = 10.0
PRESLIDING = 0.0003
ENCODERS_OFF = 0.0005  # Amplitude of what both encoders err with each turn [rad at the link]
START = {"shoulder": 0.6, "elbow": 0.5, "wrist_pitch": 0.3}
MAKE = replace(MAKES[0], quirks={"interpolation_ms": 10.0})
"""Setpoints become a ramp over the period, as in most drives: where they are steps, a rotor's
current is over when it is sampled."""


def write(folder: Path, *, gaps: float = 1.0, start: Mapping[str, float] = START) -> Path:
    """Write what its owner has, with `simulation.yaml` as the arm is in truth, its half-gaps so
    many times as large, and where it stands; returns the folder."""
    folder.mkdir(parents=True)
    (folder / URDF).write_text(urdf_of(NAMES, _AXES, _BODIES, _STOPS), encoding="utf-8")
    (folder / EDS).write_text(MAKE.eds(), encoding="utf-8")
    (folder / "config.yaml").write_text(in_yaml(_configuration(gaps)), encoding="utf-8")
    (folder / "simulation.yaml").write_text(in_yaml(_truth(gaps, start)), encoding="utf-8")
    return folder


def _friction(i: int) -> dict[str, float]:
    share = {"motor": 1.0 - _LINK_SHARE, "link": _LINK_SHARE}
    return {
        f"{side}_{kind}": round(part * whole[i], 4)
        for side, part in share.items()
        for kind, whole in (("coulomb", _COULOMB), ("viscous", _VISCOUS))
    }


def _wiring(i: int) -> dict[str, Any]:
    return {"node": i + 1, "gear": _GEARS[i], "rated_current_A": 0.5 * _MOST[i],
            "max_current_A": _MOST[i]}  # fmt: skip


def _configuration(gaps: float) -> dict[str, Any]:
    """Values of data sheets, and sensible figures of what is to be identified."""
    joints = [
        {
            "name": name,
            "wiring": {**_wiring(i), "profile": "servo"},
            "torque_constant": _CONSTANTS[i],
            "rotor_inertia": _ROTORS[i],
            "half_gap": gaps * _HALF_GAPS[i],
            "friction": _friction(i),
            "thresholds": {
                "contact": round(0.12 * _CONSTANTS[i] * _MOST[i], 2),
                "collision": round(0.7 * _CONSTANTS[i] * _MOST[i], 2),
            },
            "limits": {
                "lower": _STOPS[i][0] + 0.05, "upper": _STOPS[i][1] - 0.05,
                "velocity": 1.0, "acceleration": 3.0, "quick_stop": 8.0,
            },
            "admittance_gain": 0.2,
        }
        for i, name in enumerate(NAMES)
    ]  # fmt: skip
    arm = GeneratedArm(0, False, MAKE, _BODIES, "", _STOPS, tuple(joints))
    swings = {"sinusoids": {NAMES[-1]: {"amplitude": 0.2, "frequency_Hz": 0.2}}}
    return arm.configuration() | {"name": "Upright arm", "trajectory": swings}


def _encoder_errors(i: int) -> list[dict[str, Any]]:
    """Error of the motor's encoder with its turn, and of the link's, twice in one."""
    return [
        {"encoder": "motor", "order": 1, "amplitude": ENCODERS_OFF, "phase": 0.7 * i},
        {"encoder": "link", "order": 2, "amplitude": ENCODERS_OFF, "phase": 1.1 * i},
    ]


def _truth(gaps: float, start: Mapping[str, float]) -> dict[str, Any]:
    joints = [
        {
            **_wiring(i), "name": name, "drive": "servo", "torque_constant": _CONSTANTS[i],
            "rotor_inertia": _ROTORS[i], "half_gap": gaps * _HALF_GAPS[i],
            "gear_stiffness": STIFFNESS,
            "friction": _friction(i), "lower": _STOPS[i][0], "upper": _STOPS[i][1], "brake": True,
            "encoder_errors": _encoder_errors(i),
        }
        for i, name in enumerate(NAMES)
    ]  # fmt: skip
    mismatch = {
        "mass": MASSES_OFF, "center_of_mass": 0.0, "friction": 30.0, "torque_constant": 2.0,
        "half_gap": 20.0, "rotor_inertia": 20.0,
    }  # fmt: skip
    settings = {
        "seed": 1, "mismatch": mismatch, "friction": "dahl", "presliding": PRESLIDING,
    }  # fmt: skip
    return {
        "urdf": URDF,
        "initial_position": dict(start),
        "joints": joints,
        "drives": {"servo": MAKE.truth(EDS)},
        "settings": settings,
    }
