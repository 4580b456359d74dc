"""Evidence for the parameters of an arm: which are identified, by which step, and on which drives.

The daemon refuses to arm if `identified.yaml` belongs to other drives or to another configuration,
or if a required parameter is missing.
"""

from typing import get_args

from daemon.config.digests import digests, digests_of, fingerprint
from daemon.config.identified import ENTRIES, Entry, Identified, IdentifiedPayload, used_entries
from daemon.config.schema import ArmingStep, Configuration
from daemon.protocol.text import printable


def objections(
    found: Identified | None, c: Configuration, urdf: str, serials: dict[str, int | None]
) -> list[str]:
    """Reasons not to arm this arm with this file; empty if there are none.

    serials: serial numbers that the drives reported, by joint. Simulated arms follow the same rule:
    each arm in `configs/` ships its own file, which is valid for its drives only.
    """
    reasons = []
    for step, stated in (("wiring", ""), ("zero", "=RAD")):
        if names := outdated(step, found, c, urdf):
            command = " ".join(["contactd identify", step, *(name + stated for name in names)])
            reasons.append(
                f"the {step} of {', '.join(names)} in {c.identified} belongs to another "
                f"configuration: {ENTRIES[step].depends} were changed since (`{command}` again)"
            )
    for joint in c.joints:
        known = found.joints.get(joint.name) if found is not None else None
        if (
            known is not None
            # Found from logs alone, values are of no known drive.
            and (known.wiring is not None or known.serial is not None)
            and known.serial != (serial := serials.get(joint.name))
        ):
            reasons.append(
                f"{joint.name} was identified on drive {known.serial}, this is drive {serial}"
            )
    if names := unidentified("wiring", found, c):
        reasons.append(
            f"the wiring of {', '.join(names)} was never checked (`contactd identify wiring`)"
        )
    return reasons


def unidentified(step: ArmingStep, found: Identified | None, c: Configuration) -> list[str]:
    """Joints that have not passed an identification step and do not declare its values in `known`.
    Without the wiring step a sign may be wrong, and a position loop closed on the link would be
    unstable."""
    entries = found.joints if found is not None else {}
    return [
        joint.name
        for joint in c.joints
        if step not in joint.known and getattr(entries.get(joint.name), step, None) is None
    ]


def outdated(step: str, found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Joints that passed a step, whose results a later change of the configuration invalidated, and
    whose identified values are used all the same."""
    if found is None:
        return []
    return [
        joint.name
        for joint in c.joints
        if (entry := used_entries(joint, found).get(step)) is not None
        # Values of an entry are used even if others are stated beside; those of wiring are none.
        and not (step == "wiring" and step in joint.known)
        and not in_force(entry, joint.name, found, c, urdf)
    ]


def void_payloads(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Payloads that were weighed before a change of what their weight depends on."""
    of = digests(c, urdf)[IdentifiedPayload.depends]
    return [name for name, load in (found.payloads if found else {}).items() if load.of != of]


def in_force(entry: Entry, name: str, found: Identified, c: Configuration, urdf: str) -> bool:
    """True if no dependency changed. Older entries are marked for all joints, oldest files once."""
    part, oldest = entry.depends, found.configuration == fingerprint(c, urdf)
    return (
        oldest
        if not entry.of
        else entry.of in (digests_of(c, urdf, name)[part], digests(c, urdf)[part])
    )


def unarmable(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Reasons not to arm this arm, whatever the drives' serial numbers; empty if there are none."""
    entries = found.joints if found is not None else {}
    same = {name: entry.serial for name, entry in entries.items()}
    return [*objections(found, c, urdf, same), *parameters_missing(found, c, urdf)]


def parameters_missing(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Reasons not to arm: parameters that the file lacks, or that a later change invalidated, each
    with the command to run; empty if there are none."""
    reasons = []
    for step in get_args(ArmingStep):
        if step == "wiring":  # covered by `objections`
            continue
        command = f"`contactd identify {step}{' JOINT' if step == 'gap' else ''}`"
        names = unidentified(step, found, c)
        if names and not ENTRIES[step].optional:
            reasons.append(
                f"the {step} of {', '.join(names)} not identified ({command}; or, if known "
                f"otherwise, state how: `known: {{{step}: ...}}` in config.yaml)"
            )
        if names := outdated(step, found, c, urdf):
            reasons.append(
                f"the {step} of {', '.join(names)} identified before {ENTRIES[step].depends} were "
                f"changed ({command} again)"
            )
    if names := outdated("encoders", found, c, urdf):
        reasons.append(
            f"the encoders of {', '.join(names)} identified before {ENTRIES['encoders'].depends} "
            f"were changed (`contactd identify encoders {' '.join(names)}` again, or delete their "
            f"`encoders` in {c.identified})"
        )
    return reasons


def parameters_known(found: Identified | None, c: Configuration) -> str:
    """Summary of the parameters' sources: identification, or the source stated in `known`."""
    stated: dict[tuple[str, str], list[str]] = {}
    for joint in c.joints:
        entries = found.joints.get(joint.name) if found is not None else None
        for step, how in joint.known.items():
            if step not in used_entries(joint, found):
                more = " (the identified ones are not used)" if getattr(entries, step, None) else ""
                stated.setdefault((step, how + more), []).append(joint.name)
    if not stated:
        return "gap, friction and thresholds of every joint are identified"
    return "known otherwise: " + "; ".join(
        f"{step} of {'all' if names == c.joint_names else ', '.join(names)}: {printable(how)}"
        for (step, how), names in stated.items()
    )
