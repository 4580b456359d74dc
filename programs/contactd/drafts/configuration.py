"""Draft of a configuration from a URDF and its drives. Values that these do not contain are guessed
and marked `# CHECK`; guessed motors can hold the arm, so that the draft passes `contactd check`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import ConfigurationError, ModelError
from common.yaml_source import quoted
from daemon.config.mistakes import urdf_mistakes
from daemon.config.problem import figure
from estimator.model import Model
from estimator.urdf import JointRange, joint_ranges
from programs.contactd.drafts.drive import DraftedDrive
from programs.contactd.drafts.motor import Load
from programs.contactd.drafts.motors import DraftedMotor
from programs.identify.guesses import MARK

Draft = DraftedDrive | DraftedMotor

INSIDE = 0.05  # margin inside the URDF's limits [rad], at most a tenth of the range
SLOWLY = 0.5  # velocity limit of a draft [rad/s]
POSITION_GAIN = 4.0  # [1/s]
FRICTION_OFF = 0.3  # largest increase of contact levels for guessed friction [Nm]
STRONGEST = 3000.0  # [Nm] at a joint: more implies wrong units, or an arm too strong to be touched


def guesses(text: str) -> int:
    """Number of lines of a configuration that are marked as guesses."""
    return sum(MARK in line for line in text.splitlines())


HEAD = """\
# Draft by `contactd new`. Every line with CHECK holds a guess: look it up, correct it, and remove
# the mark. `contactd check --explain FIELD` describes a field and how to find its value.
# To be filled in by hand: what data sheets, manuals and `contactd scan` say of drives and motors.
# Signs, zeros, gaps, friction and levels are found by `contactd identify` (docs/commissioning.md);
# guesses suffice until then.
"""


@dataclass(frozen=True, slots=True)
class Plan:
    """Joints of an arm in URDF order, their loads, and the drive of each."""

    joints: Sequence[JointRange]
    loads: Sequence[Load]
    drives: Mapping[str, Draft]
    of_joint: Sequence[str]  # names of drives

    def verdicts(self) -> list[str]:
        """Sentences on whether each drive can be used at its joints."""
        found = []
        for name, drive in self.drives.items():
            its = [i for i, one in enumerate(self.of_joint) if one == name]
            at = f" (at {', '.join(self.joints[i].joint for i in its)}, CHECK)"
            verdict = drive.verdict([self.loads[i] for i in its])
            found.append(f"{name}{at if len(self.drives) > 1 else ''}: {verdict}")
        return found


def planned(urdf: str, urdf_name: str, drives: Mapping[str, Draft], order: Sequence[str]) -> Plan:
    """Plan of an arm: each joint gets the next drive in `order`, remaining joints the last one.
    Raises ConfigurationError for a URDF without usable joints."""
    ranges = _moving(urdf, urdf_name)
    if len(order) > len(ranges):
        raise ConfigurationError(
            f"{len(order)} drives ({', '.join(order)}), and {urdf_name} has only "
            f"{len(ranges)} joints that move"
        )
    loads = loads_of(urdf, urdf_name, [one.joint for one in ranges])
    return Plan(ranges, loads, drives, [order[min(i, len(order) - 1)] for i in range(len(ranges))])


def draft(name: str, urdf_name: str, plan: Plan) -> str:
    """Text of `config.yaml`."""
    drives = plan.drives
    profiles = "\n".join(
        drive.text(key, [load for load, its in zip(plan.loads, plan.of_joint, strict=True)
                         if its == key])
        for key, drive in drives.items()
    )  # fmt: skip
    measured = "measured" if all(d.sends_motor_position for d in drives.values()) else "integrated"
    rotors = all(isinstance(d, DraftedMotor) and not d.link_encoder for d in drives.values())
    by_motor = "\n  link_velocity: motor" if rotors else ""
    each = zip(plan.joints, plan.loads, plan.of_joint, strict=True)
    joints = "\n".join(
        _joint(i, one, load, its, drives[its], several=len(drives) > 1)
        for i, (one, load, its) in enumerate(each)
    )
    return f"""{HEAD}version: 1
name: {quoted(name)}
urdf: {quoted(urdf_name)}
period_ms: 10

# {MARK[2:]}: this is the simulator's; your arm's may be
# {{interface: socketcan, channel: can0, bitrate: 1000000}}
bus: {{interface: socketcand, host: 127.0.0.1, port: 29536, channel: can0, bitrate: 1000000}}

drives:
{profiles}
joints:
{joints}
estimator:
  motor_position: {measured}{by_motor}

