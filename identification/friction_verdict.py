"""Verdict on a joint's friction: whether it may be used, the reason, and advice."""

from enum import StrEnum

import numpy as np

from common.arrays import Vector
from identification.regression import Solution

LOWEST_R2 = 0.9
HIGHEST_CONDITION = 100.0
SLOWEST = 0.15
"""Speed [rad/s] that a joint must reach to count as excited."""
TURNS = 4
"""Number of reversals that a joint must make to count as excited."""
GRAVITY_TOLERANCE = 0.3
_GRAVITY_OFF = 0.05
WIDEST_PLAY = 2.5
"""[half-gaps]; two are the gap itself."""
GIVE = 0.006
"""Relative motion that bending gears, late encoders and drift may add [rad]."""
_MOST_CUT = 0.05


class Verdict(StrEnum):
    """Verdict on a joint's coefficients; all except `good` keep the old ones."""

    GOOD = "good"
    NOT_EXCITED = "not excited"
    ILL_CONDITIONED = "ill conditioned"
    BAD_FIT = "fits badly"
    SATURATED = "current saturated"
    WRONG_GRAVITY = "current and gravity disagree"
    WRONG_GAP = "the gap is wider"
    COUPLED = "coupled with another joint"
    SWINGS = "swings by itself"
    NO_CONSTANT = "torque constant unknown"


def verdict_on(
    theta_dot: Vector, cut: float, gravity: float, solved: Solution
) -> tuple[Verdict, str]:
    """Verdict and reason for a motion (N,) [rad/s] whose current was at its limit for the share
    `cut` of the time; gravity: as `FrictionFit.gravity_scale`."""
    if about := unexcited(theta_dot):
        return Verdict.NOT_EXCITED, about
    if about := saturated(cut):
        return Verdict.SATURATED, about
    if not solved.condition < HIGHEST_CONDITION:
        about = (f"condition number {solved.condition:.0f}: a longer motion (`--seconds`), or more "
                 "range and speed (`limits`)")  # fmt: skip
        return Verdict.ILL_CONDITIONED, about
    if abs(gravity - 1.0) > GRAVITY_TOLERANCE:
        about = (f"the motor gives {gravity:.2f} times the torque that the URDF asks for: check "
                 "`torque_constant` and the payload; where the URDF's masses are wrong, run "
                 "`contactd identify masses`")  # fmt: skip
        return Verdict.WRONG_GRAVITY, about
    if solved.r2 < LOWEST_R2:
        return Verdict.BAD_FIT, _poor(solved.r2, gravity)
    return Verdict.GOOD, ""


def unexcited(theta_dot: Vector) -> str:
    """Reason why a motion (N,) [rad/s] does not excite its joint, or ""."""
    speed = np.abs(theta_dot)
    turns = int(np.count_nonzero(np.diff(np.sign(theta_dot[speed > 0.05]))))
    if speed.max() >= SLOWEST and turns >= TURNS:
        return ""
    return (f"fastest {speed.max():.2g} rad/s, {turns} reversals: allow more range or speed "
            "(`limits`)")  # fmt: skip


def saturated(cut: float) -> str:
    """Reason why a current at its limit for the share `cut` of the time is insufficient, or ""."""
    if cut <= _MOST_CUT:
        return ""
    return (f"the current was at its limit {cut:.0%} of the time: less acceleration (`limits`), or "
            "more current")  # fmt: skip


def _poor(r2: float, gravity: float) -> str:
    """Reason and advice for a fit that explains too little of the remaining torque."""
    if not np.isfinite(r2):
        return "too little motion is left to test it on: a longer one (`--seconds`), or more logs"
    about = f"R2 {r2:.3f} on held-out motion, at least {LOWEST_R2}: "
    if abs(gravity - 1.0) > _GRAVITY_OFF:
        return (f"{about}gravity fits at {gravity:.2f}: check masses or `torque_constant`, or run "
                "`contactd identify masses`")  # fmt: skip
    return (
        f"{about}hands off, and nothing in its way? If so, check masses or `torque_constant`: "
        "run `contactd identify masses`; or it is not friction (a spring, a hose): friction.png "
        "shows the residual"
    )


def wider(moved: float, half_gap: float) -> str:
    """Reason why the gap must be wider, if link and rotor usually move `moved` [rad] against each
    other, or "": a hand that stops short of a border makes a half-gap too small."""
    if moved <= WIDEST_PLAY * half_gap + GIVE:
        return ""
    return (
        f"in this motion link and rotor moved by {1e3 * moved:.3g} mrad against each other; a "
        f"half-gap of {1e3 * half_gap:.3g} mrad lets them move by {2e3 * half_gap:.3g}: identify "
        "the gap again, which also shows whether the link encoder is late"
    )
