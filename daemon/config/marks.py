"""Marks of what each step of the identification depends on: a change voids only what it touches.

| changed | void are |
|---|---|
| drives, nodes, or the URDF's joints and frames | all steps |
| the rest of the wiring, gear, period | all but the zeros |
| torque constants | all but zeros and gap |
| the URDF's masses | masses, friction, thresholds |
| identified masses | friction, thresholds |
| limits, gains, corrections of the encoders, the URDF's pictures | none |
"""

import hashlib

import msgspec

from daemon.config.schema import AnyStep, Configuration, Joint
from estimator.urdf import parsed

_JOINT = ("origin", "axis", "parent", "child", "mimic")


def fingerprint(c: Configuration, urdf: str) -> str:
    """SHA-256 of everything in a configuration that changes what any measurement means, the URDF
    letter by letter: the one mark of files of before."""
    joints = [(joint.name, _wiring(joint), joint.torque_constant) for joint in c.joints]
    return _digest((_drives(c), joints, c.period_ms, urdf))


def marks(c: Configuration, urdf: str) -> dict[AnyStep, str]:
    """SHA-256 of what each step depends on. Old values do not count; nor does which product may
    answer, for a drive is known by its serial number."""
    geometry, masses = _urdf(urdf)
    wiring = [(joint.name, _wiring(joint)) for joint in c.joints]
    everything = (_drives(c), wiring, c.period_ms, geometry)
    constants = [joint.torque_constant for joint in c.joints]
    moving = _digest((everything, constants, masses))
    bodies = {joint.name: joint.body for joint in c.joints if joint.body is not None}
    moved = _digest((moving, bodies)) if bodies else moving
    nodes = [(joint.name, joint.wiring.node, joint.wiring.profile) for joint in c.joints]
    return {
        "zero": _digest((_drives(c), nodes, geometry)),
        "wiring": _digest((everything, constants)),
        "encoders": _digest(everything),
        "gap": _digest(everything),
        "masses": moving,
        "friction": moved,
        "thresholds": moved,
    }


def _wiring(joint: Joint) -> object:
    """Without half a milliradian of the link's encoder, which no step answers for."""
    wiring = msgspec.to_builtins(joint.wiring)
    del wiring["link_correction"]
    return wiring


def _drives(c: Configuration) -> object:
    drives = msgspec.to_builtins(c.drives)
    for profile in drives.values():
        del profile["any_product"]
    return drives


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
