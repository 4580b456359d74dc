"""Digests of settings that identified values depend on: a change voids only those it affects.

Zero, wiring, encoders and gap depend on the joint's own drive and profile, the period and the
URDF's joints; masses, friction and levels on those of all joints, as all of them move its load.
Limits, gains, encoder corrections and the URDF's visuals invalidate nothing.
"""

import hashlib
from enum import StrEnum
from functools import lru_cache

import msgspec

from daemon.config.schema import Configuration, Joint
from estimator.urdf import parsed


class Dependence(StrEnum):
    """Settings that identified values depend on, in words for messages."""

    NODES = "drives, nodes or the URDF's joints"
    WIRING = "drives, wiring, period or the URDF's joints"
    CONSTANTS = "drives, wiring, torque constants, period or the URDF's joints"
    MASSES = "drives, wiring, torque constants, period or URDF"
    BODIES = "drives, wiring, torque constants, period, URDF or identified masses"


_JOINT = ("origin", "axis", "parent", "child", "mimic")


def fingerprint(c: Configuration, urdf: str) -> str:
    """SHA-256 of all settings that change the meaning of any measurement, with the URDF's exact
    text: the only digest of the oldest files."""
    joints = [(joint.name, _wiring(joint), joint.torque_constant) for joint in c.joints]
    return _digest((_drives(c), joints, c.period_ms, urdf))


def digests_of(c: Configuration, urdf: str, name: str) -> dict[Dependence, str]:
    """SHA-256 of each dependence of one joint's values."""
    (joint,) = (one for one in c.joints if one.name == name)
    profile = joint.wiring.profile
    alone = msgspec.structs.replace(c, joints=[joint], drives={profile: c.drives[profile]})
    whole = digests(c, urdf)
    of_all = {part: whole[part] for part in (Dependence.MASSES, Dependence.BODIES)}
    return digests(alone, urdf) | of_all


def digests(c: Configuration, urdf: str) -> dict[Dependence, str]:
    """SHA-256 of each dependence over all joints, as in older files. Of earlier results only bodies
    are included; a drive's product is not, as its serial number identifies it."""
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
    """Wiring without the link encoder's correction: 0.5 mrad, finer than any step guarantees."""
    wiring = msgspec.to_builtins(joint.wiring)
    del wiring["link_correction"]
    return wiring


def _drives(c: Configuration) -> object:
    drives = msgspec.to_builtins(c.drives)
    for profile in drives.values():
        profile.pop("any_product", None)
        del profile["make"]  # implied by the fields
    return drives


@lru_cache(maxsize=2)
def _urdf(text: str) -> tuple[object, object]:
    """Joints with their frames, and inertials, of a URDF that was parsed before."""
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
