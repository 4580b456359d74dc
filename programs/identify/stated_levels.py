"""Contact levels stated in config.yaml and identified ones: which are in force. Pure functions."""

from collections.abc import Iterator

import msgspec

from daemon.config import identified as file
from daemon.config.checks import least_levels
from daemon.config.problem import Problem, at
from daemon.config.schema import Configuration, Joint
from daemon.protocol.text import printable


def source(joint: Joint, found: file.Identified | None) -> str:
    """Source of the level in force, in words."""
    if "thresholds" in joint.known:
        return "stated in config.yaml"
    entry = file.used_entries(joint, found).get("thresholds")
    return f"identified on {printable(entry.date)[:10]}" if entry else "config.yaml, not identified"


def unused(c: Configuration, found: file.Identified | None) -> Iterator[Problem]:
    """Problems of identified levels that are not used, with a warning if the stated level is lower,
    at rest or at the largest measured speed."""
    for i, joint in enumerate(c.joints):
        entry = found.joints.get(joint.name, file.IdentifiedJoint()).thresholds if found else None
        if entry is None or "thresholds" not in joint.known:
            continue
        stated, measured = joint.thresholds, entry.thresholds
        speed = entry.seen.speed if entry.seen else 0.0
        more = max(measured.per_speed - stated.per_speed, 0.0) * speed
        text = (
            f"{stated.contact:g} Nm is stated in config.yaml and in force; {measured.contact:g} "
            f"Nm, identified on {printable(entry.date)[:10]} ({c.identified}), is not used: to use "
            "it, remove `thresholds` from its `known`"
        )
        if measured.contact + more > stated.contact:
            text += "; the stated level is below the measured one: expect false contacts"
        yield Problem(*at(i, joint, "thresholds", "contact"), text)


def misfits(c: Configuration, found: file.Identified) -> dict[str, str]:
    """Reasons, by joint, why `least` in `config.yaml` (`c`) contradicts identified levels."""
    return {
        joint.name: f"thresholds.least of config.yaml: {problem.what}"
        for joint in c.joints
        if joint.name in found.joints
        for problem in least_levels(
            file.applied(msgspec.structs.replace(c, joints=[joint]), found), found
        )
    }
