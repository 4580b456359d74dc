"""Draft of a configuration from a URDF and the EDS of its drives: every value that they do not
contain is a guess with which the motors hold the arm, marked `# CHECK`, so that the draft passes
`contactd check`."""

from collections.abc import Mapping

import numpy as np

from common.arrays import Vector
from common.errors import ConfigurationError, ModelError
from common.yaml_source import quoted
from daemon.config.mistakes import urdf_mistakes
from daemon.config.problem import figure
from estimator.model import Model
from estimator.urdf import JointRange, joint_ranges
from programs.contactd.drafts.drive import DraftedDrive
from programs.contactd.drafts.scales import GEAR

MARK = "# CHECK"
SHAFT_CONSTANT = 0.04  # of usual motors [Nm/A]
INSIDE = 0.05  # of the URDF's limits [rad], at most a tenth of the range
PEAK = 1.8  # times the rated current
SLOWLY = 0.5  # [rad/s]
POSITION_GAIN = 4.0  # [1/s]
FRICTION_OFF = 0.3  # most by which levels are raised, as friction is a guess [Nm]
STRONGEST = 3000.0  # [Nm] at a joint: an arm beyond this is not one that a person may touch


def guesses(text: str) -> int:
    """Lines of a configuration that are marked as guesses."""
    return sum(MARK in line for line in text.splitlines())


HEAD = """\
# Draft by `contactd new`. Every line with CHECK holds a guess: look it up, correct it, and remove
# the mark. `contactd check --explain FIELD` describes a field and how to find its value.
# To be filled in by hand: node ids, gears, currents and torque constants (data sheets); the size of
# counts (the drives' manual). Signs, zeros, gaps, friction and levels are found by
# `contactd identify` (docs/commissioning.md); guesses suffice until then.
"""


def draft(
    name: str, urdf: str, urdf_name: str, drives: Mapping[str, tuple[str, DraftedDrive]]
) -> str:
    """Text of `config.yaml`. drives: (EDS file, draft) by the profile's name; of several, each
    joint gets the next, and the remaining joints the last. Raises ConfigurationError for a URDF
    without usable joints."""
    ranges = _moving(urdf, urdf_name)
    if len(drives) > len(ranges):
        raise ConfigurationError(
            f"--eds: {len(drives)} drives ({', '.join(drives)}), and {urdf_name} has only "
            f"{len(ranges)} joints that move"
        )
    motors, inertias = _loads(urdf, urdf_name, [one.joint for one in ranges])
    profiles = "\n".join(drive.text(key, eds) for key, (eds, drive) in drives.items())
    names = list(drives)
    sent = all("motor_position" in drive.quantities for _, drive in drives.values())
    measured = "measured" if sent else "integrated"
    joints = "\n".join(
        _joint(
            i,
            one,
            float(motors[i]),
            float(inertias[i]),
            names[min(i, len(names) - 1)],
            drives[names[min(i, len(names) - 1)]][1],
            several=len(names) > 1,
        )
        for i, one in enumerate(ranges)
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
  motor_position: {measured}

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


def _loads(urdf: str, urdf_name: str, names: list[str]) -> tuple[Vector, Vector]:
    """Torque with which each joint's motor carries the arm with a margin [Nm], and the largest
    inertia that it moves [kg m2], both (n,). Raises ConfigurationError for an arm that no motor can
    carry."""
    try:
        model = Model(urdf, names)
    except ModelError as error:
        raise ConfigurationError(f"{urdf_name}: {error}") from error
    poses = np.random.default_rng(0).uniform(model.lower, model.upper, (400, len(names)))
    gravity = np.max([np.abs(model.gravity(q)) for q in poses], axis=0)
    inertia = np.max([model.inertia(q) for q in poses], axis=0)
    motors = 2.0 * gravity + 6.0 * inertia + 1.0
    if motors.max() > STRONGEST:
        i = int(motors.argmax())
        reasons = [f"{urdf_name}, {place}: {what}" for place, what in urdf_mistakes(urdf)]
        summary = (
            f"{urdf_name}: joint {names[i]!r} would need a motor of {figure(float(motors[i]))} Nm, "
            f"at most {STRONGEST:g} can be: are masses in kg, inertias in kg m2 and lengths in m?"
        )
        raise ConfigurationError("\n".join([summary, *reasons]))
    return motors, inertia


def _joint(
    i: int, one: JointRange, motor: float, inertia: float, profile: str, drive: DraftedDrive,
    *, several: bool,
) -> str:  # fmt: skip
    """Entry of a joint whose motor can carry it."""
    inside = min(INSIDE, 0.1 * (one.upper - one.lower))
    velocity = min(SLOWLY, one.velocity or SLOWLY)
    constant = SHAFT_CONSTANT * GEAR * 0.8
    peak = min(PEAK, drive.peak or PEAK)
    rated = float(figure(motor / constant / peak))
    most = peak * rated
    # Usual for such a motor; with a far lighter rotor no velocity loop is stable in the gap.
    rotor = max(3e-4 * (constant * rated / GEAR) ** (5.0 / 3.0) * GEAR**2, 0.15 * inertia)
    named = one.joint if one.joint.isprintable() else "JOINT"  # a line break ends the comment
    gap = min(0.005, 0.01 * (one.upper - one.lower)) if drive.link_encoder else 0.0
    of_gap = f"a guess until `contactd identify gap {named}`"
    if not drive.link_encoder:
        of_gap = "no gap is found, nor used, without a link encoder: `known: {gap: ...}` states it"
    check = f"   {MARK}: which of the drives" if several else ""
    contact = 0.2 * motor + min(0.1 * motor, FRICTION_OFF)
    f = figure
    return f"""\
  - name: {quoted(one.joint)}
    wiring:
      node: {i + 1}   {MARK}: `contactd scan` lists the nodes on the bus
      profile: {quoted(profile)}{check}
      gear: {GEAR:g}   {MARK}: turns of the motor per turn of the joint
      rated_current_A: {f(rated)}   {MARK}: of the motor
      max_current_A: {f(most)}   {MARK}
    torque_constant: {f(constant)}   {MARK}: Nm at the link per A: the motor's times the gear
    rotor_inertia: {f(rotor)}   # a guess until `contactd identify friction`
    half_gap: {f(gap)}   # {of_gap}
    friction: {{motor_coulomb: {f(0.03 * motor)}, motor_viscous: {f(0.02 * motor)}}}
    thresholds: {{contact: {f(contact)}, collision: {f(1.2 * motor)}}}
    limits: {{lower: {f(one.lower + inside)}, upper: {f(one.upper - inside)}, \
velocity: {f(velocity)}, acceleration: 2, quick_stop: 6}}
    admittance_gain: 0.1
    end: brake   {MARK}: hold, where the joint has no brake
"""
