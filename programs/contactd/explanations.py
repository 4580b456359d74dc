"""Explanations of the fields that a user fills in: meaning, source of the value, typical values.

`contactd check --explain FIELD` prints them. A field is named by its path in `config.yaml`, without
indices and user-defined names: `joints.wiring.gear`.
"""

import re
from dataclasses import dataclass
from difflib import get_close_matches

from common.errors import ConfigurationError


@dataclass(frozen=True, slots=True)
class Explanation:
    """Explanation of one field."""

    what: str
    find: str
    typical: str


_SCALE_FIND = (
    "the drive's manual: N counts per turn make 2 pi / N, 1 rpm is pi / 30, per mille is 0.001; "
    "docs/porting.md, step 3, has a table"
)
_QUANTITY = {
    "link_position": ("position of the link, from the encoder behind the gear", "rad at the link",
                      "0x60E4 sub 1, 0x6064, or an object of the maker's own"),
    "motor_velocity": ("velocity of the motor shaft, as measured", "rad/s of the motor shaft",
                       "0x606C, 0x6069"),
    "motor_position": ("position of the motor shaft; left out where there is none",
                       "rad of the motor shaft", "0x6064, 0x6063"),
    "current": ("current of the motor; instead of `torque`", "fraction of the rated current",
                "0x6078, scale 0.001; of an object in mA 0.001 / rated_current_A, with a profile "
                "for each rated current"),
    "torque": ("torque of the motor; instead of `current`", "fraction of the rated torque",
               "0x6077, scale 0.001"),
    "target_velocity": ("setpoint of the mode cyclic synchronous velocity",
                        "rad/s of the motor shaft", "0x60FF, in the unit of 0x606C"),
    "quick_stop_deceleration": ("deceleration of the drive's own quick stop",
                                "rad/s2 of the motor shaft", "0x6085"),
    "max_motor_speed": ("the drive's own speed limit; left out where there is none",
                        "rad/s of the motor shaft", "0x6080 (rpm), 0x607F"),
}  # fmt: skip

