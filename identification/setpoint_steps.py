"""Setpoints that a drive does not ramp evenly: whether its sampled current misses acceleration.

A drive that ramps from setpoint to setpoint accelerates evenly, and current sampled once a period
represents the whole period. One that steps, or ramps too fast, applies the current for the
acceleration at once, and half of it is over when it is sampled, at any speed of the arm: links and
rotor seem lighter by the same share everywhere, B absorbs all of it, and the fit is as good as
ever. What was missed follows the change of the setpoint, which precedes the acceleration: B is
fitted again beside a column of these changes. If a drive ramps, both fits agree.
"""

from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from identification.log_intervals import Intervals, Mask
from identification.regression import COLUMNS, Regression, Solution, solve

STEP_GAIN = 60.0
"""K_r [1/s] of this comparison: setpoint and acceleration differ at high frequencies."""
_WIDER = 2.0  # ratio of what may be missed to what is seen: the loop's own noise hides a part
# Share of B, and its ratio to its standard error, that show a step in one joint; in a third of
# several, hence in all; and, in half of several, a setpoint that acts just before the sample.
_ALONE, _TOGETHER, _LATE = (0.05, 3.0), (0.04, 2.0), (0.05, 3.0)
_FEW = 3  # joints, in which the largest share is taken instead of the second
_B = COLUMNS.index("B")

NO_SETPOINTS = (
    "the log has no setpoints, which show whether a drive takes them as steps: B might come out "
    "too small, and keeps its value. Record the log by `contactctl record`, or add columns "
    "`setpoint.JOINT`"
)
STEPS = (
    "the drives take setpoints as steps, or ramp too fast, and their sampled current is not "
    "that of the period: B would come out wrong, mostly too small, and keeps its value. Have them "
    "ramp over the period (0x60C2, or what their manual calls interpolation); if they cannot, "
    "give `rotor_inertia` by the motor's data sheet, times gear squared"
)
OF_POSITIONS = "such motors do not show it: give that of the data sheet, times gear squared"
OR_MASSES = (
    "or the URDF's masses are wrong, which looks alike: run `contactd identify masses`, then "
    "`friction` again"
)


def missed(found: Regression, solved: Sequence[Solution], rows: Intervals) -> tuple[Vector, Vector]:
    """Increase of each rotor's inertia (n,) in a fit beside the changes of the setpoint, as a share
    of that of the fit, and its standard error; 0 and infinite if B was not fitted.

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
        rotor = max(float(one.coefficients[_B]), 1e-12)
        more[i], error[i] = (beside[_B] - alone[_B]) / rotor, errors[_B] / rotor
    return more, error


def stepping(more: Vector, error: Vector, makes: Sequence[str]) -> Mask:
    """Joints (n,) whose drives step, by shares and errors of `missed`: all of a make if one clearly
    does, and all of the arm if several seem to."""
    known = np.count_nonzero(np.isfinite(error))

    def beyond(bound: tuple[float, float], more: Vector = more) -> Mask:
        return np.asarray((more > bound[0]) & (more > bound[1] * error))

    several = np.count_nonzero(beyond(_TOGETHER)) >= max(2, known / 3)
    late = np.count_nonzero(beyond(_LATE, -more)) >= max(2, known / 2)
    steps = {make for make, one in zip(makes, beyond(_ALONE), strict=True) if one}
    return np.array([make in steps for make in makes]) | several | late


def hidden(more: Vector, error: Vector) -> Vector:
    """Standard error of each B (n,), as a share of it, by what setpoints may hide from its fit: as
    much as it shows itself, or as two other joints do, or the other one of few, as the drives of an
    arm are mostly of one make."""
    shown = np.maximum(more, 0.0)
    common = float(np.sort(shown)[-1 if len(shown) <= _FEW else -2])
    return np.hypot(_WIDER * np.maximum(shown, common), error)
