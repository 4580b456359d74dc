"""Advice on friction that is good, and not known well: what would make its interval narrower."""

from math import ceil

from estimator.identification.friction_fit import WIDE, FrictionFit
from estimator.identification.friction_verdict import Verdict

LONGEST_S = 600
"""Longest motion that a step makes [s]: what `--seconds` takes."""
_STEP_S = 10


def surer(fits: list[FrictionFit], *, weighed: bool) -> tuple[str, ...]:
    """One sentence about the joints whose friction is known worse than to `WIDE`, or none; weighed:
    their masses were identified."""
    good = [fit for fit in fits if fit.verdict is Verdict.GOOD and fit.unsure > WIDE]
    wide = [fit for fit in good if _half(fit.unsure) != _half(WIDE)]
    if not wide:
        return ()
    about = "friction is known of " + ", ".join(
        f"{fit.joint} to {_half(fit.unsure)}" for fit in wide
    )
    if weighed:
        return (f"{about}: {_longer(wide)}",)
    return (
        f"{about}, as the URDF's masses may be off: run `contactd identify masses`, then "
        f"`friction` again; where the URDF is as good, {_longer(wide)}",
    )


def _longer(fits: list[FrictionFit]) -> str:
    """How long a motion makes the intervals as narrow as `WIDE`, or how narrow the longest does."""
    seconds = {fit.joint: fit.seconds_for(WIDE) for fit in fits}
    enough = [needed for needed in seconds.values() if needed <= LONGEST_S]
    never = [fit for fit in fits if seconds[fit.joint] > LONGEST_S]
    parts = []
    if enough:
        whose = f" of {', '.join(j for j, s in seconds.items() if s <= LONGEST_S)}" if never else ""
        longer = min(LONGEST_S, _STEP_S * ceil(max(enough) / _STEP_S))
        parts.append(f"`--seconds {longer}` tells that{whose} to {_half(WIDE)}")
    if never:
        after = ", ".join(f"{f.joint} {_half(f.unsure_after(LONGEST_S))}" for f in never)
        parts.append(
            f"`--seconds {LONGEST_S}` leaves {after}: what masses and torque constants may be off "
            "does not go with a longer motion"
        )
    return "; ".join(parts)


def _half(width: float) -> str:
    return f"+-{50.0 * width:.2g} %"
