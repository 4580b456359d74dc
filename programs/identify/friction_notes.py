"""Notes on good friction fits: wide confidence intervals, and parameters that may be wrong."""

from collections.abc import Sequence
from math import ceil

from identification.friction_fit import WIDE, FrictionFit
from identification.friction_verdict import Verdict

LONGEST_S = 600
"""Longest excitation of a step [s], and largest value of `--seconds`."""
_STEP_S = 10
_SCALE = 0.1
"""Relative error of gravity torques above which it is reported."""
_LOAD = 0.1
"""Undetectable friction per transmitted torque above which it is reported."""


def wide_intervals(fits: list[FrictionFit], *, masses_identified: bool) -> tuple[str, ...]:
    """Sentence about joints whose friction has a relative confidence interval above `WIDE`, and how
    to narrow it, or none."""
    good = [fit for fit in _good(fits) if fit.uncertainty > WIDE]
    wide = [fit for fit in good if _half(fit.uncertainty) != _half(WIDE)]
    if not wide:
        return ()
    about = "friction is known to " + ", ".join(
        f"{_half(fit.uncertainty)} at {fit.joint}" for fit in wide
    )
    weigh = [fit.joint for fit in wide if fit.masses_matter and not masses_identified]
    if not weigh:
        return (f"{about}: {_longer(wide)}",)
    whose = f" ({', '.join(weigh)})" if len(weigh) < len(wide) else ""
    return (
        f"{about}, as the URDF's masses may be wrong{whose}: run `contactd identify masses`, then "
        f"`friction` again; if the URDF is good enough, {_longer(wide)}",
    )


def _longer(fits: list[FrictionFit]) -> str:
    """Words on the excitation length that narrows the intervals to `WIDE`, or on the intervals that
    the longest one leaves."""
    seconds = {fit.joint: fit.seconds_for(WIDE) for fit in fits}
    enough = [needed for needed in seconds.values() if needed <= LONGEST_S]
    never = [fit for fit in fits if seconds[fit.joint] > LONGEST_S]
    parts = []
    if enough:
        whose = f" of {', '.join(j for j, s in seconds.items() if s <= LONGEST_S)}" if never else ""
        longer = min(LONGEST_S, _STEP_S * ceil(max(enough) / _STEP_S))
        parts.append(f"`--seconds {longer}` narrows that{whose} to {_half(WIDE)}")
    if never:
        after = {fit.joint: _half(fit.uncertainty_after(LONGEST_S)) for fit in never}
        less = [f"{fit.joint} {after[fit.joint]}" for fit in never
                if after[fit.joint] != _half(fit.uncertainty)]  # fmt: skip
        parts.append(
            (f"`--seconds {LONGEST_S}` leaves {', '.join(less)}: " if less else "")
            + "a longer motion does not reduce errors of masses, of torque constants, of friction "
            "that falls with speed, or of setpoints that change within a period"
        )
    return "; ".join(parts)


def _half(width: float) -> str:
    return f"+-{float(f'{50.0 * width:.2g}'):g} %"


def off_scale(fits: list[FrictionFit]) -> tuple[str, ...]:
    """Sentence about good fits whose gravity shows wrong torque constants or masses, or none."""
    about = [
        f"{fit.joint} by {100.0 * (fit.gravity_scale - 1.0):+.0f} % ({fit.gravity_off:.2g} Nm)"
        for fit in _good(fits)
        if abs(fit.gravity_scale - 1.0) > _SCALE and fit.gravity_off
    ]
    if not about:
        return ()
    return (
        f"torque constants or masses are wrong: {', '.join(about)}. If it is `torque_constant`, "
        "friction and rotor are wrong by as much, as their errors show: check it by the motor's "
        "data sheet first, as masses identified with it would hide that",
    )


def load_doubts(fits: list[FrictionFit]) -> tuple[str, ...]:
    """Sentence about joints where load-dependent friction would not be observable, or none."""
    about = [fit.joint for fit in _good(fits) if fit.load is None and fit.load_bound > _LOAD]
    if not about:
        return ()
    return (
        f"friction that grows with the load cannot be seen at {', '.join(about)}, as the load on "
        "the gear changes too little: if it matters, repeat `friction` with a payload in the hand "
        "(`contactctl payload`)",
    )


def rotor_doubts(fits: list[FrictionFit], costs: Sequence[float]) -> tuple[str, ...]:
    """Sentences about rotor inertias that are rejected, one for each reason, with the joints' names
    and the increase of levels if rotors were twice those in force, whose torques at full
    acceleration are `costs` [Nm]."""
    why: dict[str, dict[str, float]] = {}
    for fit, cost in zip(fits, costs, strict=True):
        if fit.rotor_doubt and fit.verdict is Verdict.GOOD:
            why.setdefault(fit.rotor_doubt, {})[fit.joint] = cost
    sentences: list[str] = []
    for doubt, of in why.items():
        costs_of = ", ".join(f"{cost:.2g}" for cost in of.values())
        then = (f". If rotors are twice those in force, levels bear {costs_of} Nm more"
                if any(of.values()) else "")  # fmt: skip
        sentences.append(f"B of {', '.join(of)} is rejected: {doubt}{then}")
    return tuple(sentences)


def _good(fits: list[FrictionFit]) -> list[FrictionFit]:
    return [fit for fit in fits if fit.verdict is Verdict.GOOD]
