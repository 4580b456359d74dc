"""Diagnoses of an arm for `/diagnostics`: its mode, faults and joints. Pure functions."""

from daemon.faults.finding import advice_on
from daemon.modes.table import Mode
from daemon.protocol.replies import Status
from daemon.protocol.state import State
from programs.zenoh.messages import Diagnosis, Level

Key = tuple[object, ...]


def changed(state: State) -> Key:
    """Values whose change causes a message at once."""
    return (
        state.mode,
        state.armed,
        state.cause,
        state.silenced,
        tuple(state.unproved),
        tuple(state.sensing or ()),
        tuple(state.drives),
    )


def of(state: State, joints: list[str], arm: str, status: Status | None) -> list[Diagnosis]:
    """Diagnoses of the arm and each of its joints; `status`: a recent one, for values that States
    lack."""
    return [_arm(state, arm, status), *_joints(state, joints, arm, status)]


def gone(arm: str, why: str) -> list[Diagnosis]:
    """Diagnosis of an arm whose daemon cannot be reached."""
    return [Diagnosis(Level.STALE, f"contactd: {arm}", why, arm)]


def _arm(state: State, arm: str, status: Status | None) -> Diagnosis:
    faulted = state.mode is Mode.FAULTED or state.silenced
    level = Level.ERROR if faulted else Level.WARN if state.unproved else Level.OK
    faults = "; ".join(notice.text for notice in state.notices if notice.kind == "fault")
    values = [
        ("mode", str(state.mode)),
        ("armed", str(state.armed).lower()),
        ("cause", state.cause),
        ("armed by", _owner(state)),
        ("not seen to stand", ", ".join(state.unproved)),
        ("drives hear nothing", str(state.silenced).lower()),
        ("faults of this tick", faults),
        ("lateness", f"{state.timing.lateness_us:.0f} us"),
        ("deadlines missed", str(state.timing.missed)),
        ("flags", ", ".join(state.flags)),
    ]
    if status is not None and status.cause == state.cause:
        values.append(("what to do", status.advice))
    elif advice := advice_on(state.cause):
        values.append(("what to do", advice))
    text = f"{state.mode}{', armed' if state.armed else ''}: {state.cause}"
    return Diagnosis(level, f"contactd: {arm}", text, arm, tuple(values))


def _owner(state: State) -> str:
    if state.permit is None:
        return ""
    who = f"uid {state.permit.uid} (pid {state.permit.pid})"
    behalf = state.permit.on_behalf_of
    return f"{who} on behalf of {behalf}" if behalf else who


def _joints(state: State, joints: list[str], arm: str, status: Status | None) -> list[Diagnosis]:
    learned = status.learned if status is not None and status.joints == joints else None
    sensing = state.sensing if state.sensing is not None else [True] * len(joints)
    made = []
    for i, name in enumerate(joints):
        values = [
            ("drive", state.drives[i]),
            ("senses", str(sensing[i]).lower()),
            ("sample is fresh", str(state.fresh[i]).lower()),
            ("side of the gap", state.side[i]),
        ]
        if learned is not None:
            values.append(("learned: coulomb friction", f"{learned.coulomb[i]:+.1%}"))
            values.append(("learned: viscous friction", f"{learned.viscous[i]:+.1%}"))
            values.append(("learned: friction of load", f"{learned.load[i]:.1%}"))
        faulted = "fault" in state.drives[i]
        level = Level.ERROR if faulted else Level.OK if sensing[i] else Level.WARN
        text = state.drives[i] if faulted else "senses contact" if sensing[i] else "senses nothing"
        made.append(Diagnosis(level, f"contactd: {arm}: {name}", text, arm, tuple(values)))
    return made
