"""Mistakes that owners make, planted one at a time into the files of a correct arm.

Each states the owner's mistake, in words, and the field at which `contactd check` must report it.
The last ones are consistent with all files: only the arm itself shows them, by `contactd identify
wiring`.
"""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.rigs.generated_arms import PROFILE, URDF, GeneratedArm, in_yaml
from common.errors import ContactdError
from daemon.config.bounds import near
from daemon.config.checks import suspects
from daemon.config.load import load_robot

JOINT = 1  # the joint whose figures are wrong: the shoulder, which carries the arm

Data = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake. `field` must be named, without the owner's own names and numbers; empty if only
    the wiring can show it. `edit` changes the configuration, `urdf` the URDF's text."""

    words: str
    field: str = ""
    edit: Callable[[Data], None] = lambda _: None
    urdf: Callable[[str], str] = lambda text: text

    @property
    def only_wiring(self) -> bool:
        """True if nothing in the files is wrong by itself."""
        return not self.field

    def plant(self, arm: GeneratedArm, folder: Path) -> Path:
        """Write the arm's files with the mistake to a folder, from scratch; returns it."""
        arm.write(folder)
        data = arm.configuration()
        self.edit(data)
        (folder / "config.yaml").write_text(in_yaml(data))
        (folder / URDF).write_text(self.urdf(arm.urdf))
        return folder


@dataclass(frozen=True, slots=True)
class Reported:
    """Output of `contactd check` for a folder, line by line, and whether it is refused."""

    folder: Path
    refused: bool
    lines: list[str]

    def of(self, field: str) -> bool:
        """True if a line is about this field."""
        place = re.escape(field)
        for own, any_of_them in (
            ("joints", r"joints\[\d+\] \(\w+\)"),
            ("drives", rf"drives\.{PROFILE}"),
            ("current\\.scale", r"(current|torque)\.scale"),
        ):
            place = place.replace(own, any_of_them)
        start = re.compile(rf"{re.escape(str(self.folder))}/config\.yaml:\d+: {place}")
        return any(start.match(line) for line in self.lines)


def reported(folder: Path) -> Reported:
    """Output of `contactd check`: refusals and warnings."""
    try:
        robot = load_robot(folder)
    except ContactdError as error:
        return Reported(folder, True, str(error).splitlines())
    c = robot.configuration
    warned = (*near(c, robot.model), *suspects(c, robot.urdf, folder))
    return Reported(folder, False, [robot.in_words(problem) for problem in warned])


# --- edits ----------------------------------------------------------------------------------------


def _joint(**fields: Any) -> Callable[[Data], None]:
    """Set fields of the joint; a function makes the new value from the old one; `a__b` is b in
    a."""

    def edit(data: Data) -> None:
        for name, value in fields.items():
            *path, last = name.split("__")
            place = data["joints"][JOINT]
            for part in path:
                place = place[part]
            place[last] = value(place[last]) if callable(value) else value

    return edit


def _drive(entry: str, **fields: Any) -> Callable[[Data], None]:
    """Set fields of one quantity of the profile."""

    def edit(data: Data) -> None:
        place = data["drives"][PROFILE][entry]
        for name, value in fields.items():
            place[name] = value(place[name]) if callable(value) else value

    return edit


def _effort_scale(data: Data) -> None:
    drive = data["drives"][PROFILE]
    drive["current" if "current" in drive else "torque"]["scale"] = 1.0


def _renamed(data: Data) -> None:
    joint = data["joints"][JOINT]
    joint["halfgap"] = joint.pop("half_gap")


def _range(new: Callable[[float, float], tuple[float, float]]) -> Callable[[Data], None]:
    """Replace the joint's limits by others computed from them."""

    def edit(data: Data) -> None:
        limits = data["joints"][JOINT]["limits"]
        limits["lower"], limits["upper"] = new(limits["lower"], limits["upper"])

    return edit


def _by_gear(name: str, new: Callable[[float, float], float]) -> Callable[[Data], None]:
    """Replace a field of the joint by a value computed from it and the gear."""

    def edit(data: Data) -> None:
        joint = data["joints"][JOINT]
        joint[name] = new(joint[name], joint["wiring"]["gear"])

    return edit


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 1)


def _same_node(data: Data) -> None:
    data["joints"][JOINT]["wiring"]["node"] = data["joints"][0]["wiring"]["node"]


def _swapped_currents(data: Data) -> None:
    wiring = data["joints"][JOINT]["wiring"]
    wiring["rated_current_A"], wiring["max_current_A"] = (
        wiring["max_current_A"], 0.8 * wiring["rated_current_A"],
    )  # fmt: skip


def _swapped_nodes(data: Data) -> None:
    one, other = (data["joints"][i]["wiring"] for i in (JOINT, JOINT + 1))
    one["node"], other["node"] = other["node"], one["node"]


def _without_last_joint(data: Data) -> None:
    del data["joints"][-1]
    data["trajectory"] = {}


def _through_the_gear(data: Data) -> None:
    drive, gear = data["drives"][PROFILE], data["joints"][JOINT]["wiring"]["gear"]
    drive["link_position"]["scale"] /= gear


