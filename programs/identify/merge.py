"""Content of `identified.yaml` with new entries in it."""

import msgspec

from daemon.config import identified as file
from daemon.config.load import Robot
from daemon.config.marks import Dependence, fingerprint, marks


def merged(
    robot: Robot, step: str, entries: dict[str, file.Entry], serials: dict[str, int | None]
) -> file.Identified:
    """Content of the robot's file with the entries of one step in it.

    Entries of another drive are dropped. Those of another configuration stay, known by their mark,
    in case that it comes back; of a file of before, whose entries have none, they are dropped.
    """
    of = marks(robot.configuration, robot.urdf)
    joints = _marked(robot, of)
    for name, found in entries.items():
        entry = msgspec.structs.replace(found, of=of[found.depends])
        known = joints.get(name, file.IdentifiedJoint(serial=serials.get(name)))
        if name in serials and known.serial != serials[name]:
            known = file.IdentifiedJoint(serial=serials[name])
        joints[name] = msgspec.structs.replace(known, **{step: entry})
    order = {name: joints[name] for name in robot.configuration.joint_names if name in joints}
    kept = robot.identified.payloads if robot.identified else {}
    return file.Identified(joints=order, payloads=kept)


def _marked(robot: Robot, of: dict[Dependence, str]) -> dict[str, file.IdentifiedJoint]:
    """Entries of the file by joint, each with a mark of its own."""
    old = robot.identified or file.Identified()
    valid = old.configuration == fingerprint(robot.configuration, robot.urdf)

    def marked(joint: file.IdentifiedJoint) -> file.IdentifiedJoint:
        changes = {
            step: msgspec.structs.replace(entry, of=of[entry.depends]) if valid else None
            for step, entry in file.entries_of(joint).items()
            if not entry.of
        }
        return msgspec.structs.replace(joint, **changes)

    return {name: marked(joint) for name, joint in old.joints.items()}


def merged_payloads(robot: Robot, found: dict[str, file.IdentifiedPayload]) -> file.Identified:
    """Content of the robot's file with these loads in it."""
    old = robot.identified or file.Identified()
    return msgspec.structs.replace(old, payloads=old.payloads | found)