EXPLANATIONS: dict[str, Explanation] = {
    f"drives.{name}": Explanation(f"{what} [{unit}]", "EDS and manual of the drive", typical)
    for name, (what, unit, typical) in _QUANTITY.items()
} | {
    f"drives.{name}.scale": Explanation(f"{unit} per count of {name}", _SCALE_FIND, "see there")
    for name, (_, unit, _) in _QUANTITY.items()
} | {
    name: Explanation(*words)
    for name, words in {
        "version": ("version of this format", "it is 1", "1"),
        "name": ("name of the arm, for people", "yours to choose", "Desk arm"),
        "urdf": ("file with the links, joints and masses of the arm, relative to config.yaml",
                 "from the CAD program's URDF exporter; kg, m and kg m2, every moving link with "
                 "its <inertial>", "arm.urdf"),
        "period_ms": ("period of the loop and of SYNC [ms]",
                      "what all drives and the bus can carry: `contactd check` prints the load",
                      "10; 4 to 20"),
        "bus.interface": ("kind of CAN adapter, as python-can calls it", "docs/installing.md",
                          "socketcan on a robot, socketcand for a simulated arm"),
        "bus.channel": ("name of the interface", "`ip link`", "can0"),
        "bus.bitrate": ("bit/s of the bus; every drive must have the same",
                        "switches of the drives, or their maker's tool", "1000000, 500000"),
        "bus.host": ("computer that serves the bus over TCP", "only for socketcand", "127.0.0.1"),
        "bus.port": ("its TCP port", "only for socketcand", "29536"),
        "bus.master_node": ("node ID of contactd, whose heartbeat the drives consume",
                            "any ID that no drive has", "127"),
        "drives.eds": ("the drive's electronic data sheet, relative to config.yaml",
                       "from the drive's maker, for its exact product and firmware", "drive.eds"),
        "drives.object": ("index of the object that holds the quantity",
                          "EDS and manual", "0x6000 to 0x60FF, 0x2000 on for a maker's own"),
        "drives.subindex": ("subindex of the object", "EDS", "0"),
        "drives.type": ("data type of the object", "EDS (DataType)", "INTEGER16, INTEGER32"),
        "drives.scale": ("unit of the quantity per count", _SCALE_FIND, "see there"),
        "drives.sign": ("-1 where the drive counts the quantity against the motor",
                        "the manual; `contactd identify wiring` reports a wrong one", "1"),
        "drives.offset": ("minus the value of counts times scale at which the quantity is 0",
                          "an encoder's zero belongs in `wiring.link_offset`", "0"),
        "drives.tpdo": ("entries that the drive sends, by number of the TPDO",
                        "at most 8 bytes each, few frames; a mapping that the EDS fixes must be "
                        "kept", '"1": [statusword, current, motor_velocity], "2": [link_position]'),
        "drives.rpdo": ("entries that the drive receives, by number of the RPDO", "as for tpdo",
                        '"1": [controlword, target_velocity]'),
        "drives.heartbeat_ms": ("period of the drive's heartbeat [ms]; three missing are a fault",
                                "yours to choose; the EDS may limit it", "50"),
        "drives.master_timeout_ms": ("time without the master's heartbeat after which a CANopen "
                                     "drive stops, or without setpoints after which another motor "
                                     "lets go [ms]", "at least three periods of the loop", "100"),
        "drives.make": ("make of the drives", "docs/drives.md", "canopen, damiao, robstride, log"),
        "drives.model": ("model of a Damiao or RobStride motor, which gives gear and constants",
                         "its label; of a Damiao, `contactd scan` guesses it", "DM4310, DM4340"),
        "drives.position_max": ("largest position, of either sign, that the motor's frames encode "
                                "[rad at the output]",
                                "register 21 of a Damiao; a RobStride's manual", "12.5"),
        "drives.velocity_max": ("largest velocity that the frames encode [rad/s at the output]",
                                "register 22 of a Damiao; a RobStride's manual", "10 to 45"),
        "drives.torque_max_Nm": ("largest torque that the frames encode [Nm at the output]",
                                 "register 23 of a Damiao; a RobStride's manual", "10 to 54"),
        "drives.stiffness": ("stiffness of the motor's own loop [Nm/rad at the output]",
                             "`contactd new` proposes it: gravity deflects the joint by its torque "
                             "over this; less if it oscillates, more if it sags", "10 to 150"),
        "drives.damping": ("damping of the same loop [Nm s/rad at the output]",
                           "2 * 0.7 * sqrt(stiffness * inertia); less where the motor hums",
                           "0.3 to 5"),
        "drives.answer_timeout_ms": ("timeout for the motor's answer [ms]", "default", "50"),
        "drives.torque_constant": ("torque per A of the motor [Nm/A at the output]",
                                   "left out: as published", "none"),
        "drives.sdo_timeout_ms": ("timeout for the drive's SDO answers at boot-up [ms]",
                                  "longer for a drive that is slow", "500"),
        "drives.fault_reaction": ("0x605E: what the drive does in a fault", "the drive's manual",
                                  "2, a quick stop"),
        "drives.write": ("more objects to set at boot-up", "the drive's manual", "none"),
        "drives.any_product": ("true: the drive's vendor and product may differ from the EDS",
                               "only where the maker counts housings as products", "false"),
        "joints.name": ("name of the joint, as in the URDF", "<joint name=...> of the URDF",
                        "elbow"),
        "joints.wiring.node": ("node ID of the joint's drive", "switches of the drive; `contactd "
                               "scan` lists the nodes that answer", "1 to 126, each once"),
        "joints.wiring.profile": ("kind of the joint's drive: a key of `drives`", "above",
                                  "servo_drive"),
        "joints.wiring.gear": ("turns of the motor per turn of the joint, all stages together",
                               "data sheets of gear and belt; mark the motor and count",
                               "30 to 200; above 1 in nearly every arm"),
        "joints.wiring.rated_current_A": ("rated (continuous) current of the motor [A]",
                                          "data sheet of the motor, and 0x6075 [mA] of the drive",
                                          "0.3 to 10"),
        "joints.wiring.max_current_A": ("largest current that the drive may supply [A]",
                                        "the lowest value of the data sheets of motor, gear, drive",
                                        "1.5 to 3 times rated_current_A"),
        "joints.wiring.motor_sign": ("-1 where the motor counts against the joint",
                                     "turn motor and joint by hand; `contactd identify wiring`",
                                     "1"),
        "joints.wiring.link_sign": ("-1 where the link encoder counts against the joint's axis in "
                                    "the URDF", "`contactd identify zero`, which asks you", "1"),
        "joints.wiring.link_offset": ("offset of the link encoder, with which it reads 0 where the "
                                      "URDF's joint is 0 [rad]",
                                      "`contactd identify zero JOINT=ANGLE`, drives off",
                                      "-3.14 to 3.14"),
        "joints.wiring.link_correction": ("periodic error of the link encoder per turn [rad]",
                                          "`contactd identify encoders` writes it; leave it out",
                                          "none, or 0.0001 to 0.001 once or twice per turn"),
        "joints.wiring.rated_torque_Nm": ("rated torque at the motor's shaft [Nm]; or left out",
                                          "data sheet of the motor; 0x6076 [mNm]", "0.01 to 1"),
        "joints.wiring.serial": ("serial number of the drive; may be left out",
                                 "on the drive, or 0x1018 sub 4", "none"),
        "joints.torque_constant": ("torque at the link per A of motor current, K_c [Nm/A]",
                                   "the motor's constant times the gear ratio, times the gear's "
                                   "efficiency (0.7 to 0.9)", "1 to 20; motor alone: 0.01 to 0.1"),
        "joints.rotor_inertia": ("inertia of rotor and gear, seen from the link, B [kg m2]",
                                 "the motor's inertia times the gear squared; `contactd identify "
                                 "friction` finds it", "0.005 to 0.5"),
        "joints.half_gap": ("half of the backlash between motor and link, at the link, alpha [rad]",
                            "`contactd identify gap JOINT`; a guess suffices until then",
                            "0.001 to 0.02 (0.06 to 1.1 degrees)"),
        "joints.friction": ("friction of motor and link, at the link [Nm, Nm s/rad]",
                            "`contactd identify friction`; a guess suffices until then",
                            "Coulomb 2 to 10 % of the motor's torque"),
        "joints.thresholds.contact": ("residual above which a touch is detected [Nm]",
                                      "`contactd identify thresholds`; begin high",
                                      "5 to 15 % of the motor's torque"),
        "joints.thresholds.collision": ("residual above which a touch is a collision [Nm]",
                                        "several times `contact`", "5 to 8 times contact"),
        "joints.thresholds.per_speed": ("increase of both with the motor's speed [Nm s/rad]",
                                        "`contactd identify thresholds`", "0"),
        "joints.thresholds.least": ("lower bound of the contact level for learning [Nm]; left out: "
                                    "a level that you state (`known`), a fifth of any other",
                                    "raise it where contacts are reported without a touch",
                                    "0.2 to 1 times contact"),
        "joints.limits.lower": ("smallest position that is commanded [rad]",
                                "inside the URDF's limit and the end stop", "0.05 rad inside"),
        "joints.limits.upper": ("largest position that is commanded [rad]", "as for lower",
                                "0.05 rad inside"),
        "joints.limits.velocity": ("largest velocity that is commanded [rad/s]",
                                   "slow at first; at most the motor's speed over the gear ratio",
                                   "0.5 to 2"),
        "joints.limits.acceleration": ("largest acceleration that is commanded [rad/s2]",
                                       "what the motor achieves with the arm outstretched",
                                       "2 to 8"),
        "joints.limits.quick_stop": ("deceleration of the drive's own quick stop [rad/s2]",
                                     "two to three times acceleration", "5 to 20"),
        "joints.admittance_gain": ("how softly the joint yields, K_a [rad/s per Nm]",
                                   "low at first; docs/admittance.md", "0.1 to 0.5"),
        "joints.virtual_mass_s": ("time constant of yielding [s]; may be left out",
                                  "docs/admittance.md", "0.05"),
        "joints.gap_spring": ("correction near the edges of the gap", "only from a fit", "none"),
        "joints.body": ("mass, centre of mass and inertia tensor of the body that the joint moves, "
                        "in place of the URDF's",
                        "`contactd identify masses`; otherwise correct the URDF", "none"),
        "joints.known": ("steps of `contactd identify` that the joint does not need, each with the "
                         "source of its values instead; stated levels take precedence",
                         "data sheets", "none"),
        "estimator.learning": ("friction and levels are learned at work; false: nothing is learned "
                               "wrongly, but a touch needs up to five times the torque, and "
                               "friction that changes is reported as contacts",
                               "`thresholds.least` bounds it for one joint", "true"),
        "joints.end": ("state of the joint when the daemon ends", "brake, where there is one",
                       "hold"),
    }.items()
}  # fmt: skip