# Low: with play in the gears a fast loop oscillates. Raise it when the arm is identified.
control: {{position_gain: {POSITION_GAIN:g}}}
"""


def _moving(urdf: str, urdf_name: str) -> list[JointRange]:
    try:
        ranges = joint_ranges(urdf)
    except ModelError as error:
        raise ConfigurationError(f"{urdf_name}: {error}") from error
    if not ranges:
        raise ConfigurationError(f"{urdf_name}: no joint moves; make those that do `revolute`")
    for one in ranges:
        if one.kind != "revolute":
            raise ConfigurationError(
                f"{urdf_name}, line {one.line}: joint {one.joint!r} is {one.kind or 'of no type'}: "
                "a joint that has a drive must be `revolute`, with a <limit>; make others `fixed`"
            )
        if not one.lower < one.upper:
            raise ConfigurationError(
                f"{urdf_name}, line {one.line}: joint {one.joint!r} has limits {one.lower:g} to "
                f"{one.upper:g} rad: lower must be less than upper"
            )
    return ranges


def loads_of(urdf: str, urdf_name: str, names: list[str]) -> list[Load]:
    """Worst-case loads of the joints over random poses. Raises ConfigurationError for an arm that
    no motor can carry."""
    try:
        model = Model(urdf, names)
    except ModelError as error:
        raise ConfigurationError(f"{urdf_name}: {error}") from error
    poses = np.random.default_rng(0).uniform(model.lower, model.upper, (400, len(names)))
    gravity = np.max([np.abs(model.gravity(q)) for q in poses], axis=0)
    inertia = np.max([model.inertia(q) for q in poses], axis=0)
    loads = [Load(float(g), float(j)) for g, j in zip(gravity, inertia, strict=True)]
    motors = [load.torque for load in loads]
    if max(motors) > STRONGEST:
        i = motors.index(max(motors))
        reasons = [f"{urdf_name}, {place}: {what}" for place, what in urdf_mistakes(urdf)]
        summary = (
            f"{urdf_name}: joint {names[i]!r} would need a motor of {figure(motors[i])} Nm, "
            f"at most {STRONGEST:g} is allowed: are masses in kg, inertias in kg m2, lengths in m?"
        )
        raise ConfigurationError("\n".join([summary, *reasons]))
    return loads


def _joint(
    i: int, one: JointRange, load: Load, profile: str, drive: Draft, *, several: bool
) -> str:
    """`joints` entry of config.yaml, with a motor that can carry the joint."""
    inside = min(INSIDE, 0.1 * (one.upper - one.lower))
    velocity = min(SLOWLY, one.velocity or SLOWLY)
    motor = drive.motor(load)
    named = one.joint if one.joint.isprintable() else "JOINT"  # a line break ends the comment
    gap = min(0.005, 0.01 * (one.upper - one.lower)) if drive.link_encoder else 0.0
    of_gap = f"a guess until `contactd identify gap {named}`"
    if not drive.link_encoder:
        of_gap = "no gap is found, nor used, without a link encoder: `known: {gap: ...}` states it"
    known = ""
    if motor.sure and not drive.link_encoder:
        known = "\n    known: {gap: no encoder at the link shows it}"
    check = f"   {MARK}: which of the drives" if several else ""
    contact = 0.2 * motor.torque + min(0.1 * motor.torque, FRICTION_OFF)
    coulomb, viscous = map(figure, motor.friction)
    f = figure

    def mark(what: str = "") -> str:
        return "" if motor.sure else f"   {MARK}{what}"

    return f"""\
  - name: {quoted(one.joint)}
    wiring:
      node: {i + 1}   {MARK}: `contactd scan` lists what is on the bus
      profile: {quoted(profile)}{check}
      gear: {motor.gear:g}{mark(": turns of the motor per turn of the joint")}
      rated_current_A: {f(motor.rated_A)}{mark(": of the motor")}
      max_current_A: {f(motor.max_A)}{mark()}
    torque_constant: {f(motor.constant)}{mark(": Nm at the link per A: the motor's times the gear")}
    rotor_inertia: {f(motor.rotor)}   # a guess until `contactd identify friction`
    half_gap: {f(gap)}   # {of_gap}
    friction: {{motor_coulomb: {coulomb}, motor_viscous: {viscous}}}
    thresholds: {{contact: {f(contact)}, collision: {f(1.2 * motor.torque)}}}
    limits: {{lower: {f(one.lower + inside)}, upper: {f(one.upper - inside)}, \
velocity: {f(velocity)}, acceleration: 2, quick_stop: 6}}
    admittance_gain: 0.1
    end: {motor.end}{mark(": hold, where the joint has no brake")}{known}
"""
