"""Likely mistakes in a drive profile: its objects and scales against CiA 402 and the EDS. They are
warnings, not errors: see `mistakes`."""

import math
import re
from collections.abc import Iterator

from daemon.config.problem import Keys, Problem, agree, figure
from daemon.config.schema import Configuration
from drivers.canopen.boot.data_sheet import (
    DataSheet,
    Variable,
    counts_per_motor_turn,
    find_object,
    value_range,
)
from drivers.canopen.codec import quantity, type_limits
from drivers.canopen.settings import CanopenProfile, Quantity

TURN = 2.0 * math.pi
DEGREE = TURN / 360.0

AGREES = 1.3  # largest ratio of two figures for the same quantity
FINE = 1e-4  # [rad] per count: coarsest scale in decimal fractions of a radian
COARSEST = 0.5  # [rad/s] of the motor shaft per count, at most
_ROUNDED = 5e-5  # relative error of a scale that is written with five digits
_MOST_TWOS = 30

STANDARD = range(0x6000, 0x6800)
"""Objects of CiA 402 for the first axis; all others are manufacturer-specific."""
TARGET_VELOCITY = 0x60FF
CYCLIC_VELOCITY = 1 << 8  # of 0x6502, supported drive modes
NOT_MEASURED = {
    0x6040: "the controlword", 0x6062: "the position demand",
    0x606B: "the velocity demand", 0x6074: "the torque demand",
    0x607A: "the target position", 0x60F4: "the following error", 0x60FA: "the control effort",
    0x60FF: "the target velocity", 0x6071: "the target torque", 0x60FD: "digital inputs",
    0x6079: "the voltage of the DC link",
    0x6072: "the largest torque", 0x6073: "the largest current", 0x6075: "the rated current",
    0x6076: "the rated torque", 0x607F: "the largest velocity", 0x6080: "the largest speed",
}  # fmt: skip
"""Objects of CiA 402 that are none of the measurements that contactd needs."""
MEASURES = {
    0x6063: "position", 0x6064: "position", 0x60E4: "position", 0x6069: "velocity",
    0x606C: "velocity", 0x6077: "effort", 0x6078: "effort",
}  # fmt: skip
WANTED = {"position": "a position", "velocity": "a velocity", "effort": "a current or torque"}
KIND_OF = {
    "link_position": "position", "motor_position": "position", "motor_velocity": "velocity",
    "current": "effort", "torque": "effort",
}  # fmt: skip

_SETPOINTS = "demand demanded target command commanded set setpoint reference"
_LIMITS = "limit limits max maximum maximal min minimum minimal rated nominal threshold"
NO_MEASUREMENT = frozenset(f"{_SETPOINTS} {_LIMITS}".split())
"""Words in the names of objects that are a setpoint, a limit or a rated value."""
AVERAGED = frozenset(("averaged", "average", "filtered", "smoothed", "mean"))


def words_of(name: str) -> frozenset[str]:
    """Words of an object's name, in lower case."""
    found = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+", name)
    return frozenset(word.lower() for word in found)


def drive_mistakes(c: Configuration, name: str, sheet: DataSheet) -> Iterator[Problem]:
    """Likely mistakes in one profile of CANopen drives."""
    profile = c.drives[name]
    assert isinstance(profile, CanopenProfile)
    joints = [joint for joint in c.joints if joint.wiring.profile == name]
    gears = sorted({joint.wiring.gear for joint in joints})
    by_object: dict[tuple[int, int], str] = {}
    for entry, kind in KIND_OF.items():
        where: Quantity | None = getattr(profile, entry)
        if where is None:
            continue
        place = _of_drive(name, entry, "object")
        object_name = f"0x{where.object:04X}:{where.subindex:02X}"
        variable = find_object(sheet, where.object, where.subindex)
        if where.object in NOT_MEASURED:
            what = f"is {NOT_MEASURED[where.object]} by CiA 402, not a measurement"
            yield Problem(*place, f"{object_name} {what}; {WANTED[kind]} is required")
        elif MEASURES.get(where.object, kind) != kind:
            what = f"is a {MEASURES[where.object]} by CiA 402"
            yield Problem(*place, f"{object_name} {what}; {WANTED[kind]} is required")
        if variable is not None and (why := _not_measured(sheet, variable, kind)):
            called = "".join(c for c in variable.name if c.isprintable())
            yield Problem(*place, f"{object_name} ({called}) {why}")
        other = by_object.setdefault((where.object, where.subindex), entry)
        if other != entry:
            yield Problem(
                *place,
                f"{object_name} is also used for {other}: one of them must be another object "
                "(which encoder is it? turn the motor by hand and read both)",
            )
    target = profile.target_velocity.object
    if target in STANDARD and target != TARGET_VELOCITY:
        yield Problem(
            *_of_drive(name, "target_velocity", "object"),
            f"0x{target:04X} is not the target velocity of CiA 402, 0x{TARGET_VELOCITY:04X}",
        )
    modes = find_object(sheet, 0x6502)
    if modes is not None and modes.default and not modes.default & CYCLIC_VELOCITY:
        yield Problem(
            ["drives", name, "eds"],
            f"drives.{name}.eds",
            f"{profile.eds} has 0x{modes.default:08X} in 0x6502, without bit 8 (mode 9, cyclic "
            "synchronous velocity): contactd refuses a drive that reports this; a newer firmware "
            "may have the mode",
        )
    travel = max((j.limits.upper - j.limits.lower for j in joints), default=0.0)
    yield from _positions(name, profile, sheet, gears, travel)
    yield from _velocities(name, profile)


