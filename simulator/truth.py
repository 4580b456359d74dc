"""True properties of a simulated arm: schema of `simulation.yaml`, which lies beside `config.yaml`
but shares no values with it, so that correcting one does not change the other.

It states the properties fixed by the manufacturer: joints, gears, motors, friction, gaps, end
stops, and drives with their counts, units and quirks. `docs/rehearsing.md` explains it.
"""

from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from common.errors import ConfigurationError
from simulator.damiao import models as damiao
from simulator.description import (
    ArmDescription,
    DriveDescription,
    EncoderError,
    JointDescription,
    SimulationSettings,
)
from simulator.objects import key
from simulator.profile import TURN, MotorMake, SimulatedMake, refuse_incomplete
from simulator.robstride import models as robstride

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Sign = Literal[-1, 1]
Index = Annotated[int, Meta(ge=0x1000, le=0xFFFF)]
SubIndex = Annotated[int, Meta(ge=0, le=255)]
MOTORS: dict[str, Collection[str]] = {
    **dict.fromkeys((f"damiao:{model}" for model in damiao.MODELS), damiao.REGISTERS),
    **dict.fromkeys((f"robstride:{model}" for model in robstride.MODELS), robstride.PARAMETERS),
}
"""Motors with integrated controllers, by the value of a joint's `drive`, with the names of their
registers or parameters."""


