"""Scales of a drive's quantities, with reasons: from CiA 402, from the units in its EDS (0x608F,
0x60A8 to 0x60AA), or guessed from common practice."""

import math
from dataclasses import dataclass

from drivers.canopen.boot.data_sheet import DataSheet, counts_per_motor_turn, find_object
from programs.contactd.drafts.choice import NO_LINK_ENCODER, Candidate

TURN = 2.0 * math.pi
RPM = TURN / 60.0
GEAR = 100.0  # gear ratio of a typical joint
LINK_COUNTS, MOTOR_COUNTS = 131072, 4096

_ANGLES = {0x10: (1.0, "rad"), 0x41: (TURN / 360.0, "degrees"), 0xB4: (TURN, "turns")}
_TIMES = {0x03: (1.0, "s"), 0x47: (60.0, "min")}
_RPM_PER_S = (0xC0, 0x03)
"""Unit codes of CiA 303-2: numerator in bits 23 to 16, denominator in bits 15 to 8."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Scale, its reason, and whether it is certain rather than a guess."""

    value: float
    reason: str
    sure: bool = False


def scale_of(sheet: DataSheet, name: str, where: Candidate) -> Scale:
    """Scale of the object that holds a quantity."""
    if name in ("current", "torque"):
        return _of_effort(name, where)
    if name == "link_position":
        return _at_link(sheet, where)
    if name == "motor_position":
        return _at_motor(sheet, where)
    if where.where == (0x6080, 0):
        return Scale(RPM, "rpm, by CiA 402", sure=True)
    index, unit = (0x60AA, "rpm/s") if name == "quick_stop_deceleration" else (0x60A9, "rpm")
    stated = _si_unit(sheet, index)
    velocity = _si_unit(sheet, 0x60A9)
    if stated is None and velocity is not None:
        return Scale(velocity.value, f"the unit of velocity per s is a guess: {velocity.reason}")
    guess = f"0.1 {unit} is a guess: 1 {unit} is {RPM!r}, see docs/porting.md"
    return stated or Scale(0.1 * RPM, guess)


def _of_effort(name: str, where: Candidate) -> Scale:
    if where.index in (0x6077, 0x6078):
        return Scale(0.001, "per mille of the rated value, by CiA 402", sure=True)
    why = "per mille of the rated value is a guess, as the maker's own object is"
    if name == "current":
        wide = ", which 32 bits suggest," if where.type.endswith("32") else ""
        why += f"; mA{wide} are 0.001 / rated_current_A"
    return Scale(0.001, why)


def _at_motor(sheet: DataSheet, where: Candidate) -> Scale:
    stated = _si_unit(sheet, 0x60A8) if where.index == 0x6064 else None
    if stated is not None:
        return stated
    if counts := counts_per_motor_turn(sheet):
        return Scale(TURN / counts, f"2 pi / {counts:g} counts per turn, by 0x608F", sure=True)
    why = f"2 pi / counts per turn of the motor's encoder: {MOTOR_COUNTS} is a guess"
    return Scale(TURN / MOTOR_COUNTS, why)


def _at_link(sheet: DataSheet, where: Candidate) -> Scale:
    if where.doubt != NO_LINK_ENCODER:
        why = f"2 pi / counts per turn of the link's encoder: {LINK_COUNTS} is a guess"
        return Scale(TURN / LINK_COUNTS, why)
    motor = _at_motor(sheet, where)
    return Scale(
        motor.value / GEAR,
        f"over the gear, {GEAR:g} (each gear is a profile of its own): {motor.reason}",
    )


def _si_unit(sheet: DataSheet, index: int) -> Scale | None:
    """Unit that an EDS states, in rad, rad/s or rad/s2; None if it states none, or counts."""
    variable = find_object(sheet, index)
    code = None if variable is None else variable.default
    if not isinstance(code, int) or variable is None or code <= 0:
        return None
    prefix, above, below = code >> 24 & 0xFF, code >> 16 & 0xFF, code >> 8 & 0xFF
    tens = prefix - 256 if prefix > 127 else prefix
    if index == 0x60A8 and above in _ANGLES and not below:
        size, unit = _ANGLES[above]
    elif index == 0x60A9 and above in _ANGLES and below in _TIMES:
        size = _ANGLES[above][0] / _TIMES[below][0]
        unit = f"{_ANGLES[above][1]} per {_TIMES[below][1]}"
    elif index == 0x60AA and (above, below) == _RPM_PER_S:
        size, unit = RPM, "rpm/s"
    else:
        return None
    words = f"{10.0**tens:g} {unit} by 0x{index:04X} (0x{code:08X})"
    if variable.writable:
        return Scale(size * 10.0**tens, f"{words} as delivered, which can be changed")
    return Scale(size * 10.0**tens, words, sure=True)
