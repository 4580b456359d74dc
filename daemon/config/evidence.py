"""Evidence for the parameters of an arm: what is identified, with what, and on which drives.

The daemon refuses to arm with an `identified.yaml` that belongs to other drives or to another
configuration of them, and without what must be known.
"""

from daemon.config.identified import Identified
from daemon.config.marks import fingerprint, marks
from daemon.config.schema import AnyStep, Configuration, Step
from daemon.protocol.messages import printable

# What arming looks at beside the wiring, in the order in which it is identified.
_PARAMETERS: tuple[tuple[Step, str, str], ...] = (
    ("gap", "the gap", "`contactd identify gap JOINT`"),
    ("masses", "the masses", "`contactd identify masses`"),
    ("friction", "the friction", "`contactd identify friction`"),
    ("thresholds", "the thresholds", "`contactd identify thresholds`"),
)
# What voids each of them, in words (`daemon.config.marks`).
_CHANGED: dict[Step, str] = {
    "wiring": "drives, wiring, torque constants, period or the URDF's joints",
    "gap": "drives, wiring, period or the URDF's joints",
    "masses": "drives, wiring, torque constants, period or URDF",
    "friction": "drives, wiring, torque constants, period, URDF or identified masses",
    "thresholds": "drives, wiring, torque constants, period, URDF or identified masses",
}
OPTIONAL: frozenset[Step] = frozenset({"masses"})
"""Steps without which the configuration's values, or the URDF's, may be right."""


def objections(
    found: Identified | None, c: Configuration, urdf: str, serials: dict[str, int | None]
) -> list[str]:
    """Reasons not to arm this arm with this file; empty if there are none.

    `serials` are those of the drives that answered, by joint. Simulated arms are no exception:
    those of `configs/` come with a file of their own, which fits no other drives.
    """
    reasons = []
    if names := outdated("wiring", found, c, urdf):
        reasons.append(
            f"the wiring of {', '.join(names)} in {c.identified} belongs to another configuration: "
            f"{_CHANGED['wiring']} were changed since (`contactd identify wiring` again)"
        )
    if names := outdated("zero", found, c, urdf):
        reasons.append(
            f"the zero of {', '.join(names)} in {c.identified} belongs to another arm: drives, "
            "nodes or the URDF's joints were changed since (`contactd identify zero` again)"
        )
    for joint in c.joints:
        known = found.joints.get(joint.name) if found is not None else None
        if (
            known is not None
            and known.wiring is not None
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


def unidentified(step: Step, found: Identified | None, c: Configuration) -> list[str]:
    """Joints that a step of the identification has not passed, and that are not known otherwise.
    Without that of the wiring a sign may be wrong, and every loop over the links drives them
    away."""
    entries = found.joints if found is not None else {}
    return [
        joint.name
        for joint in c.joints
        if step not in joint.known and getattr(entries.get(joint.name), step, None) is None
    ]


def outdated(step: AnyStep, found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Joints that passed a step before something was changed that it depends on, and that are not
    known otherwise."""
    if found is None:
        return []
    mark = marks(c, urdf)[step]
    of_all = found.configuration == fingerprint(c, urdf)
    entries = {name: getattr(joint, step) for name, joint in found.joints.items()}
    return [
        joint.name
        for joint in c.joints
        if step not in joint.known
        and (entry := entries.get(joint.name)) is not None
        and not (entry.of == mark if entry.of else of_all)
    ]


def unarmable(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Reasons why this arm will not be armed, whichever drives answer; empty if there are none."""
    entries = found.joints if found is not None else {}
    same = {name: entry.serial for name, entry in entries.items()}
    return [*objections(found, c, urdf, same), *parameters_missing(found, c, urdf)]


def parameters_missing(found: Identified | None, c: Configuration, urdf: str) -> list[str]:
    """Reasons not to arm: the gaps, friction and thresholds that the file does not have, or that
    something was changed for since, each with the command to run; empty if there are none."""
    reasons = []
    for step, what, command in _PARAMETERS:
        names = unidentified(step, found, c)
        if names and step not in OPTIONAL:
            reasons.append(
                f"{what} of {', '.join(names)} not identified ({command}; or, known otherwise, say "
                f"how: `known: {{{step}: ...}}` in config.yaml)"
            )
        if names := outdated(step, found, c, urdf):
            reasons.append(
                f"{what} of {', '.join(names)} identified before {_CHANGED[step]} were changed "
                f"({command} again)"
            )
    return reasons


def parameters_known(found: Identified | None, c: Configuration) -> str:
    """Evidence that the parameters are right: identified, or how else they are known."""
    entries = found.joints if found is not None else {}
    said: dict[tuple[str, str], list[str]] = {}
    for joint in c.joints:
        for step, how in joint.known.items():
            if getattr(entries.get(joint.name), step, None) is not None:
                continue
            said.setdefault((step, how), []).append(joint.name)
    if not said:
        return "gap, friction and thresholds of every joint are identified"
    everywhere = [joint.name for joint in c.joints]
    return "known otherwise: " + "; ".join(
        f"{step} of {'all' if names == everywhere else ', '.join(names)}: {printable(how)}"
        for (step, how), names in said.items()
    )