class Stated(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all settings read from `simulation.yaml`."""


class TrueEncoder(Stated, frozen=True, kw_only=True):
    """Encoder of a drive."""

    object: Index
    subindex: SubIndex = 0
    counts: int  # per turn; below 0 if it counts backwards
    zero: int = 0  # counts at position 0


class TrueUnit(Stated, frozen=True, kw_only=True):
    """Quantity of a drive, and the value of one count."""

    object: Index
    subindex: SubIndex = 0
    unit: Positive  # rad/s or rad/s2 of the motor shaft, or share of the rated value
    sign: Sign = 1  # -1 if the drive counts it opposite to the motor


class Quirks(Stated, frozen=True, kw_only=True):
    """Quirks of a drive. Fixed PDOs are set in the EDS: mappings with AccessType `const`."""

    needs_nmt_reset: bool = False  # after the loss of the master (0x8130), before a fault reset
    says_over: bool = False  # it reports this error as over, but stays locked
    no_heartbeat_consumer: bool = False  # it accepts 0x1016, but monitors no heartbeat
    sdo_delay_ms: Annotated[float, Meta(ge=0, le=2000)] = 0.0  # until it answers an SDO
    boot_ms: Annotated[float, Meta(ge=0, le=60_000)] = 0.0  # from a reset to its boot-up message
    # Of the reported current; 0 is unfiltered, left out that of `settings`.
    current_filter_ms: Annotated[float, Meta(ge=0, le=50)] | None = None
    velocity_step: NotNegative = 0.0  # resolution of the velocity [rad/s of the motor]
    interpolation_ms: Annotated[float, Meta(ge=0, le=100)] = 0.0  # of setpoints, without 0x60C2


class TrueDrive(Stated, frozen=True, kw_only=True):
    """One make of drive, as fixed by its manufacturer. Setpoints are in 0x60FF, the quick stop's
    deceleration in 0x6085."""

    eds: str  # relative to this file
    link_position: TrueEncoder
    link_encoder: bool = True  # false: link_position is the motor's, behind the gear
    motor_position: TrueEncoder | None = None
    motor_velocity: TrueUnit
    effort: TrueUnit  # current or torque, share of the rated value
    target_velocity_unit: Positive  # of a count of 0x60FF [rad/s of the motor shaft]
    deceleration_unit: Positive  # of a count of 0x6085 [rad/s2 of the motor shaft]
    speed_limit: TrueUnit | None = None  # rad/s of the motor shaft
    quirks: Quirks = Quirks()


class TrueFriction(Stated, frozen=True, kw_only=True):
    """Friction at the link side; Coulomb in Nm, viscous in Nm s/rad."""

    motor_coulomb: NotNegative = 0.0
    motor_viscous: NotNegative = 0.0
    link_coulomb: NotNegative = 0.0
    link_viscous: NotNegative = 0.0


class TrueJoint(Stated, frozen=True, kw_only=True):
    """One joint as built."""

    name: str  # as in the URDF
    node: Annotated[int, Meta(ge=1, le=127)]
    drive: str  # a key of `drives`, or such as `damiao:DM4340`, `robstride:RS02`
    master_id: Annotated[int, Meta(ge=0, le=0x7FF)] | None = None  # Damiao; default: node + 16
    registers: dict[str, float] = {}  # of such a motor, or its parameters, by name
    gear: Positive  # turns of the motor per turn of the joint
    rated_current_A: Positive
    max_current_A: Positive
    torque_constant: Positive  # Nm at the link per A
    rotor_inertia: Annotated[float, Meta(ge=1e-5)]  # seen from the link [kg m2]
    half_gap: NotNegative = 0.0  # [rad]
    gear_stiffness: Positive | None = None  # beyond the gap [Nm/rad]; else settings'
    friction: TrueFriction = TrueFriction()
    lower: float  # end stop [rad]
    upper: float  # end stop [rad]
    motor_sign: Sign = 1  # -1 if the motor turns opposite to the joint
    link_sign: Sign = 1  # -1 if the link encoder counts opposite to the joint
    link_offset: float = 0.0  # joint position at which its encoder reads 0 [rad]
    encoder_errors: tuple[EncoderError, ...] = ()  # periodic with a turn
    brake: bool = False  # holds the motor whenever the drive is not energised


class SimulationFile(Stated, frozen=True, kw_only=True):
    """Contents of `simulation.yaml`. Without `joints` it describes no arm."""

    urdf: str = "simulation.urdf"  # links of the true arm, relative to this file
    initial_position: dict[str, float] = {}  # by joint [rad]; default: 0
    joints: list[TrueJoint] = []  # in the order of the URDF
    drives: dict[str, TrueDrive] = {}
    settings: SimulationSettings = SimulationSettings()


def described(truth: SimulationFile, path: Path, period_s: float) -> ArmDescription:
    """Arm described by a file at `path`. Raises ConfigurationError with file and field."""
    _refuse_impossible(truth, path)
    joints = []
    for i, joint in enumerate(truth.joints):
        start = truth.initial_position.get(joint.name, 0.0)
        if joint.drive in MOTORS:
            for name in set(joint.registers) - set(MOTORS[joint.drive]):
                at = f"{path}: joints[{i}] ({joint.name}).registers.{name}"
                raise ConfigurationError(f"{at}: there are {', '.join(MOTORS[joint.drive])}")
            joints.append(built(joint, start, _motor(joint)))
            continue
        if joint.drive not in truth.drives:
            raise ConfigurationError(
                f"{path}: joints[{i}] ({joint.name}).drive: no drive `{joint.drive}`; there are: "
                f"{', '.join([*truth.drives, *MOTORS])}"
            )
        drive, eds = truth.drives[joint.drive], path.parent / truth.drives[joint.drive].eds
        for k, error in enumerate(joint.encoder_errors):
            if error.encoder == "motor" and drive.motor_position is None:
                raise ConfigurationError(
                    f"{path}: joints[{i}] ({joint.name}).encoder_errors[{k}].encoder: motor, but "
                    f"drives.{joint.drive} has no motor_position; its velocity has no such error"
                )
        make = _make(drive, joint)
        refuse_incomplete(eds, make)
        joints.append(built(joint, start, DriveDescription(eds, make)))
    return ArmDescription(
        urdf=path.parent / truth.urdf,
        eds=(joints[0].drive and joints[0].drive.eds) or path,
        joints=tuple(joints),
        period_s=period_s,
    )


def _refuse_impossible(truth: SimulationFile, path: Path) -> None:
    """Raise ConfigurationError for contradictions between fields."""
    known = [joint.name for joint in truth.joints]
    for name in truth.initial_position:
        if name not in known:
            raise ConfigurationError(
                f"{path}: initial_position.{name}: no such joint; there are: {', '.join(known)}"
            )
    by_node: dict[int, str] = {}
    for i, joint in enumerate(truth.joints):
        at = f"{path}: joints[{i}] ({joint.name})"
        if joint.name in known[:i]:
            raise ConfigurationError(f"{at}.name: two joints have this name")
        if joint.node in by_node:
            raise ConfigurationError(
                f"{at}.node: {joint.node} is also that of {by_node[joint.node]}; each drive needs "
                "its own node ID"
            )
        by_node[joint.node] = joint.name
        if not joint.lower < joint.upper:
            raise ConfigurationError(
                f"{at}.lower: {joint.lower:g} rad must be less than upper ({joint.upper:g})"
            )
        start = truth.initial_position.get(joint.name, 0.0)
        if not joint.lower <= start <= joint.upper:
            raise ConfigurationError(
                f"{path}: initial_position.{joint.name}: {start:g} rad is not between its end "
                f"stops, {joint.lower:g} to {joint.upper:g} rad"
            )
    for name, drive in truth.drives.items():
        for field in ("link_position", "motor_position"):
            encoder: TrueEncoder | None = getattr(drive, field)
            if encoder is not None and encoder.counts == 0:
                raise ConfigurationError(
                    f"{path}: drives.{name}.{field}.counts: must not be 0 per turn; below 0 the "
                    "encoder counts backwards"
                )


def built(
    joint: TrueJoint, start: float, drive: DriveDescription | None = None
) -> JointDescription:
    """Joint as built, starting at `start` [rad], with its drive."""
    same = {name: getattr(joint, name) for name in _SAME}
    friction = msgspec.structs.asdict(joint.friction)
    return JointDescription(**same, **friction, initial_position=start, drive=drive)


_SAME = {field.name for field in fields(JointDescription)} & {*TrueJoint.__struct_fields__} - {
    "drive"
}


def _motor(joint: TrueJoint) -> DriveDescription:
    """Description of a motor with integrated controller."""
    kind, model = joint.drive.split(":")
    make: MotorMake
    if kind == "damiao":
        master_id = joint.node + 0x10 if joint.master_id is None else joint.master_id
        registers = {damiao.REGISTERS.index(name): v for name, v in joint.registers.items()}
        make = damiao.DamiaoMake(
            model, master_id, joint.motor_sign, joint.link_sign, joint.link_offset, registers
        )
    else:
        parameters = {robstride.PARAMETERS[name]: v for name, v in joint.registers.items()}
        make = robstride.RobStrideMake(model, joint.motor_sign, joint.link_offset, parameters)
    return DriveDescription(None, make.sensors(), make)


def _make(drive: TrueDrive, joint: TrueJoint) -> SimulatedMake:
    """Make as mounted in a joint, whose motor or encoder may be reversed."""
    link, motor, quirks = drive.link_position, drive.motor_position, drive.quirks
    counts = joint.link_sign * link.counts
    return SimulatedMake(
        link_position=key(link.object, link.subindex),
        motor_position=None if motor is None else key(motor.object, motor.subindex),
        motor_velocity=_key(drive.motor_velocity),
        efforts=(_key(drive.effort),),
        speed_limit=None if drive.speed_limit is None else _key(drive.speed_limit),
        link_counts=counts,
        link_at_motor=not drive.link_encoder,
        link_zero=link.zero - round(joint.link_offset * counts / TURN),
        motor_counts=joint.motor_sign * (4096 if motor is None else motor.counts),
        measured_velocity_unit=joint.motor_sign * drive.motor_velocity.sign
        * drive.motor_velocity.unit,
        effort_unit=joint.motor_sign * drive.effort.sign * drive.effort.unit,
        velocity_unit=joint.motor_sign * drive.target_velocity_unit,
        acceleration_unit=drive.deceleration_unit,
        speed_unit=1.0 if drive.speed_limit is None else drive.speed_limit.unit,
        interpolation_s=1e-3 * quirks.interpolation_ms,
        locks=quirks.needs_nmt_reset,
        says_over=quirks.says_over,
        boot_s=1e-3 * quirks.boot_ms,
        sdo_delay_s=1e-3 * quirks.sdo_delay_ms,
        hears_master=not quirks.no_heartbeat_consumer,
        current_filter_ms=quirks.current_filter_ms,
        velocity_step=quirks.velocity_step,
    )  # fmt: skip


def _key(unit: TrueUnit) -> int:
    return key(unit.object, unit.subindex)
