"""Edits of a configuration and of its URDF that must be refused, with the words expected."""

# The edit (old, new) and a mark in the line that must be named; then the path in the file, and what
# the message must say of what is wrong and allowed.
BROKEN: dict[str, tuple[str, str, str, str, tuple[str, ...]]] = {
    "unknown axis of a guide": (
        "admittance:\n", "admittance:\n  stiff: [y, w]\n", "  stiff: [",
        "admittance.stiff[1]", ("rx, ry, rz, x, y, z, not 'w'",),
    ),
    "axis both free and stiff": (
        "admittance:\n", "admittance:\n  stiff: [x, y]\n  free: [x]\n", "  stiff: [x, y]",
        "admittance", ("x named twice: an axis is free or damped or held",),
    ),
    "guide that holds nothing": (
        "admittance:\n", "admittance:\n  free: [x]\n", "  free: [x]",
        "admittance", ("free alone holds nothing: name what is stiff, held or damped",),
    ),
    "guide along the axes of no link": (
        "admittance:\n", "admittance:\n  stiff: [x]\n  frame: palm\n", "  frame: palm",
        "admittance.frame", ("no link 'palm'", "or it is tool or base"),
    ),
    "pose of an unknown joint": (
        "control: {position_gain: 8.0}",
        "poses:\n  home:\n    LElbow: 0.1\ncontrol: {position_gain: 8.0}", "    LElbow: 0.1",
        "poses.home.LElbow", ("no such joint", "LElbowRoll"),
    ),
    "pose outside the limits": (
        "control: {position_gain: 8.0}",
        "poses:\n  home:\n    LElbowYaw: 0.1\ncontrol: {position_gain: 8.0}", "    LElbowYaw: 0.1",
        "poses.home.LElbowYaw", ("0.1 rad is outside its limits [-1.53, -0.04]",),
    ),
    "empty pose": (
        "control: {position_gain: 8.0}", "poses: {home: {}}\ncontrol: {position_gain: 8.0}",
        "poses: {home: {}}",
        "poses.home", ("1",),
    ),
    "pose that reads like a target": (
        "control: {position_gain: 8.0}",
        "poses: {a=1: {LElbowYaw: -0.1}}\ncontrol: {position_gain: 8.0}", "poses: {a=1",
        "poses.a=1", ("choose another name",),
    ),
    "unknown key": (
        "control: {position_gain: 8.0}", "control: {position_gian: 8.0}", "position_gian",
        "control", ("unknown key `position_gian`", "allowed: position_gain"),
    ),
    "unknown key of a joint": (
        "    half_gap: 0.003", "    half_gap: 0.003\n    halfgap: 0.003", "    halfgap: 0.003",
        "joints[2] (LElbowRoll)", ("unknown key `halfgap`", "half_gap", "torque_constant"),
    ),
    "duplicate key": (
        "    rotor_inertia: 0.03", "    rotor_inertia: 0.03\n    rotor_inertia: 0.04",
        "    rotor_inertia: 0.04",
        "", ("key `rotor_inertia` is given twice", "first in line"),
    ),
    "missing key": (
        "period_ms: 10\n", "", "version: 1",
        "the file", ("missing required field `period_ms`",),
    ),
    "missing key of a joint": (
        "    torque_constant: 3.09\n", "", "- name: LElbowRoll",
        "joints[2] (LElbowRoll)", ("missing required field `torque_constant`",),
    ),
    "wrong type": (
        "torque_constant: 4.77", "torque_constant: strong", "torque_constant: strong",
        "joints[0] (LShoulderPitch).torque_constant", ("must be a number, not 'strong'",),
    ),
    "a truth is no number": (
        "half_gap: 0.018", "half_gap: true", "half_gap: true",
        "joints[0] (LShoulderPitch).half_gap", ("must be a number, not true",),
    ),
    "a half-gap below zero": (
        "half_gap: 0.018", "half_gap: -0.001", "half_gap: -0.001",
        "joints[0] (LShoulderPitch).half_gap", ("must be a number of at least 0 rad, not -0.001",),
    ),
    "an octal number of YAML 1.1": (
        "node: 7,", "node: 010,", "node: 010",
        "joints[6] (LWristPitch).wiring.node", ("must be a whole number, not '010'",),
    ),
    "minutes and seconds of YAML 1.1": (
        "max_duration_s: 120.0", "max_duration_s: 2:00", "2:00",
        "admittance.max_duration_s", ("must be a number, not '2:00'",),
    ),
    "out of range": (
        "control: {position_gain: 8.0}", "control: {position_gain: 40.0}", "position_gain",
        "control.position_gain", ("must be a number of at most 15, not 40.0",),
    ),
    "not one of the words": (
        "admittance_gain: 0.5", "admittance_gain: 0.5\n    end: fall", "end: fall",
        "joints[2] (LElbowRoll).end", ("must be one of brake, hold, limp, not 'fall'",),
    ),
    "not one of the PDOs": (
        '"2": [link_position, motor_position]', '"5": [link_position, motor_position]',
        '"5": [link_position',
        "drives.two_encoder_drive.tpdo", ("unknown key `5` (allowed: 1, 2, 3, 4)",),
    ),
    "not one of the entries of a PDO": (
        '"2": [link_position, motor_position]', '"2": [link_position, Motor_position]',
        '"2": [link_position, Motor_position]',
        "drives.two_encoder_drive.tpdo.2[1]",
        ("must be one of controlword, current,", "not 'Motor_position'"),
    ),
    "a limit beyond what setpoints can say": (
        "{object: 0x60FF, type: INTEGER32, scale: 0.01",
        "{object: 0x60FF, type: INTEGER32, scale: 0.00000001", "target_velocity: ",
        "drives.two_encoder_drive.target_velocity.scale",
        ("joint LShoulderPitch: INTEGER32 counts reach from -0.1", "times limits.velocity is 2"),
    ),
    "a limit beyond what is measured": (
        "{object: 0x606C, type: INTEGER32, scale: 0.01",
        "{object: 0x606C, type: INTEGER32, scale: 0.00000001", "motor_velocity: ",
        "drives.two_encoder_drive.motor_velocity.scale",
        ("INTEGER32 counts reach from -0.1", "times limits.velocity is 2"),
    ),
    "positions beyond the encoder's counts": (
        "type: INTEGER32, scale: 4.793689960306688e-05",
        "type: INTEGER32, scale: 1e-09, offset: 0.1", "{node: 3,",
        "joints[2] (LElbowRoll).wiring.gear",
        ("link_position: INTEGER32 counts reach from -2.047 to 2.247", "-2.05 and 2.05"),
    ),
    "setpoints too coarse": (
        "{object: 0x60FF, type: INTEGER32, scale: 0.01",
        "{object: 0x60FF, type: INTEGER32, scale: 40.01", "target_velocity: ",
        "drives.two_encoder_drive.target_velocity.scale",
        ("one count is 0.2", "at most 0.25 of limits.velocity (1) is allowed"),
    ),
    "not one of the reactions": (
        "contact: admittance,", "contact: hug,", "contact: hug,",
        "reactions.contact",
        ("must be one of report, admittance, retract, release, hold, quick_stop, not 'hug'",),
    ),
    "not a number": (
        "acceleration: 5.0", "acceleration: .nan", ".nan",
        "", (".nan is not allowed", "must be finite"),
    ),
    "beyond all numbers": (
        "acceleration: 5.0", "acceleration: 1e999", "1e999",
        "", ("1e999 is not allowed", "must be finite"),
    ),
    "joint that the URDF lacks": (
        "- name: LWristYaw", "- name: LThumb", "- name: LThumb",
        "joints[5] (LThumb).name", ("arm.urdf has no joint of this name that moves", "LWristYaw"),
    ),
    "two joints of one name": (
        "- name: LWristYaw", "- name: LWristRoll", "- name: LWristRoll",
        "joints[4] (LWristRoll).name", ("two joints have this name",),
    ),
    "two drives with one node": (
        "node: 5,", "node: 4,", "node: 4,",
        "joints[3] (LElbowYaw).wiring.node",
        ("node 4 is also that of LWristRoll", "a node id of its own"),
    ),
    "a drive on the master's node": (
        "bitrate: 1000000}", "bitrate: 1000000, master_node: 6}", "node: 6,",
        "joints[5] (LWristYaw).wiring.node", ("node 6 is the master's",),
    ),
    "no such profile": (
        "node: 1, profile: two_encoder_drive", "node: 1, profile: one_encoder_drive",
        "one_encoder_drive",
        "joints[0] (LShoulderPitch).wiring.profile",
        ("no drive profile `one_encoder_drive`", "there are: two_encoder_drive"),
    ),
    "a residual that rings": (
        "gain: 25.0", "gain: 200.0", "gain: 200.0",
        "estimator.gain", ("T K must be less than 2", "less than 200 /s"),
    ),
    "a residual twice": (
        "beside: [{kind: classical, friction: false, rotor_inertia: false, label: classical}]",
        "beside: [{kind: backlash}]", "beside: [",
        "estimator.beside", ("backlash is listed twice",),
    ),
    "a residual of two masses without the second": (
        "residual: {kind: backlash}", "residual: {kind: two_mass, rotor_inertia: false}",
        "residual: {",
        "estimator", ("has only one mass: choose classical",),
    ),
    "a range of pre-sliding from its end": (
        "gain: 25.0", "gain: 25.0\n  presliding: [0.002, 0.0001]", "presliding: [",
        "estimator.presliding", ("[0.002, 0.0001] rad", "must be [minimum, maximum]"),
    ),
    "contact at the collision level": (
        "contact: 0.8, collision: 6.0", "contact: 0.8, collision: 0.8", "collision: 0.8",
        "joints[0] (LShoulderPitch).thresholds.contact", ("0.8 must be less than collision (0.8)",),
    ),
    "a least level that learning may not leave": (
        "collision: 6.0, least: 0.16", "collision: 6.0, least: 0.1", "least: 0.1",
        "joints[0] (LShoulderPitch).thresholds.least",
        ("0.1 must be 0.16 to 0.8 Nm", "0.2 to 1 times contact"),
    ),
    "a least level in words": (
        "collision: 6.0, least: 0.16", "collision: 6.0, least: none", "least: none",
        "joints[0] (LShoulderPitch).thresholds.least",
        ("must be a number or left out, not 'none'",),
    ),
    "limits upside down": (
        "lower: -1.40, upper: 2.18", "lower: 2.18, upper: -1.40", "lower: 2.18",
        "joints[0] (LShoulderPitch).limits.lower", ("2.18 must be less than upper (-1.4)",),
    ),
    "limits beyond the URDF": (
        "lower: -0.39, upper: 1.10", "lower: -0.39, upper: 1.20", "upper: 1.20",
        "joints[1] (LShoulderYaw).limits",
        ("[-0.39, 1.2] goes beyond the URDF's [-0.430472, 1.14032] rad",),
    ),
    "a link in a gap that is to move with its motor": (
        "gain: 25.0",
        "gain: 25.0\n  link_velocity: motor",
        "half_gap:",
        "joints[0] (LShoulderPitch).half_gap",
        ("must be 0 with estimator.link_velocity: motor",),
    ),
    "a spring without a gap": (
        "    half_gap: 0.0\n", "    half_gap: 0.0\n    gap_spring: {stiffness: 5}\n", "gap_spring:",
        "joints[4] (LWristRoll).gap_spring", ("must be zero where half_gap is 0",),
    ),
    "a bus that is too slow": (
        "bitrate: 1000000", "bitrate: 125000", "bitrate: 125000",
        "bus.bitrate", ("bus load", "125000 bit/s", "at most 80%"),
    ),
    "no EDS": (
        "eds: drive.eds", "eds: other.eds", "eds: other.eds",
        "drives.two_encoder_drive.eds", ("other.eds: cannot be read: No such file or directory",),
    ),
    "an EDS without a name": (
        "eds: drive.eds", 'eds: ""', "eds: ",
        "drives.two_encoder_drive.eds", ("must be text of at least 1 character, not ''",),
    ),
    "an object below those of CiA 402": (
        "object: 0x60E4, subindex: 1", "object: 0x60E, subindex: 1", "link_position: ",
        "drives.two_encoder_drive.link_position.object",
        ("must be a whole number of at least 0x1000, not 0x60e",),
    ),
    "object that the EDS lacks": (
        "object: 0x60E4, subindex: 1", "object: 0x60E5, subindex: 1", "link_position: ",
        "drives.two_encoder_drive.link_position", ("drive.eds", "0x60E5:01"),
    ),
    "a master that is forgotten too soon": (
        "master_timeout_ms: 100", "master_timeout_ms: 20", "master_timeout_ms: 20",
        "drives.two_encoder_drive.master_timeout_ms",
        ("20 ms must be at least three periods (30 ms)",),
    ),
    "no motor position to measure": (
        '"2": [link_position, motor_position]', '"2": [link_position]', "node: 1,",
        "joints[0] (LShoulderPitch).wiring.profile", ("sends no motor_position", "integrated"),
    ),
    "trajectory of an unknown joint": (
        "    LShoulderPitch: {amplitude", "    RShoulderPitch: {amplitude", "RShoulderPitch: {",
        "trajectory.sinusoids.RShoulderPitch", ("no such joint", "there are: LShoulderPitch"),
    ),
    "trajectory that is too fast": (
        "frequency_Hz: 0.15", "frequency_Hz: 0.5", "frequency_Hz: 0.5",
        "trajectory.sinusoids.LShoulderPitch", ("speed of 1.1 rad/s", "above the limit 1"),
    ),
    "trajectory that turns too fast": (
        "{amplitude: 0.35, frequency_Hz: 0.15}", "{amplitude: 0.05, frequency_Hz: 1.43}",
        "frequency_Hz: 1.43",
        "trajectory.sinusoids.LShoulderPitch", ("acceleration of 4.04 rad/s2", "above the limit 4"),
    ),
    "trajectory that starts too fast": (
        "ramp_s: 2.0\n  sinusoids:\n    LShoulderPitch: {amplitude: 0.35, frequency_Hz: 0.15}",
        "ramp_s: 0.1\n  sinusoids:\n    LShoulderPitch: {amplitude: 0.5, frequency_Hz: 0.15}",
        "frequency_Hz: 0.15",
        "trajectory.sinusoids.LShoulderPitch",
        ("acceleration of 4.73 rad/s2 (a soft start included)", "above the limit 4"),
    ),
    "an end that systemd would cut short": (
        "stop_timeout_s: 3.0", "stop_timeout_s: 26.0", "stop_timeout_s: 26.0",
        "supervisor.stop_timeout_s", ("must be a number of at most 25, not 26.0",),
    ),
    "trajectory that does not fit": (
        "    LShoulderPitch: {amplitude: 0.35, frequency_Hz: 0.15}",
        "    LWristYaw: {amplitude: 0.41, frequency_Hz: 0.1}", "amplitude: 0.41",
        "trajectory.sinusoids.LWristYaw",
        ("its swing of 0.82 rad does not fit between the limits -0.4 and 0.4",),
    ),
    "a file and sinusoids": (
        "  ramp_s: 2.0", "  ramp_s: 2.0\n  file: move.csv", "file: move.csv",
        "trajectory.file", ("`move.csv`", "either a file or sinusoids"),
    ),
    "another version": (
        "version: 1", "version: 2", "version: 2",
        "version", ("must be 1, not 2",),
    ),
    "a key that is a number": (
        '"1": [controlword, target_velocity]', "1: [controlword, target_velocity]",
        " 1: [controlword",
        "", ("must be text",),
    ),
}  # fmt: skip

