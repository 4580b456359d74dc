"""Generated arms: four to seven joints, upright or hanging, with random gears and motors and one of
six generated makes of drive; with the files that an owner who makes no mistake writes."""

import copy
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bench.rigs.generated_makes import MAKES, Make
from estimator.model import Model

PROFILE = "servo"
EDS, URDF = "drive.eds", "arm.urdf"
_NAMES = ("base", "shoulder", "elbow", "forearm", "wrist", "hand", "flange")
_AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "0 1 0")
_GEARS = (36.0, 50.0, 80.0, 100.0, 101.0, 121.0, 160.0)


@dataclass(frozen=True, slots=True)
class Body:
    """One link as its CAD says it: a rod along z."""

    mass: float  # [kg]
    length: float  # [m]

    @property
    def inertia(self) -> tuple[float, float]:
        """Across and along the rod, about its centre [kg m2]."""
        thick = 0.03
        across = self.mass * (self.length**2 / 12.0 + thick**2 / 4.0)
        return across, 0.5 * self.mass * thick**2


@dataclass(frozen=True, slots=True)
class GeneratedArm:
    """Everything that an owner has on the desk: URDF, EDS, and what the data sheets say."""

    seed: int
    hanging: bool
    make: Make
    bodies: tuple[Body, ...]
    urdf: str
    stops: tuple[tuple[float, float], ...]  # end stops of each joint [rad]
    joints: tuple[dict[str, Any], ...]  # as `config.yaml` has them

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return _NAMES[: len(self.joints)]

    def configuration(self) -> dict[str, Any]:
        """Configuration of a careful owner, with sensible guesses of what is to be identified."""
        return {
            "version": 1,
            "name": f"Generated arm {self.seed}",
            "urdf": URDF,
            "period_ms": 10,
            "bus": {"interface": "socketcand", "host": "127.0.0.1", "port": 29536,
                    "channel": "can0", "bitrate": 1_000_000},
            "drives": {PROFILE: self.make.profile(EDS)},
            "joints": copy.deepcopy(list(self.joints)),
            "estimator": {
                "motor_position":
                    "measured" if "motor_position" in self.make.quantities else "integrated"
            },
            "trajectory": {"sinusoids": {self.names[-1]: {"amplitude": 0.2, "frequency_Hz": 0.2}}},
        }  # fmt: skip

    def truth(self) -> dict[str, Any]:
        """The arm as it is, for `simulation.yaml`: near what the data sheets say, and not that."""
        rng = np.random.default_rng((self.seed, 23))
        joints = []
        for joint, (lower, upper) in zip(self.configuration()["joints"], self.stops, strict=True):
            wiring = joint["wiring"]
            near = {
                "torque_constant": joint["torque_constant"] * rng.uniform(0.97, 1.03),
                "rotor_inertia": joint["rotor_inertia"] * rng.uniform(0.8, 1.2),
                "half_gap": rng.uniform(0.003, 0.012),
                "gear_stiffness": rng.uniform(600.0, 2000.0),
            }
            friction = {k: float(v * rng.uniform(0.7, 1.4)) for k, v in joint["friction"].items()}
            kept = {k: v for k, v in wiring.items() if k != "profile"}
            joints.append(
                {"name": joint["name"], "drive": PROFILE, **kept, "friction": friction,
                 **{k: float(v) for k, v in near.items()}, "lower": lower, "upper": upper,
                 "brake": True}
            )  # fmt: skip
        return {
            "urdf": URDF,
            "joints": joints,
            "drives": {PROFILE: self.make.truth(EDS)},
            "settings": {"seed": self.seed},
        }

    def write(self, folder: Path) -> Path:
        """Write all files of a right configuration to a folder, anew; returns it."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / URDF).write_text(self.urdf)
        (folder / EDS).write_text(self.make.eds())
        (folder / "config.yaml").write_text(in_yaml(self.configuration()))
        (folder / "simulation.yaml").write_text(in_yaml(self.truth()))
        return folder


def in_yaml(data: Any) -> str:
    """Text of a configuration, fields in their order."""
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=1000)


def generate(seed: int) -> GeneratedArm:
    """The arm of a seed; the make goes round with it."""
    rng = np.random.default_rng((seed, 22))
    n = int(rng.integers(4, 8))
    hanging = bool(rng.integers(2))
    bodies = tuple(
        Body(round(float(rng.uniform(0.9, 1.5)) * 1.4 * 0.72**i, 3),
             round(float(rng.uniform(0.8, 1.2)) * 0.26 * 0.8**i, 3))
        for i in range(n)
    )  # fmt: skip
    # As CAD programs have them, limits are seldom alike on both sides.
    ranges = [(-round(float(rng.uniform(1.2, 1.5)), 2), round(float(rng.uniform(1.6, 2.2)), 2))
              for _ in range(n)]  # fmt: skip
    urdf = urdf_of(_NAMES, _AXES, bodies, ranges, hanging=hanging)
    make = MAKES[seed % len(MAKES)]
    joints = _joints(rng, urdf, ranges)
    return GeneratedArm(seed, hanging, make, bodies, urdf, tuple(ranges), joints)


def _joints(
    rng: np.random.Generator, urdf: str, ranges: list[tuple[float, float]]
) -> tuple[dict[str, Any], ...]:
    """Joints whose motors carry the arm with some room, as one who built it chose them."""
    names = _NAMES[: len(ranges)]
    model = Model(urdf, names)
    poses = rng.uniform(model.lower, model.upper, (400, len(names)))
    gravity = np.max([np.abs(model.gravity(q)) for q in poses], axis=0)
    inertia = np.max([model.inertia(q) for q in poses], axis=0)
    nodes = rng.permutation(np.arange(1, 60))[: len(names)]
    joints = []
    for i, name in enumerate(names):
        gear = float(rng.choice(_GEARS))
        motor = 1.8 * float(gravity[i]) + 5.0 * float(inertia[i]) + 2.5
        constant = round(float(rng.uniform(0.03, 0.06)) * 0.8 * gear, 2)
        most = round(motor / constant, 2)
        rated = round(0.5 * most, 2)
        shaft = constant * rated / gear
        usual = float(rng.uniform(0.6, 1.6)) * 3e-4 * shaft ** (5 / 3) * gear**2
        # No velocity loop is stable in the gap whose rotor is much lighter than the link.
        rotor = float(f"{max(usual, 0.15 * float(inertia[i])):.3g}")
        lower, upper = ranges[i]
        joint: dict[str, Any] = {
            "name": name,
            "wiring": {
                "node": int(nodes[i]), "profile": PROFILE, "gear": gear,
                "rated_current_A": rated, "max_current_A": most,
                "motor_sign": int(rng.choice((-1, 1))), "link_sign": int(rng.choice((-1, 1))),
                "link_offset": round(float(rng.uniform(-1.0, 1.0)), 4),
            },
            "torque_constant": constant,
            "rotor_inertia": rotor,
            "half_gap": round(float(rng.uniform(0.002, 0.012)), 4),
            "friction": {
                "motor_coulomb": round(0.03 * motor, 3), "motor_viscous": round(0.02 * motor, 3),
                "link_coulomb": round(0.004 * motor, 3), "link_viscous": round(0.003 * motor, 3),
            },
            "thresholds": {"contact": round(0.12 * motor, 2), "collision": round(0.7 * motor, 2)},
            "limits": {
                "lower": round(lower + 0.05, 2), "upper": round(upper - 0.05, 2),
                "velocity": 1.0, "acceleration": 3.0, "quick_stop": 8.0,
            },
            "admittance_gain": 0.2,
        }  # fmt: skip
        joints.append(joint)
    return tuple(joints)


def urdf_of(
    names: Sequence[str],
    axes: Sequence[str],
    bodies: Sequence[Body],
    ranges: Sequence[tuple[float, float]],
    *,
    hanging: bool = False,
) -> str:
    """URDF of a chain: joints with axes and limits [rad], each at the end of the rod before it."""
    parts = ['<?xml version="1.0"?>', '<robot name="generated">', '  <link name="world"/>']
    parent, place = "world", "0 0 0"
    for i, (body, (lower, upper)) in enumerate(zip(bodies, ranges, strict=True)):
        name, across = names[i], body.inertia
        rpy = f"{pi:.9g} 0 0" if hanging and i == 0 else "0 0 0"
        parts += [
            f'  <joint name="{name}" type="revolute">',
            f'    <parent link="{parent}"/><child link="{name}_link"/>',
            f'    <origin xyz="{place}" rpy="{rpy}"/>',
            f'    <axis xyz="{axes[i]}"/>',
            f'    <limit lower="{lower}" upper="{upper}" velocity="3" effort="100"/>',
            "  </joint>",
            f'  <link name="{name}_link">',
            "    <inertial>",
            f'      <origin xyz="0 0 {0.5 * body.length:.4f}" rpy="0 0 0"/>',
            f'      <mass value="{body.mass}"/>',
            f'      <inertia ixx="{across[0]:.3g}" ixy="0" ixz="0" iyy="{across[0]:.3g}" iyz="0" '
            f'izz="{across[1]:.3g}"/>',
            "    </inertial>",
            "  </link>",
        ]
        parent, place = f"{name}_link", f"0 0 {body.length}"
    return "\n".join([*parts, "</robot>", ""])
