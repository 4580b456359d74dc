"""Simulated counterpart of a robot: reads the true arm from `simulation.yaml`, and writes that file
once from a configuration, from which it is independent afterwards."""

import re
import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Any, assert_never

import msgspec
import yaml

from common.eds import read_eds
from common.errors import ConfigurationError
from common.yaml_source import read_yaml
from daemon.config.convert import convert
from daemon.config.load import Robot
from daemon.config.schema import Joint
from daemon.drives import build_setups
from drivers.canopen.codec import quantity
from drivers.canopen.settings import CanopenProfile, Quantity
from drivers.damiao.settings import DamiaoProfile
from drivers.log.settings import LogProfile
from drivers.makes import DriveProfile
from drivers.robstride.settings import RobStrideProfile
from simulator.description import ArmDescription
from simulator.profile import TURN
from simulator.supplied import in_words
from simulator.truth import (
    SimulationFile,
    TrueDrive,
    TrueEncoder,
    TrueFriction,
    TrueJoint,
    TrueUnit,
    built,
    described,
)

FILE, URDF = "simulation.yaml", "simulation.urdf"
HEAD = """\
# The true arm that `contactd simulate` simulates: docs/rehearsing.md. It shares nothing with
# config.yaml: corrections there do not change it. Settings draw the rest at random: masses,
# friction, gaps, torque constants differ by some per cent (`settings.mismatch`, `settings.seed`).
"""
NO_LINK_ENCODER = ("# {}: nothing in its EDS is a link encoder, and this simulation has none: "
                   "link_position is read at the motor.\n")  # fmt: skip
FIXED = {"target_velocity": 0x60FF, "quick_stop_deceleration": 0x6085}


def read_simulation(robot: Robot) -> SimulationFile:
    """Content of the robot's `simulation.yaml`; defaults if it is missing. Raises
    ConfigurationError."""
    path = robot.folder / FILE
    if not path.exists():
        return SimulationFile()
    source = read_yaml(path)
    simulation = convert(source, SimulationFile)
    for name in simulation.initial_position:
        if name not in robot.configuration.joint_names:
            known = ", ".join(robot.configuration.joint_names)
            line = source.line(["initial_position", name])
            raise ConfigurationError(
                f"{path}:{line}: initial_position.{name}: no such joint; there are: {known}"
            )
    return simulation


def true_arm(robot: Robot) -> tuple[ArmDescription, SimulationFile]:
    """True arm and content of the robot's `simulation.yaml`. Raises ConfigurationError, also if the
    file is missing or lacks the true arm."""
    simulation, path = read_simulation(robot), robot.folder / FILE
    if not simulation.joints:
        raise ConfigurationError(
            f"{path}: the true arm is missing (`joints`, `drives`, `urdf`): "
            f"`contactd simulate {robot.folder} --write-truth` writes them once from config.yaml"
        )
    return described(simulation, path, robot.configuration.period_s), simulation


def refused_drives(robot: Robot, simulation: SimulationFile) -> list[str]:
    """Sentences on drives of the true arm that `contactd run` will refuse, as node ID or rated
    current differ in `config.yaml`."""
    configured = {joint.name: joint.wiring for joint in robot.configuration.joints}
    found = [
        f"  {true.name}: {name} is {getattr(true, name):g} here, and "
        f"{getattr(configured[true.name], name):g} in {robot.path.name}"
        for true in simulation.joints
        if true.name in configured
        for name in ("node", "rated_current_A")
        if getattr(true, name) != getattr(configured[true.name], name)
    ]
    if not found:
        return []
    return [
        f"`contactd run` will refuse drives of this arm, as {FILE} describes it:",
        *found,
        f"To simulate the arm of {robot.path.name} instead, move {FILE} and {URDF} away, then "
        f"`contactd simulate {robot.folder} --write-truth`",
    ]