# What is edited in arm.urdf, everywhere (a pattern, what takes its place), and what the message
# must say of what is wrong and allowed.
BROKEN_URDF: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "no masses": (
        r"(?s)<inertial>.*?</inertial>", "",
        ("nothing that joint 'LShoulderPitch' moves has a mass", "needs an <inertial>"),
    ),
    "no mass at the hand": (
        r"(?s)(<link name=.l_wrist.>\s*)<inertial>.*?</inertial>", r"\1",
        ("nothing that joint 'LWristPitch' moves has a mass",),
    ),
    "masses below zero": (
        '<mass value="', '<mass value="-',
        ("'LShoulderPitchLink', line 23", "mass of -0.69402 kg must not be negative"),
    ),
    "a mass with its unit": (
        'value="0.57151"', 'value="0.57151 kg"',
        ("'LShoulderYawLink', line 39", '<mass value="0.57151 kg">', "must be one finite number"),
    ),
    "a mass that is misspelt": (
        '<mass value="0.57151"', '<masss value="0.57151"',
        ("line 37: its <inertial> has no <mass> but <origin>, <masss>, <inertia>",),
    ),
    "an inertia below zero": (
        'ixx="0.00201004"', 'ixx="-0.00201004"',
        ("line 24: its <inertia> has a principal moment of -0.00201 kg m2", "negative"),
    ),
    "a link that is misspelt": (
        '<child link="l_wrist"', '<child link="l_wirst"',
        ("joint 'LWristPitch', line 111: no link 'l_wirst' for its <child>", "l_wrist"),
    ),
    "no XML": (
        "</robot>", "",
        ("not XML that can be read: no element found: line 125",),
    ),
}  # fmt: skip
