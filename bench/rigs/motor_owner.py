"""Owner of a hanging arm of motors on CAN, which have no EDS and no brake: it is limp at first."""

from dataclasses import replace
from itertools import count, islice
from typing import Any

import numpy as np

from bench.rigs.generated_arms import URDF, GeneratedArm, generate, in_yaml
from bench.rigs.owner import Owner
from bench.rigs.served_daemon import ServedDaemon
from drivers.damiao import settings as damiao
from drivers.robstride import settings as robstride
from estimator.model import Model
from simulator.hand_script import Guide, Release

ROOM = 1.3  # of its rated torque over gravity's
FRICTION = {"motor_coulomb": 0.04, "motor_viscous": 0.012, "link_coulomb": 0.004,
            "link_viscous": 0.002}  # fmt: skip
PLAY = 0.0003, 0.0015  # half a gap of gears of 2 to 10 arc minutes [rad]
SLOW = 8.0  # VMAX of every DM4340, not as published
MODELS: dict[str, dict[Any, Any]] = {"damiao": damiao.MODELS, "robstride": robstride.MODELS}


def motor_arm(seed: int, make: str = "damiao") -> GeneratedArm:
    """The hanging arm of a seed, whose joints have the smallest motors of a make that carry it."""
    models = MODELS[make]
    arm = next(islice((arm for arm in map(generate, count()) if arm.hanging), seed, None))
    rng, model = np.random.default_rng((seed, 25)), Model(arm.urdf, arm.names)
    poses = rng.uniform(model.lower, model.upper, (400, len(arm.names)))
    gravity = np.max([np.abs(model.gravity(q)) for q in poses], axis=0)
    ids, joints = rng.permutation(np.arange(1, 16)).tolist(), []
    by_torque = sorted(models, key=lambda name: models[name].rated_Nm)
    for joint, load, motor in zip(arm.joints, gravity, ids[: len(arm.joints)], strict=True):
        name = next((m for m in by_torque if models[m].rated_Nm > ROOM * load), by_torque[-1])
        f, sign = models[name], joint["wiring"]["motor_sign"]
        wiring = {"node": motor, "profile": name, "gear": f.gear, "link_sign": sign,
                  "rated_current_A": f.rated_Nm / f.torque_constant,
                  "max_current_A": f.max_current_A}  # fmt: skip
        own = {"wiring": joint["wiring"] | wiring, "torque_constant": f.torque_constant,
               "rotor_inertia": f.rotor * f.gear**2,
               "friction": {key: by * f.rated_Nm for key, by in FRICTION.items()}}  # fmt: skip
        if make == "robstride":
            own["half_gap"] = rng.uniform(*PLAY)
        joints.append(joint | own)
    return replace(arm, make=replace(arm.make, name=make), joints=tuple(joints))


class MotorOwner(Owner):
    """One owner with one such arm."""

    push, carried, seen_to_move = 0.03, True, 0.01

    def begin(self) -> None:
        """Draft by the motors' labels, fill in what the scan prints, check."""
        make = self.arm.make.name
        models = [joint["wiring"]["profile"] for joint in self.arm.joints]
        drives = [word for model in models for word in ("--drive", f"{make}:{model}")]
        self._typed("new", str(self.folder), "--urdf", str(self._desk / URDF), *drives)
        truth = self.arm.truth() | {"drives": {}}
        for joint, own, model in zip(truth["joints"], self.arm.joints, models, strict=True):
            joint |= {"drive": f"{make}:{model}", "brake": False, "registers": _registers(model)}
            joint["half_gap"] = own["half_gap"] if make == "robstride" else joint["half_gap"]
        (self.folder / "simulation.yaml").write_text(in_yaml(truth))
        self.note("contactd scan")
        self._edit(self._look_up)
        self._typed("check", str(self.folder))

    def _look_up(self, written: dict[str, Any]) -> None:
        written["drives"].get("DM4340", {})["velocity_max"] = SLOW
        for model in written["drives"].keys() & robstride.MODELS.keys():
            torque, velocity = robstride.FEEDBACK[model]  # by its manual
            written["drives"][model] |= {"torque_max_Nm": torque, "velocity_max": velocity}
        for joint, known in zip(written["joints"], self.arm.joints, strict=True):
            joint["wiring"]["node"] = known["wiring"]["node"]

    def gaps(self, served: ServedDaemon) -> None:
        """Gaps of motors whose output has an encoder."""
        if self.arm.make.name == "damiao":
            super().gaps(served)

    def zeros(self, served: ServedDaemon) -> None:
        """As others; then lead the limp links back to where they stood."""
        served.run(0.3)
        hand, stood = served.rig.arm.hand, served.rig.arm.plant.q.tolist()
        super().zeros(served)
        hand.take(Guide(at_s=0.0, to=dict(zip(self.arm.names, stood, strict=True)), speed=0.5))
        served.run(8.0)
        hand.take(Release(at_s=0.0))
        served.run(3.0)


def _registers(model: str) -> dict[str, float]:
    if model in robstride.MODELS:
        torque, velocity = robstride.FEEDBACK[model]
        return {"T_MAX": torque, "V_MAX": velocity, "zero_sta": 1}
    return {"VMAX": SLOW} if model == "DM4340" else {}