def supplied_values(description: ArmDescription) -> list[str]:
    """Sentences, one per EDS, on values of simulated drives that their EDS lacks."""
    sheets = sorted({drive.eds for drive in description.drives() if drive.eds})
    found = {eds: in_words(read_eds(eds)) for eds in sheets}
    return [
        f"{eds.name} gives no value for {len(lines)} objects; they are simulated according to CiA "
        f"301 and 402: {', '.join(lines)}. For your drive's values see its manual"
        for eds, lines in found.items()
        if lines
    ]


def write_truth(robot: Robot, at_motor: Collection[str] = ()) -> Path:
    """Write the true arm to the robot's `simulation.yaml`, with a copy of the URDF beside it, and
    return its path. at_motor: drives without a link encoder. Settings of an existing file are kept.
    Raises ConfigurationError if it has a true arm, or the drives cannot be simulated."""
    build_setups(robot)  # refuses invalid drives
    path, urdf = robot.folder / FILE, robot.folder / URDF
    simulation = read_simulation(robot)
    for there in (path if simulation.joints or simulation.drives else None, urdf):
        if there is not None and there.exists():
            raise ConfigurationError(
                f"{there} exists: it is never overwritten; to replace it by the present arm, move "
                f"{FILE} and {URDF} away first"
            )
    truth = in_yaml(as_configured(robot, at_motor))
    before = path.read_text(encoding="utf-8").rstrip() + "\n" if path.exists() else HEAD
    shutil.copyfile(robot.folder / robot.configuration.urdf, urdf)
    before += "".join(NO_LINK_ENCODER.format(name) for name in at_motor)
    path.write_text(f"{before}urdf: {URDF}\n{truth}", encoding="utf-8")
    return path


def in_yaml(simulation: SimulationFile) -> str:
    """YAML text of `joints` and `drives`, without fields at their defaults."""
    data = {
        "joints": [_stated(joint) for joint in simulation.joints],
        "drives": {name: _stated(drive) for name, drive in simulation.drives.items()},
    }
    text = yaml.safe_dump(data, sort_keys=False, width=110, default_flow_style=None)
    return re.sub(r"object: (\d+)", lambda found: f"object: 0x{int(found[1]):04X}", text)


def _stated(part: msgspec.Struct) -> dict[str, Any]:
    fields = {f.name: getattr(part, f.name) for f in msgspec.structs.fields(part)
              if getattr(part, f.name) not in (f.default, {}, [])}  # fmt: skip
    return {k: _stated(v) if isinstance(v, msgspec.Struct) else v for k, v in fields.items()}


# --- an arm that is its configuration -------------------------------------------------------------


def as_configured(robot: Robot, at_motor: Collection[str] = ()) -> SimulationFile:
    """True arm that equals its configuration. at_motor: drives without a link encoder. Identified
    values are not used, as the arm would change with every identification. Raises
    ConfigurationError for features that the simulator lacks.
    """
    configuration = (robot.by_hand or robot).configuration
    for joint in configuration.joints:
        if joint.body is not None:
            raise ConfigurationError(
                f"{robot.path}: joints.{joint.name}.body: the simulated arm has the URDF's masses; "
                "write these to the URDF"
            )
    model = robot.model
    return SimulationFile(
        joints=[
            msgspec.structs.replace(
                _true_joint(joint, float(model.lower[i]), float(model.upper[i])),
                **_true_motor(configuration.drives[joint.wiring.profile]),
            )
            for i, joint in enumerate(configuration.joints)
        ],
        drives={
            name: _true_drive(robot, name, profile, encoder=name not in at_motor)
            for name, profile in configuration.drives.items()
            if isinstance(profile, CanopenProfile)
        },
    )


def _true_motor(profile: DriveProfile) -> dict[str, Any]:
    """Fields of a joint with an integrated motor: its model, and registers as configured."""
    if isinstance(profile, CanopenProfile | LogProfile):
        return {}
    ranges = profile.position_max, profile.velocity_max, profile.torque_max_Nm
    if isinstance(profile, DamiaoProfile):
        make, registers = "damiao", dict(zip(("PMAX", "VMAX", "TMAX"), ranges, strict=True))
    elif isinstance(profile, RobStrideProfile):
        make, registers = "robstride", dict(zip(("P_MAX", "V_MAX", "T_MAX"), ranges, strict=True))
        registers["zero_sta"] = 1.0
    else:
        assert_never(profile)
    return {"drive": f"{make}:{profile.model}", "registers": registers}


