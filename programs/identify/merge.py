"""Merging of new entries into the content of `identified.yaml`."""

import msgspec

from daemon.config import identified as file
from daemon.config.digests import digests_of
from daemon.config.evidence import in_force
from daemon.config.load import Robot


def merged(
    robot: Robot, step: str, entries: dict[str, file.Entry], serials: dict[str, int | None]
) -> file.Identified:
    """Content of the robot's file with the entries of one step merged into it.

    Entries of another drive are dropped. Entries of another configuration, recognised by their
    digest, stay in case it returns; those without, in a file of an older format, are dropped.
    """
    joints = _marked(robot)
    for name, found in entries.items():
        of = digests_of(robot.configuration, robot.urdf, name)
        entry = msgspec.structs.replace(found, of=of[found.depends])
        known = joints.get(name, file.IdentifiedJoint(serial=serials.get(name)))
        if name in serials and known.serial != serials[name]:
            known = file.IdentifiedJoint(serial=serials[name])
        joints[name] = msgspec.structs.replace(known, **{step: entry})
    order = {name: joints[name] for name in robot.configuration.joint_names if name in joints}
    kept = robot.identified.payloads if robot.identified else {}
    return file.Identified(joints=order, payloads=kept)


def _marked(robot: Robot) -> dict[str, file.IdentifiedJoint]:
    """Entries of the file by joint; those in force get the digests of the present format."""
    old = robot.identified or file.Identified()
    c, urdf = robot.configuration, robot.urdf

    def marked(name: str, joint: file.IdentifiedJoint) -> file.IdentifiedJoint:
        changes: dict[str, file.Entry | None] = {}
        for step, entry in file.entries_of(joint).items():
            if name in c.joint_names and in_force(entry, name, old, c, urdf):
                of = digests_of(c, urdf, name)[entry.depends]
                changes[step] = msgspec.structs.replace(entry, of=of)
            elif not entry.of:
                changes[step] = None
        return msgspec.structs.replace(joint, **changes)

    return {name: marked(name, joint) for name, joint in old.joints.items()}


def merged_payloads(robot: Robot, found: dict[str, file.IdentifiedPayload]) -> file.Identified:
    """Content of the robot's file with these payloads merged into it."""
    old = robot.identified or file.Identified()
    return msgspec.structs.replace(old, payloads=old.payloads | found)
