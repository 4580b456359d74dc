"""Columns of a log of unknown layout, guessed by name and content, for `log_names`. Pure functions.

The words of a column's name give quantity, side (motor or link) and joint. The data give units,
signs and gear ratios: positions lie within the URDF's limits, velocities match the positions'
change, the motor position follows the link position.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.integrate import cumulative_trapezoid

from common.arrays import Vector
from common.yaml_source import quoted
from daemon.config.problem import figure
from estimator.urdf import JointRange
from programs.identify.guesses import MARK
from programs.identify.log_names import UNITS


def _any(words: str) -> frozenset[str]:
    return frozenset(words.split())


_WORDS: Final[Mapping[str, frozenset[str]]] = {
    "velocity": _any("velocity velocities vel speed qd dq qdot omega"),
    "current": _any("current currents cur curr amp amps i iq"),
    "torque": _any("torque torques tau tq eff effort efforts moment"),
    "position": _any("position positions pos q angle theta encoder enc"),
}
_ASKED: Final = _any("target desired des cmd command commanded ref reference goal setpoint")
_NEVER: Final = _any("error err std acc accel acceleration qdd temp temperature voltage limit ext "
                     "external gravity")  # fmt: skip
_MOTOR: Final = _any("motor rotor")
_TIMES: Final = _any("time t timestamp stamp sec secs seconds clock date datetime")
_STEPS_S: Final = (3e-4, 0.3)  # plausible sampling periods
_PAUSE: Final = 10.0  # a step of so many medians is a pause
_OUTSIDE: Final = 0.05  # tolerated excess over the limits [rad]
_SAME: Final = 0.08  # relative deviation from a unit's factor: a gear of 50 is not deg/rad (57.3)
_AS_IT_IS: Final = 0.3  # the same, from a factor of 1: noise, oscillation; no gear is so small
_MOST_A: Final = 80.0  # largest current of an arm's motor; larger numbers are mA
_WHOLE: Final = 0.015  # relative deviation at which a gear ratio is rounded to an integer
_FOLLOWS: Final = 0.7  # least correlation of columns that measure the same motion
_WAY_S: Final = 0.04  # window over which an integrated velocity is compared with a position
_STRANGE: Final = "it does not follow the link's position: CHECK what it is"


@dataclass(frozen=True, slots=True)
class Column:
    """Column of one quantity of a joint; `doubt`: what the user has to check."""

    column: str
    unit: str
    scale: float = 1.0
    doubt: str = ""
    offset: float = 0.0

    def line(self) -> str:
        """Entry of the names file."""
        if not self.column:
            return f"{{value: 0}}   {MARK}: {self.doubt}"
        scale = "" if self.scale == 1.0 else f", scale: {figure(self.scale)}"
        scale += "" if self.offset == 0.0 else f", offset: {figure(self.offset)}"
        about = f": {self.doubt}" if self.doubt else ""
        return f"{{column: {quoted(self.column)}, unit: {self.unit}{scale}}}   {MARK}{about}"


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of a log: time, quantities by joint, and for an MCAP its topic."""

    time: Column
    joints: Mapping[str, Mapping[str, Column]]
    topic: str = ""

    def scaled(self, factors: Mapping[str, tuple[float, str]]) -> "Columns":
        """Copy with new scales (factor, reason) of the joints' torques or currents."""
        joints = {joint: dict(each) for joint, each in self.joints.items()}
        for joint, (factor, why) in factors.items():
            (name,) = {"torque", "current"} & joints[joint].keys()
            if joints[joint][name].column:
                joints[joint][name] = replace(joints[joint][name], scale=factor, doubt=why)
        return replace(self, joints=joints)

    def text(self) -> str:
        """Text of the names file."""
        lines = [f"# Columns guessed by `contactd new`. Lines with {MARK[2:]} are to be looked at.",
                 *([f"topic: {quoted(self.topic)}"] if self.topic else []),
                 f"time: {self.time.line()}", "joints:"]  # fmt: skip
        for joint, quantities in self.joints.items():
            lines.append(f"  {quoted(joint)}:")
            lines += [f"    {name}: {one.line()}" for name, one in quantities.items()]
        return "\n".join(lines) + "\n"


