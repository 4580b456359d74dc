"""Marks of what identified values depend on: a change voids only the values that it affects.

Of wiring and constants a joint's values depend on its own drive and profile, with the period and
the URDF's joints; masses, friction and levels on those of all joints, as all of them move its load.
Limits, gains, corrections of the encoders and the URDF's pictures void none.
"""

import hashlib
from enum import StrEnum
from functools import lru_cache

import msgspec

from daemon.config.schema import Configuration, Joint
from estimator.urdf import parsed


class Dependence(StrEnum):
    """Part of an arm that identified values depend on, in words."""

    NODES = "drives, nodes or the URDF's joints"
    WIRING = "drives, wiring, period or the URDF's joints"
    CONSTANTS = "drives, wiring, torque constants, period or the URDF's joints"
    MASSES = "drives, wiring, torque constants, period or URDF"
    BODIES = "drives, wiring, torque constants, period, URDF or identified masses"


_JOINT = ("origin", "axis", "parent", "child", "mimic")


def fingerprint(c: Configuration, urdf: str) -> str:
    """SHA-256 of everything in a configuration that changes the meaning of any measurement, the
    URDF letter by letter: the only mark of older files."""
    joints = [(joint.name, _wiring(joint), joint.torque_constant) for joint in c.joints]
    return _digest((_drives(c), joints, c.period_ms, urdf))


def marks_of(c: Configuration, urdf: str, name: str) -> dict[Dependence, str]:
    """SHA-256 of each part that values of one joint depend on."""
    (joint,) = (one for one in c.joints if one.name == name)
    profile = joint.wiring.profile
    alone = msgspec.structs.replace(c, joints=[joint], drives={profile: c.drives[profile]})
    whole = marks(c, urdf)
    of_all = {part: whole[part] for part in (Dependence.MASSES, Dependence.BODIES)}
    return marks(alone, urdf) | of_all


def marks(c: Configuration, urdf: str) -> dict[Dependence, str]:
    """SHA-256 of each part, for all joints: marks of older files. Other values found before are not
    part of it; nor is the product of a drive, which is identified by its serial number."""
    geometry, masses = _urdf(urdf)
    wiring = [(joint.name, _wiring(joint)) for joint in c.joints]
    everything = (_drives(c), wiring, c.period_ms, geometry)
    constants = [joint.torque_constant for joint in c.joints]
    moving = _digest((everything, constants, masses))
    moved = _digest((moving, c.bodies)) if c.bodies else moving
    nodes = [(joint.name, joint.wiring.node, joint.wiring.profile) for joint in c.joints]
    return {
        Dependence.NODES: _digest((_drives(c), nodes, geometry)),
        Dependence.WIRING: _digest(everything),
        Dependence.CONSTANTS: _digest((everything, constants)),
        Dependence.MASSES: moving,
        Dependence.BODIES: moved,
    }


def _wiring(joint: Joint) -> object:
    """Wiring, without half a milliradian of the link's encoder, which no step guarantees."""
    wiring = msgspec.to_builtins(joint.wiring)
    del wiring["link_correction"]
    return wiring


def _drives(c: Configuration) -> object:
    drives = msgspec.to_builtins(c.drives)
    for profile in drives.values():
        profile.pop("any_product", None)
        del profile["make"]  # each has fields of its own
    return drives


@lru_cache(maxsize=2)
def _urdf(text: str) -> tuple[object, object]:
    """Joints and frames, and masses, of a URDF that was loaded before."""
    root, _ = parsed(text)
    joints = {
        joint.get("name"): (
            joint.get("type"),
            [(part.tag, sorted(part.attrib.items())) for part in joint if part.tag in _JOINT],
        )
        for joint in root.iter("joint")
        if joint.find("parent") is not None
    }
    masses = {
        link.get("name"): [
            (part.tag, sorted(part.attrib.items())) for part in link.iterfind("inertial/*")
        ]
        for link in root.iter("link")
    }
    return joints, masses


def _digest(about: object) -> str:
    return hashlib.sha256(msgspec.json.encode(about, order="sorted")).hexdigest()