def explain(field: str) -> dict[str, Explanation]:
    """Explanations of a field or of all fields of a group, given its path, the end of its path, or
    its name in a message (`joints[2] (elbow).wiring.gear`). Raises ConfigurationError for a field
    without an explanation."""
    plain = re.sub(r"\[\d+\]( \(.*?\))?|:", "", field.strip())
    names = [name for name in plain.split(".") if name and not name.isdecimal()]
    if len(names) > 2 and names[0] == "drives":
        del names[1]  # name of the profile, chosen by the user
    shorter = [names, names[:1] + names[-1:], names[-1:]] if names else []
    for wanted in shorter:
        for fits in (_ends, _holds):
            if found := {k: v for k, v in EXPLANATIONS.items() if fits(k.split("."), wanted)}:
                return found
    known = sorted({key.rpartition(".")[2] for key in EXPLANATIONS})
    like = get_close_matches(names[-1], known) if names else []
    there = f"Did you mean {' or '.join(like)}?" if like else f"There are: {', '.join(known)}."
    raise ConfigurationError(
        f"--explain {field}: no such field is explained. {there} All others are in "
        "docs/configuration.md, those of surroundings.yaml in docs/surroundings.md."
    )


def _ends(key: list[str], names: list[str]) -> bool:
    return key[-len(names) :] == names


def _holds(key: list[str], names: list[str]) -> bool:
    return any(key[i : i + len(names)] == names for i in range(len(key)))