def named_columns(header: Sequence[str], joints: Sequence[str]) -> dict[tuple[str, str], str]:
    """Column name by (joint, quantity), and by ("", "time"), from names alone."""
    found: dict[tuple[str, str], str] = {}
    numbered: dict[str, list[tuple[int, str]]] = {}
    for name in header:
        joint, words = _joint_in(name, joints)
        if not joint and set(words) <= _TIMES | {"s", "ms", "us", "ns"} and set(words) & _TIMES:
            found.setdefault(("", "time"), name)
        quantity = _quantity(words)
        if not quantity:
            continue
        numbers = [int(word) for word in words if word.isdecimal()]
        if joint or len(joints) == 1:
            found.setdefault((joint or joints[0], quantity), name)
        elif numbers:
            numbered.setdefault(quantity, []).append((numbers[-1], name))
    base = 0 if any(k == 0 for each in numbered.values() for k, _ in each) else 1
    for quantity, each in numbered.items():
        for k, name in each:
            if 0 <= k - base < len(joints):
                found.setdefault((joints[k - base], quantity), name)
    return found


def _words(name: str) -> list[str]:
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return re.findall(r"[a-z]+|\d+", apart.lower())


def _joint_in(name: str, joints: Sequence[str]) -> tuple[str, list[str]]:
    """Longest joint name contained in a column name, and the remaining words."""
    words = _words(name)
    for joint in sorted(joints, key=lambda one: -len(_words(one))):
        its = _words(joint)
        its = its[:-1] if its[-1:] == ["joint"] and len(its) > 1 else its
        for k in range(len(words) - len(its) + 1):
            if words[k : k + len(its)] == its:
                return joint, words[:k] + words[k + len(its) :]
    return "", words


def _quantity(words: Sequence[str]) -> str:
    """Quantity of `log_names` that the words of a name denote; empty for none."""
    there = set(words)
    if there & _NEVER:
        return ""
    kind = next((kind for kind, known in _WORDS.items() if there & known), "")
    if there & _ASKED:
        return "setpoint" if kind == "velocity" else ""
    if kind == "position":
        return "motor_position" if there & _MOTOR else "link_position"
    return "motor_velocity" if kind == "velocity" else kind


def guessed(
    named: Mapping[tuple[str, str], str], table: Mapping[str, Vector], ranges: Sequence[JointRange]
) -> Columns:
    """Units, signs and gear ratios of named columns from their data (N,). Joints without a position
    are left out; all joints are if none has a torque or current."""
    column = named["", "time"]
    time = _time(column, table[column])
    its: dict[str, dict[str, str]] = {}
    for one in ranges:
        each = {quantity: name for (joint, quantity), name in named.items() if joint == one.joint}
        if "link_position" not in each and "motor_position" in each:
            each["link_position"] = each.pop("motor_position")
        if "link_position" in each:
            its[one.joint] = each
    if not any({"torque", "current"} & each.keys() for each in its.values()):
        its = {}
    there = [one for one in ranges if one.joint in its]
    angle = _angle([(table[its[one.joint]["link_position"]], one) for one in there])
    most = max((float(np.abs(table[each["current"]]).max())
                for each in its.values() if "current" in each), default=0.0)  # fmt: skip
    period = _step(table[column]) * UNITS["time"][time.unit]
    return Columns(time, _alike({
        one.joint: _of_joint(its[one.joint], table, one, angle, period)
        | _effort(its[one.joint], milli=most > _MOST_A)
        for one in there
    }))  # fmt: skip


def _alike(joints: Mapping[str, dict[str, Column]]) -> Mapping[str, dict[str, Column]]:
    """Joints in which velocities that match no position get the unit of most others, since one
    program wrote all columns."""
    for quantity in ("motor_velocity", "setpoint"):
        named = [each[quantity] for each in joints.values() if quantity in each]
        units = [one.unit for one in named if one.doubt != _STRANGE]
        for each in joints.values():
            if units and quantity in each and each[quantity].doubt == _STRANGE:
                each[quantity] = replace(each[quantity], unit=max(units, key=units.count))
    return joints