def _not_measured(sheet: DataSheet, variable: Variable, kind: str) -> str:
    """Reason why an object is not a measurement, or not the best one; empty if there is none."""
    if variable.writable:
        return (f"can be written (access {variable.access_type}): a parameter, not a measurement, "
                "unless the manual says otherwise")  # fmt: skip
    words = words_of(variable.name)
    if variable.index not in STANDARD and (other := words & NO_MEASUREMENT):
        return f"is no measurement by its name (`{min(other)}`); {WANTED[kind]} is required"
    low, high = value_range(variable)
    if kind != "position" and 0 <= low < high:
        return f"cannot be negative ({low} to {high}); {WANTED[kind]} must be signed"
    for one in getattr(sheet[variable.index], "subindices", {}).values():
        if words & AVERAGED and words_of(one.name) == words - AVERAGED and not one.writable:
            actual = f"0x{one.index:04X}:{one.subindex:02X} ({one.name})"
            return f"is delayed, as it is averaged; {actual} is not"
    return ""


def _positions(
    name: str, profile: CanopenProfile, sheet: DataSheet, gears: list[float], travel: float
) -> Iterator[Problem]:
    """Likely mistakes in encoder scales. travel: widest range of the joint limits [rad]."""
    for entry in ("link_position", "motor_position"):
        where: Quantity | None = getattr(profile, entry)
        if where is None:
            continue
        place, counts = _of_drive(name, entry, "scale"), TURN / where.scale
        per_turn = f"{figure(where.scale)} rad is {figure(counts)} counts per turn"
        if meant := None if is_encoder(where.scale) else _suggestion(where.scale, gears):
            yield Problem(*place, f"{per_turn}, which no encoder has; {meant}")
        elif counts < 100.0:
            yield Problem(*place, f"{per_turn}: scale is rad per count, 2 pi / counts per turn")
        in_eds = counts_per_motor_turn(sheet)
        if entry == "motor_position" and in_eds and not agree(counts, in_eds, AGREES):
            yield Problem(
                *place,
                f"{per_turn}, and the EDS has {in_eds:g} per motor turn (0x608F): scale would be "
                f"{figure(TURN / in_eds)}",
            )
    where = profile.link_position
    variable = find_object(sheet, where.object, where.subindex)
    if variable is None or value_range(variable) == type_limits(where.type):
        return
    low, high = value_range(variable)
    turn, span = TURN / max(high - low + 1, 1), where.scale * (high - low + 1)
    if low < high and (span < travel or (2.0 <= span / TURN <= 64.0 and is_encoder(turn))):
        yield Problem(
            *_of_drive(name, "link_position", "scale"),
            f"{figure(where.scale)} rad makes {figure(span)} rad of the range {low} to {high} in "
            f"the EDS, and limits span {figure(travel)}: if the range is one turn, scale would be "
            f"{figure(turn)}",
        )


def _suggestion(scale: float, gears: list[float]) -> str:
    """Suggested unit, or side of the gear, in which a scale fits an encoder; may be empty."""
    readings = [
        ("in degrees: times pi / 180 it is", scale * DEGREE),
        ("in turns: times 2 pi it is", scale * TURN),
        *((f"of the other side of the gear of {g:g}: times {g:g} it is", scale * g) for g in gears),
        *((f"of the other side of the gear of {g:g}: over {g:g} it is", scale / g) for g in gears),
    ]
    for words, other in readings:
        if is_encoder(other) and TURN / other >= 100.0:
            return f"is it {words} {figure(TURN / other)} counts per turn ({other:.6g})?"
    return ""


def is_encoder(scale: float) -> bool:
    """True if a scale fits an encoder: 2 pi / N where N has only the prime factors 2, 3 and 5, or a
    decimal fraction of a radian. Rounding to five digits is tolerated."""
    counts = TURN / scale
    return (scale <= FINE and _is_power(10.0, 1.0 / scale)) or any(
        _is_power(2.0, counts / (3**threes * 5**fives)) for threes in range(3) for fives in range(9)
    )


def _is_power(base: float, x: float) -> bool:
    """True if x is base^0, base^1, ..., within rounding to five digits."""
    power = round(math.log(x, base)) if x > 0.5 else -1
    return 0 <= power <= _MOST_TWOS and abs(x / base**power - 1.0) <= _ROUNDED


def _velocities(name: str, profile: CanopenProfile) -> Iterator[Problem]:
    """Likely mistakes in the scales of effort and of velocities, which CiA 402 gives one unit."""
    measured, target = profile.motor_velocity, profile.target_velocity
    if (
        measured.object == 0x606C
        and target.object == 0x60FF
        and not agree(measured.scale, target.scale, 1.0 + _ROUNDED)
    ):
        yield Problem(
            *_of_drive(name, "motor_velocity", "scale"),
            f"{figure(measured.scale)} rad/s per count, and target_velocity has "
            f"{figure(target.scale)}: by CiA 402 0x606C and 0x60FF share their unit",
        )
    for entry in ("motor_velocity", "target_velocity"):
        scale = quantity(profile, entry).scale
        if scale > COARSEST:
            yield Problem(
                *_of_drive(name, entry, "scale"),
                f"{figure(scale)} rad/s of the motor shaft per count is coarser than any drive "
                "counts; 1 rpm is 0.1047, 0.1 rpm 0.01047, 1 degree/s 0.01745",
            )
    effort = quantity(profile, profile.effort)
    if not 1e-5 <= effort.scale <= 0.02:
        yield Problem(
            *_of_drive(name, profile.effort, "scale"),
            f"{figure(effort.scale)} of the rated value per count: usual are per mille (0.001) and "
            "per cent (0.01); A or Nm per count must be divided by the rated value",
        )


def _of_drive(name: str, *path: str) -> tuple[Keys, str]:
    return ["drives", name, *path], ".".join(["drives", name, *path])
