"""Setpoints that a drive does not ramp evenly: whether its sampled current misses acceleration.

A drive that ramps from setpoint to setpoint accelerates evenly, and current sampled once a period
is that of the whole period. One that steps, or ramps too fast, spends the current for the
acceleration at once, and it is half over when it is sampled, at whatever speed the arm moves: links
and rotor seem lighter by the same share everywhere, B takes all of it, and the fit is as good as
ever. What was missed goes with the change of the setpoint, which comes before the acceleration: B
is fitted once more beside a column of these changes. Where a drive ramps, both fits agree.
"""

from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from identification.log_intervals import Intervals, Mask
from identification.regression import COLUMNS, Regression, Solution, solve

STEP_GAIN = 60.0
"""K_r [1/s] of this comparison: setpoint and acceleration differ in what is fast."""
_WIDER = 2.0  # times what is seen to be missed may be: the loop's own noise hides a part
# Share of B, and standard errors of it, that show a step in one joint and, in a third of several,
# in all; and that show, in half of several, a setpoint that acts just before the sample.
_ALONE, _TOGETHER, _LATE = (0.05, 3.0), (0.04, 2.0), (0.05, 3.0)
_FEW = 3  # joints, of which one is a third
_B = COLUMNS.index("B")

NO_SETPOINTS = (
    "the log has no setpoints, by which a drive that takes them as steps is known: B would come "
    "out too small, and keeps its value. Record it by `contactctl record`, or add columns "
    "`setpoint.JOINT`"
)
STEPS = (
    "the drives take setpoints as steps, or ramp too fast, and their current when it is sampled is "
    "not that of the period: B would come out wrong, mostly too small, and keeps its value. Have "
    "them ramp over the period (0x60C2, or what their manual calls interpolation); where they "
    "cannot, give `rotor_inertia` by the motor's data sheet, times gear squared"
)
OF_POSITIONS = "such motors do not show it; that of the data sheet, times gear squared, is right"
OR_MASSES = (
    "or masses, which are the URDF's, are off, and look like that: run `contactd identify masses`, "
    "then `friction` again"
)


def missed(found: Regression, solved: Sequence[Solution], rows: Intervals) -> tuple[Vector, Vector]:
    """By how much each rotor's inertia is larger (n,) beside the changes of the setpoint, as a
    share of that of the fit, and its standard error; 0 and infinite where B was not fitted.

    found: filtered by `STEP_GAIN`.
    """
    more, error = np.zeros(len(solved)), np.full(len(solved), np.inf)
    for i, one in enumerate(solved):
        used = np.isfinite(one.errors)
        if not used[_B]:
            continue
        A, N, y = found.columns[:, i], found.nuisance[:, i], found.r_nl[:, i]
        alone, *_ = solve(A, N, y, one.weight, used, rows.time_s)
        N = np.column_stack([N, found.asked[:, i]])
        beside, errors, _ = solve(A, N, y, one.weight, used, rows.time_s)
        whole = max(float(one.coefficients[_B]), 1e-12)
        more[i], error[i] = (beside[_B] - alone[_B]) / whole, errors[_B] / whole
    return more, error


def stepping(more: Vector, error: Vector, makes: Sequence[str]) -> Mask:
    """Joints (n,) whose drives step, by shares and errors of `missed`: all of a make where one
    clearly does, and all of the arm where several seem to."""
    known = np.count_nonzero(np.isfinite(error))

    def beyond(bound: tuple[float, float], more: Vector = more) -> Mask:
        return np.asarray((more > bound[0]) & (more > bound[1] * error))

    several = np.count_nonzero(beyond(_TOGETHER)) >= max(2, known / 3)
    late = np.count_nonzero(beyond(_LATE, -more)) >= max(2, known / 2)
    steps = {make for make, one in zip(makes, beyond(_ALONE), strict=True) if one}
    return np.array([make in steps for make in makes]) | several | late


def hidden(more: Vector, error: Vector) -> Vector:
    """Standard error of each B (n,), as a share of it, by what setpoints may hide from its fit: by
    what it shows itself, or two other joints do, or another one of few, as an arm's drives are
    mostly of one make."""
    shown = np.maximum(more, 0.0)
    common = float(np.sort(shown)[-1 if len(shown) <= _FEW else -2])
    return np.hypot(_WIDER * np.maximum(shown, common), error)
