"""Outcome of the direct friction test: where points differ from the friction law in force by more
than scatter and confidence interval, as a share of the contact level. Changes no value."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.stats import binom

from daemon.assembly import build_transmission
from daemon.config.load import Robot
from daemon.config.vectors import row
from identification.direct_friction import Law, Point, grouped_strokes, points
from identification.log_checks import refuse_implausible
from programs.identify.measured import Measured
from programs.identify.plots import plot_direct
from programs.identify.step import Line, Outcome

_NOT_SEEN = "it never moved alone at one speed, three strokes or more, to and fro at one place"
_NEGATIVE = "the friction measured is not positive: is the current there, and its sign right?"
_TO_DO = (
    "nothing was changed. `contactd identify friction` fits the law anew, with a payload where "
    "loads are off; then `thresholds`, as levels hold for the loads and speeds of their motion"
)
_VARIES = 0.5  # least change of load, over friction, from which its effect is estimated


def direct_outcome(robot: Robot, measured: Measured, joints: Sequence[str]) -> Outcome:
    """Measured points of each joint compared with its friction law. Raises LogError for implausible
    measurements."""
    c, lines, shown = robot.configuration, list[Line](), dict[str, tuple[Law, list[Point]]]()
    refuse_implausible(measured.log, row(c, lambda j: j.wiring.max_current_A))
    for name in joints:
        i = c.joint_names.index(name)
        levels, constant = c.joints[i].thresholds, c.joints[i].torque_constant
        found = points(
            grouped_strokes(measured.log, i, constant, 1e-3 * c.estimator.current_delay_ms)
        )
        if not found:
            lines.append(Line(name, "not seen", good=False, reason=_NOT_SEEN))
            continue
        if np.median([point.friction for point in found]) <= 0.0:
            lines.append(Line(name, "implausible", False, _figures(found), _NEGATIVE))
            continue
        shown[name] = law, _ = law_of(robot, i), found
        why = disagreement(law, found, levels.contact, levels.per_speed)
        verdict = "disagrees" if why else "agrees"
        lines.append(Line(name, verdict, not why, _figures(found), why))
    notes = (_TO_DO,) if any(line.verdict == "disagrees" for line in lines) else ()
    draw = partial(plot_direct, shown) if shown else None
    return Outcome(lines=lines, notes=measured.notes + notes, draw=draw)


def law_of(robot: Robot, i: int) -> Law:
    """Friction law in force at joint i, with the standard errors of its identification, if any."""
    t, found = build_transmission(robot.configuration), robot.identified
    identified = found and found.joints.get(t.joints[i])
    errors = identified.friction.errors if identified and identified.friction else {}
    return Law(t, i, (errors.get("K_theta_s", 0.0), errors.get("K_theta_v", 0.0)))


def disagreement(law: Law, found: Sequence[Point], level: float, per_speed: float) -> str:
    """Sentence about points off the law, and the share of the contact level [Nm], which grows by
    per_speed [Nm s/rad], that the worst one takes. Empty if chance explains them: no more than
    expected outside 95 % intervals, and none by more than another interval."""
    worst = max(found, key=lambda point: law.misses(point)[1])
    (more, beyond), (friction, half) = law.misses(worst), law.at(worst.load, worst.speed)
    off = [point for point in found if law.misses(point)[1]]
    by_chance = beyond <= worst.scatter + half and len(off) <= binom.ppf(0.95, len(found), 0.05)
    if not off or by_chance:
        return ""
    share = abs(more) / (level + per_speed * worst.speed)
    takes = "false contacts" if share >= 1.0 else "in one direction a hand must press harder"
    return (
        f"{len(off)} of {len(found)} points are off, most at {abs(worst.load):.2f} Nm and "
        f"{worst.speed:.2g} rad/s: {worst.friction:.3g} +- {worst.scatter:.2g} Nm measured, "
        f"{friction:.3g} +- {half:.2g} by the law, {beyond:.2g} Nm beyond both. There the residual "
        f"is wrong by {abs(more):.2g} Nm, {share:.0%} of the contact level: {takes}"
    )


def _figures(found: Sequence[Point]) -> str:
    rows = np.array([(abs(p.load), p.speed, p.friction, p.scatter) for p in found])
    loads, speeds, friction, scatter = rows.T
    text = (f"{len(found)} points, {friction.min():.3g} to {friction.max():.3g} Nm, "
            f"+- {np.median(scatter):.2g}, at loads of {loads.min():.2f} to {loads.max():.2f} "
            "Nm")  # fmt: skip
    if np.ptp(loads) < _VARIES * abs(friction.mean()) or not scatter.all():
        return text
    columns = np.stack([np.ones_like(loads), speeds, loads], axis=1) / scatter[:, None]
    share = np.linalg.lstsq(columns, friction / scatter, rcond=None)[0][2]
    return f"{text}, {share:.2g} per Nm of it"