def _true_joint(joint: Joint, lower: float, upper: float) -> TrueJoint:
    """True joint, with end stops at the URDF's limits; the daemon's limits lie inside."""
    wiring = joint.wiring
    friction = {name: getattr(joint.friction, name) for name in TrueFriction.__struct_fields__}
    return TrueJoint(
        name=joint.name,
        drive=wiring.profile,
        **{
            name: getattr(wiring, name)
            for name in ("node", "gear", "rated_current_A", "max_current_A", "motor_sign",
                         "link_sign", "link_offset")
        },
        **{n: getattr(joint, n) for n in ("torque_constant", "rotor_inertia", "half_gap")},
        friction=TrueFriction(**friction),
        lower=lower,
        upper=upper,
        brake=joint.end == "brake",
    )  # fmt: skip


def _true_drive(robot: Robot, name: str, profile: CanopenProfile, *, encoder: bool) -> TrueDrive:
    """True drive; encoder: True if it has one at the link."""
    for entry, index in FIXED.items():
        where: Quantity = getattr(profile, entry)
        if where.object != index or where.sign != 1 or where.offset != 0.0:
            raise ConfigurationError(
                f"{robot.path}: drives.{name}.{entry}: 0x{where.object:04X} with sign {where.sign} "
                f"and offset {where.offset:g} cannot be simulated; simulated drives have it on "
                f"0x{index:04X}, with sign 1 and no offset"
            )
    motor, limit = profile.motor_position, profile.max_motor_speed
    return TrueDrive(
        eds=profile.eds,
        link_position=_encoder(profile.link_position),
        link_encoder=encoder,
        motor_position=None if motor is None else _encoder(motor),
        motor_velocity=_unit(profile.motor_velocity),
        effort=_unit(quantity(profile, profile.effort)),
        target_velocity_unit=profile.target_velocity.scale,
        deceleration_unit=profile.quick_stop_deceleration.scale,
        speed_limit=None if limit is None else _unit(limit),
    )


def _encoder(where: Quantity) -> TrueEncoder:
    """True encoder: value = sign * (offset + scale * counts) is 0 at -offset / scale counts."""
    return TrueEncoder(
        object=where.object,
        subindex=where.subindex,
        counts=where.sign * round(TURN / where.scale),
        zero=round(-where.offset / where.scale),
    )


def _unit(where: Quantity) -> TrueUnit:
    return TrueUnit(object=where.object, subindex=where.subindex, unit=where.scale, sign=where.sign)


def describe(robot: Robot, simulation: SimulationFile) -> ArmDescription:
    """Arm that equals its configuration, with drives of a make known by product code, for rigs that
    simulate what they configure. Raises ConfigurationError."""
    configuration = (robot.by_hand or robot).configuration
    model = robot.model
    profiles = {joint.wiring.profile for joint in configuration.joints}
    if not all(isinstance(each, CanopenProfile) for each in configuration.drives.values()):
        start = simulation.initial_position
        truth = msgspec.structs.replace(as_configured(robot), urdf=configuration.urdf)
        truth = msgspec.structs.replace(truth, initial_position=start)
        return described(truth, robot.path, configuration.period_s)
    if len(profiles) > 1:
        raise ConfigurationError(
            f"{robot.path}: drives: the joints use {', '.join(sorted(profiles))}; only one profile "
            "can be simulated"
        )
    return ArmDescription(
        urdf=robot.folder / configuration.urdf,
        eds=robot.folder / configuration.drives[profiles.pop()].files[0],
        joints=tuple(
            built(
                _true_joint(joint, float(model.lower[i]), float(model.upper[i])),
                simulation.initial_position.get(joint.name, 0.0),
            )
            for i, joint in enumerate(configuration.joints)
        ),
        period_s=configuration.period_s,
    )
