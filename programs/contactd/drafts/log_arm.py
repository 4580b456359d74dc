"""Draft of a configuration for logs alone, without drives; torque scales from the URDF's masses.

A current or torque column is modelled as x = s tau + c sign(v) + d v + B a + b, with tau the torque
of the rigid-body model of the URDF: 1 / s is the torque constant, or the correction of a torque's
scale and sign. Pure functions.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from common.arrays import Matrix
from common.yaml_source import quoted
from daemon.config.problem import figure
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.urdf import JointRange
from identification.log_intervals import Intervals, intervals, low_pass
from identification.motion_log import MotionLog
from identification.torque_columns import torque_parts
from programs.identify.guesses import MARK

_ROWS: Final = 20_000  # samples of a log that the scales are estimated from
TURNS: Final = 12.57  # limits, in both directions, of a joint without limits [rad]
_GRAVITY: Final = 0.01  # least std of the gravity torque: rotor inertia masks the links' [Nm]
_SURE: Final = 0.1  # largest relative error of an accepted torque constant
_SHOWN: Final = 0.05  # least share of the links' torque in the signal's std
_GAIN: Final = 8.0  # of the low-pass filter on both sides of the regression [1/s]
_HEADROOM: Final = 1.5  # velocity limit over the fastest motion in the log
_STRONGEST: Final = 4.0  # current limit over the largest current in the log: others may carry more
_FASTEST: Final = (0.05, 20.0)  # bounds of limits.velocity [rad/s]
_PERIOD_MS: Final = (4, 100)
_SLOWLY_MS: Final = 60  # longest period with which the default gain's residual does not oscillate


def with_movable_joints(urdf: str, joints: Collection[str]) -> tuple[str, list[str]]:
    """URDF in which only these joints move, all with limits, and a description of each change."""
    root, changes = ET.fromstring(urdf), []
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if name not in joints and kind != "fixed":
            joint.set("type", "fixed")
            for child in ("limit", "mimic", "axis"):
                for found in joint.findall(child):
                    joint.remove(found)
            changes.append(f"{name}: not in the log, fixed at 0")
        elif name in joints and kind == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ET.SubElement(joint, "limit") if limit is None else limit
            given = {"effort": "1000", "velocity": "10"} | limit.attrib
            limit.attrib |= given | {"lower": f"{-TURNS}", "upper": f"{TURNS}"}
            changes.append(f"{name}: without limits, now two turns either way")
    return (ET.tostring(root, encoding="unicode") + "\n" if changes else urdf), changes


@dataclass(frozen=True, slots=True)
class Scale:
    """Torque per unit of a joint's column [Nm/A, or 1]; 0 if the log does not determine it."""

    constant: float
    error: float = 0.0
    against: bool = False
    """Friction came out negative: the column's sign is wrong."""

    def __str__(self) -> str:
        if not self.constant:
            return "the URDF's masses do not show it in the log"
        return "by the URDF's masses, and as far off as these"


def scales(log: MotionLog, model: Model) -> list[Scale]:
    """Torque per unit of each joint's column, from the URDF's masses. Raises LogError."""
    settings = EstimatorSettings(motor_position="integrated")
    rows = intervals(log.select(slice(0, _ROWS)), model, settings)
    return [_scale(rows, i) for i in range(log.n)]


def _scale(rows: Intervals, i: int) -> Scale:
    """Scale of joint i by least squares. Regressors and signal are low-pass filtered alike, as the
    accelerations' noise would attenuate the estimate of s."""
    signal, weighs = rows.current[:, [i]], rows.gravity[:, i].std() > _GRAVITY
    parts = np.hstack([torque_parts(rows, i)[:, :-1], signal])
    smooth: Matrix = low_pass(parts, rows, _GAIN)
    columns, signal = smooth[:, :-1] - smooth[:, :-1].mean(axis=0), smooth[:, -1]
    spread = columns.std(axis=0)
    if not ((spread > 0.0).all() and signal.any()):
        return Scale(0.0)
    columns /= spread
    found, *_ = np.linalg.lstsq(columns, signal - signal.mean(), rcond=None)
    rest = signal - signal.mean() - columns @ found
    # Neighbouring samples are correlated: about a hundred count as one, hence sqrt(100) = 10.
    error = np.sqrt(np.abs(np.diag(np.linalg.pinv(columns.T @ columns)))) * rest.std() * 10.0
    s = float(found[0])
    if not weighs or abs(s) < _SHOWN * signal.std() or error[0] > _SURE * abs(s):
        rubs = found[1] + found[2]
        return Scale(0.0, against=bool(rubs < -2.0 * (error[1] + error[2])))
    return Scale(float(spread[0]) / s, float(error[0]) / abs(s))


def log_draft(
    name: str, urdf_name: str, log: MotionLog, ranges: Sequence[JointRange],
    constants: Sequence[tuple[float, str]],
) -> str:  # fmt: skip
    """Text of config.yaml. constants: torque constant of each joint [Nm/A], and its source."""
    period_ms = int(np.clip(round(1e3 * log.period_s), *_PERIOD_MS))
    joints = "\n".join(
        _joint(i, one, log, *constant)
        for i, (one, constant) in enumerate(zip(ranges, constants, strict=True))
    )
    slow = f", gain: {figure(1.5e3 / period_ms)}" if period_ms > _SLOWLY_MS else ""
    measured = "integrated" if log.motor_position is None else "measured"
    return f"""\
# Draft by `contactd new --log-only`, for logs alone: no drive can be run with it. Lines with CHECK
# hold guesses; `contactd identify STEP --log` finds most of them (docs/logs.md).
version: 1
name: {quoted(name)}
urdf: {quoted(urdf_name)}
period_ms: {period_ms}
bus: {{interface: virtual, channel: none}}
drives: {{logs: {{make: log}}}}
joints:
{joints}
estimator: {{motor_position: {measured}, current_delay_ms: 0{slow}}}
"""


def _joint(i: int, one: JointRange, log: MotionLog, constant: float, why: str) -> str:
    largest = _STRONGEST * max(float(np.abs(log.current[:, i]).max()), 1e-3)
    torque = constant * largest * _HEADROOM / _STRONGEST
    fastest = float(np.abs(log.motor_velocity[:, i]).max())
    velocity = float(np.clip(_HEADROOM * fastest, *_FASTEST))
    q = log.link_position[:, i]
    lower, upper = max(one.lower, float(q.min()) - 0.5), min(one.upper, float(q.max()) + 0.5)
    gap = 0.0 if log.motor_position is None else 0.002
    f = figure
    return f"""\
  - name: {quoted(one.joint)}
    wiring: {{node: {i + 1}, profile: logs, gear: 1, rated_current_A: {f(largest)}, \
max_current_A: {f(largest)}}}   {MARK}: {_STRONGEST:g} x the largest in the log
    torque_constant: {f(constant)}{f"   {MARK}: {why}" if why else ""}
    rotor_inertia: 0
    half_gap: {gap:g}   {MARK}: {"`contactd identify gap`" if gap else "no second position"}
    friction: {{motor_coulomb: {f(0.03 * torque)}}}   {MARK}: `contactd identify friction`
    thresholds: {{contact: {f(0.15 * torque)}, collision: {f(0.45 * torque)}}}   \
{MARK}: `contactd identify thresholds`
    limits: {{lower: {f(lower)}, upper: {f(upper)}, velocity: {f(velocity)}, acceleration: 2, \
quick_stop: 6}}
    admittance_gain: 0
"""