def _too_long(data: Data) -> None:
    drive = data["drives"][PROFILE]
    entries = [entry for layout in drive["tpdo"].values() for entry in layout]
    drive["tpdo"] = {"1": entries}


def _scaled(attribute: str, factor: float, *, which: str = "") -> Callable[[str], str]:
    """Scale an attribute of the URDF everywhere, or within the link of this name."""

    def scale(match: re.Match[str]) -> str:
        words = " ".join(f"{factor * float(word):.9g}" for word in match[2].split())
        return f'{match[1]}="{words}"'

    def edit(text: str) -> str:
        pattern = re.compile(rf'(\b(?:{attribute}))="([^"]*)"')
        if not which:
            return pattern.sub(scale, text)
        block = re.compile(rf'(?s)<link name="{which}">.*?</link>|<joint name="{which}".*?</joint>')
        return block.sub(lambda found: pattern.sub(scale, found[0]), text)

    return edit


def _replaced(pattern: str, new: str) -> Callable[[str], str]:
    return lambda text: re.sub(pattern, new, text, count=1, flags=re.DOTALL)


_LINK = "shoulder_link"
_INERTIA = "i[xyz]{2}"
_AT = "joints."
_DRIVE = "drives."

MISTAKES: tuple[Mistake, ...] = (
    # The URDF.
    Mistake("a link without `<inertial>`", "urdf", urdf=_replaced(
        rf'(<link name="{_LINK}">).*?</inertial>', r"\1")),
    Mistake("a mass left at 0", "urdf", urdf=_scaled("value", 0.0, which=_LINK)),
    Mistake("a mass below 0", "urdf", urdf=_scaled("value", -1.0, which=_LINK)),
    Mistake("all masses in grams", "urdf", urdf=_scaled("value", 1000.0)),
    Mistake("one mass in grams", "urdf", urdf=_scaled("value", 1000.0, which=_LINK)),
    Mistake("lengths in millimetres", "urdf", urdf=_scaled("xyz", 1000.0)),
    Mistake("one centre of mass in millimetres", "urdf", urdf=_scaled("xyz", 1000.0, which=_LINK)),
    Mistake("one joint's origin in millimetres", "urdf",
            urdf=_scaled("xyz", 1000.0, which="elbow")),
    Mistake("inertias in kg mm2", "urdf", urdf=_scaled(_INERTIA, 1e6)),
    Mistake("an inertia 10^7 too large", "urdf", urdf=_scaled(_INERTIA, 1e7, which=_LINK)),
    Mistake("an inertia 10^7 too small", "urdf", urdf=_scaled(_INERTIA, 1e-7, which=_LINK)),
    Mistake("inertias in g m2 taken for a thousandth", "urdf", urdf=_scaled(_INERTIA, 1e-3)),
    Mistake("a joint's limits in degrees", "urdf",
            urdf=_scaled("lower|upper", math.degrees(1.0), which="shoulder")),
    Mistake("a joint's velocity in degrees/s", "urdf",
            urdf=_scaled("velocity", math.degrees(1.0), which="shoulder")),
    Mistake("a joint that has another name in the URDF", _AT + "name",
            urdf=_replaced('joint name="shoulder"', 'joint name="Shoulder"')),
    Mistake("a moving joint that is `fixed` in the URDF", _AT + "name",
            urdf=_replaced('name="shoulder" type="revolute"', 'name="shoulder" type="fixed"')),
    Mistake("a moving joint that is not configured", "urdf", _without_last_joint),
    # Motor and gear.
    Mistake("the torque constant of the motor, not of the link", _AT + "torque_constant",
            _by_gear("torque_constant", lambda x, gear: round(x / gear, 4))),
    Mistake("the torque constant in mNm/A", _AT + "torque_constant",
            _joint(torque_constant=lambda x: 1000.0 * x)),
    Mistake("the torque constant times the gear twice", _AT + "torque_constant",
            _by_gear("torque_constant", lambda x, gear: x * gear)),
    Mistake("the gear upside down", _AT + "wiring.gear", _joint(wiring__gear=lambda x: 1.0 / x)),
    Mistake("a gear with a digit too many", _AT + "wiring.gear",
            _joint(wiring__gear=lambda x: 10.0 * x)),
    Mistake("the rated current in mA", _AT + "wiring.rated_current_A",
            _joint(wiring__rated_current_A=lambda x: 1000.0 * x)),
    Mistake("the largest current in mA", _AT + "wiring.max_current_A",
            _joint(wiring__max_current_A=lambda x: 1000.0 * x)),
    Mistake("rated and largest current swapped", _AT + "wiring.max_current_A", _swapped_currents),
    Mistake("the rotor's inertia at the shaft, not at the link", _AT + "rotor_inertia",
            _by_gear("rotor_inertia", lambda x, gear: x / gear**2)),
    Mistake("the rotor's inertia in g cm2", _AT + "rotor_inertia", _joint(rotor_inertia=30.0)),
    Mistake("the rotor's inertia 10^7 too large", _AT + "rotor_inertia",
            _joint(rotor_inertia=lambda x: 1e7 * x)),
    Mistake("the half-gap in degrees", _AT + "half_gap", _joint(half_gap=0.4)),
    Mistake("the half-gap in mrad", _AT + "half_gap", _joint(half_gap=5.0)),
    Mistake("Coulomb friction beyond the motor", _AT + "friction.motor_coulomb",
            _joint(friction__motor_coulomb=lambda x: 40.0 * x)),
    Mistake("viscous friction per degree/s", _AT + "friction.motor_viscous",
            _joint(friction__motor_viscous=lambda x: x * math.degrees(1.0))),
    # Levels and limits.
    Mistake("a contact level beyond the motor", _AT + "thresholds.contact",
            _joint(thresholds__contact=800.0, thresholds__collision=900.0)),
    Mistake("a contact level below the noise", _AT + "thresholds.contact",
            _joint(thresholds__contact=0.01)),
    Mistake("a contact level above the collision level", _AT + "thresholds.contact",
            _joint(thresholds__contact=lambda x: 10.0 * x)),
    Mistake("a collision level that no gear stands", _AT + "thresholds.collision",
            _joint(thresholds__collision=lambda x: 10.0 * x)),
    Mistake("levels that grow beyond the motor with speed", _AT + "thresholds.per_speed",
            lambda data: data["joints"][JOINT]["thresholds"].update(per_speed=100.0)),
    Mistake("limits in degrees", _AT + "limits",
            _range(lambda lower, upper: (_degrees(lower), _degrees(upper)))),
    Mistake("limits about the axis the other way round", _AT + "limits",
            _range(lambda lower, upper: (-upper, -lower))),
    Mistake("limits upside down", _AT + "limits",
            _range(lambda lower, upper: (upper, lower))),
    Mistake("a velocity limit in degrees/s", _AT + "limits.velocity",
            _joint(limits__velocity=15.0)),
    Mistake("an acceleration in degrees/s2", _AT + "limits.acceleration",
            _joint(limits__acceleration=lambda x: x * math.degrees(1.0))),
    Mistake("a quick stop in degrees/s2", _AT + "limits.quick_stop",
            _joint(limits__quick_stop=lambda x: x * math.degrees(1.0))),
    Mistake("a quick stop softer than usual motion", _AT + "limits.quick_stop",
            _joint(limits__quick_stop=0.5)),
    Mistake("the encoder's zero in degrees", _AT + "wiring.link_offset",
            _joint(wiring__link_offset=-37.5)),
    Mistake("a field that is misspelt", "joints: unknown key", _renamed),
    Mistake("an end that does not exist", _AT + "end",
            lambda data: data["joints"][JOINT].update(end="coast")),
    Mistake("two joints with one node", "joints.wiring.node", _same_node),
    Mistake("a node that is the master's", _AT + "wiring.node", _joint(wiring__node=127)),
    # Drives.
    Mistake("an encoder in degrees per count", _DRIVE + "link_position.scale",
            _drive("link_position", scale=math.degrees)),
    Mistake("an encoder in turns per count", _DRIVE + "link_position.scale",
            _drive("link_position", scale=lambda x: x / (2.0 * math.pi))),
    Mistake("counts per motor turn for the link's encoder", _DRIVE + "link_position.scale",
            _through_the_gear),
    Mistake("another unit for the measured velocity than for the setpoint",
            _DRIVE + "motor_velocity.scale",
            _drive("motor_velocity", scale=lambda x: 9.5492966 * x)),
    Mistake("the velocity that is demanded for the measured one",
            _DRIVE + "motor_velocity", _drive("motor_velocity", object=0x606B)),
    Mistake("an index without 0x", _DRIVE + "target_velocity",
            _drive("target_velocity", object=6060)),
    Mistake("a type of another width", _DRIVE + "link_position.type",
            _drive("link_position", type="INTEGER16")),
    Mistake("current in A per count", _DRIVE + "current.scale", _effort_scale),
    Mistake("a PDO of more than eight bytes", _DRIVE + "tpdo.1", _too_long),
    Mistake("no statusword in any PDO", _DRIVE + "tpdo",
            lambda data: data["drives"][PROFILE]["tpdo"]["1"].remove("statusword")),
    Mistake("the bitrate in kbit/s", "bus.bitrate", lambda data: data["bus"].update(bitrate=1000)),
    # Only the arm can show these.
    Mistake("the motor's sign", edit=_joint(wiring__motor_sign=lambda x: -x)),
    Mistake("the link encoder's sign", edit=_joint(wiring__link_sign=lambda x: -x)),
    Mistake("the nodes of two like joints swapped", edit=_swapped_nodes),
    Mistake("a gear of 80 in place of 100",
            edit=_joint(wiring__gear=lambda x: 80.0 if x > 90.0 else 1.25 * x)),
)  # fmt: skip


def checkable() -> Iterator[Mistake]:
    """Mistakes that the files show."""
    return (mistake for mistake in MISTAKES if not mistake.only_wiring)