def _time(column: str, values: Vector) -> Column:
    step = _step(values)
    for unit, factor in UNITS["time"].items():
        if _STEPS_S[0] < step * factor < _STEPS_S[1]:
            return Column(column, unit, doubt=f"a sample every {1e3 * step * factor:.3g} ms")
    return Column(column, "s", doubt=f"a sample every {step:.3g} of its unit")


def _step(times: Vector) -> float:
    """Mean sampling period without pauses; rounded time stamps may repeat."""
    steps = np.diff(times)
    ahead = steps[steps > 0.0]
    if not len(ahead):
        return 1.0
    return float(steps[(steps >= 0.0) & (steps < _PAUSE * np.median(ahead))].mean())


def _angle(positions: Sequence[tuple[Vector, JointRange]]) -> str:
    """First unit in which the positions of all joints lie within the limits; empty for none."""
    for unit, factor in UNITS["link_position"].items():
        if unit != "mrad" and all(_within(factor * values, one) for values, one in positions):
            return unit
    return ""


def _within(values: Vector, one: JointRange) -> bool:
    low, high = np.percentile(values, [0.5, 99.5])
    return bool(one.lower - _OUTSIDE <= low <= high <= one.upper + _OUTSIDE)


def _of_joint(
    its: Mapping[str, str], table: Mapping[str, Vector], one: JointRange, angle: str, period: float
) -> dict[str, Column]:
    """Position and velocity columns of a joint; velocities should match the motor position if there
    is one, else the link position."""
    name, limits = its["link_position"], f"the URDF's {one.lower:.3g} to {one.upper:.3g} rad"
    doubt = f"within {limits}" if angle else f"no unit is within {limits}: a scale, an offset?"
    found = {"link_position": Column(name, angle or "rad", doubt=doubt)}
    q = table[name] * UNITS["link_position"][angle or "rad"]
    turns, span = q, max(2, round(_WAY_S / period))

    def changes(positions: Vector) -> Vector:
        return positions[span:] - positions[:-span]

    if "motor_position" in its:
        values = table[its["motor_position"]]
        follows = _following(its["motor_position"], values, q, UNITS["link_position"], angle)
        scale = UNITS["link_position"][follows.unit] * follows.scale
        offset = round(float(np.mean(q - scale * values)), 6)
        found["motor_position"] = replace(follows, offset=offset)
        turns = scale * values if follows.doubt != _STRANGE else q
    for quantity in {"motor_velocity", "setpoint"} & its.keys():
        units = UNITS["motor_velocity"]
        swept = cumulative_trapezoid(table[its[quantity]], dx=period, initial=0.0)
        found[quantity] = _following(its[quantity], changes(swept), changes(turns), units)
    return found


def _effort(its: Mapping[str, str], *, milli: bool) -> dict[str, Column]:
    if not {"torque", "current"} & its.keys():
        return {"torque": Column("", "Nm", doubt="none in the log: others need its motion alone")}
    if "torque" in its:
        return {"torque": Column(its["torque"], "Nm")}
    return {"current": Column(its["current"], "mA" if milli else "A")}


def _following(
    name: str, values: Vector, about: Vector, units: Mapping[str, float], unit: str = ""
) -> Column:
    """Column whose values measure the same as `about` [SI], up to unit, sign or gear ratio; `unit`:
    that of a geared column, by default the first of `units`."""
    first = Column(name, unit or next(iter(units)))
    apart = values - values.mean()
    power = float(apart @ apart)
    scale = float(apart @ (about - about.mean())) / power if power else 0.0
    if abs(scale) * float(values.std()) < _FOLLOWS * float(about.std()) or not scale:
        return replace(first, doubt=_STRANGE)
    nearest = min(units, key=lambda one: abs(np.log(abs(scale) / units[one])))
    same = _SAME if units[nearest] != 1.0 and nearest != unit else _AS_IT_IS
    if abs(abs(scale) / units[nearest] - 1.0) < same:
        way = "as" if scale > 0.0 else "against"
        return Column(name, nearest, float(np.sign(scale)), f"changes {way} the link's")
    gear = units[first.unit] / scale
    whole = float(round(gear))
    gear = whole if whole and abs(gear / whole - 1.0) < _WHOLE else gear
    return replace(first, scale=1.0 / gear, doubt=f"a gear of {abs(gear):.4g}?")
