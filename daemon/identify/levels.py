"""Step of the identification that finds the levels: from residuals to entries and to text."""

from dataclasses import replace

import numpy as np

from arrays import Vector
from daemon.assembly import build_transmission
from daemon.config import identified as file
from daemon.config.load import Robot
from daemon.config.motion import row
from daemon.config.schema import Configuration, Levels
from daemon.identify.measured import Measured
from daemon.identify.steps import Line, Outcome
from daemon.identify.swinging import told
from daemon.tick.arming_checks import RAISED
from errors import LogError
from estimator.identification.limit_cycle import LimitCycle, limit_cycles
from estimator.identification.thresholds import (
    LevelSettings,
    LevelsResult,
    LevelVerdict,
    Motion,
    identify_levels,
)

# Of what `arm` allows: levels are rounded, and compared.
NEARLY = 0.99


def thresholds_step(
    robot: Robot, measured: Measured, per_hour: float, date: str, *, it_was_me: bool = False
) -> Outcome:
    """Identify two levels per joint from contact-free motion; it_was_me: a person answers for
    every stretch that looks like a touch. Raises LogError without residuals."""
    c = robot.configuration
    hidden = _hidden_at_rest(c)
    settings = replace(_level_settings(c, per_hour, hidden), it_was_me=it_was_me)
    log = measured.log
    levels = _standing(
        identify_levels(log.joints, log.period_s, _motion(measured), settings),
        limit_cycles(log, measured.reference, row(c, lambda j: j.half_gap)),
        measured.gain or c.control.position_gain,
    )
    lines, entries, notes = [], dict[str, file.Entry](), list(measured.notes)
    notes += [f"{one.joint}: discarded {'; '.join(str(d) for d in one.discarded)}"
              for one in levels if one.discarded]  # fmt: skip
    if any(one.discarded for one in levels):
        notes.append("if nobody touched the arm then, contacts were false and the levels are too "
                     "low")  # fmt: skip
    least = _least_at_rest(c, hidden)
    for one, rests, level in zip(levels, hidden, least, strict=True):
        if one.floored and one.contact == level:
            notes.append(
                f"{one.joint}: its friction hides {rests:.2g} Nm at rest, and `arm` is refused "
                f"beyond {RAISED:g} times the contact level; less was seen"
            )
        good = one.verdict is LevelVerdict.GOOD
        lines.append(Line(one.joint, one.verdict.value, good, _level_figures(one), one.reason))
        if good:
            entries[one.joint] = _level_entry(one, measured, per_hour, date)
    return Outcome(lines, entries, tuple(notes))


def _standing(
    levels: list[LevelsResult], cycles: list[LimitCycle], gain: float
) -> list[LevelsResult]:
    """Levels, without those of joints that swung: they would be those of an arm that swings."""
    why = {cycle.joint: told([cycle], gain) for cycle in cycles if cycle.spoils}
    return [
        replace(one, verdict=LevelVerdict.SWINGS, reason=why[one.joint])
        if one.joint in why and one.verdict is not LevelVerdict.STILL
        else one
        for one in levels
    ]


def _motion(measured: Measured) -> Motion:
    r, raised, touched, unsure = (
        measured.residual, measured.raised, measured.touched, measured.unsure
    )  # fmt: skip
    if r is None or raised is None or touched is None or unsure is None:
        raise LogError("thresholds need residuals: a recording of `contactctl record`, not a CSV")
    if measured.outdated:
        raise LogError(f"{measured.outdated}: `contactctl reload`, and record anew")
    log = measured.log
    return Motion(time_s=log.time_s, position=log.link_position, velocity=log.motor_velocity,
                  residual=r, raised=raised, touched=touched, unsure=unsure)  # fmt: skip


def _level_figures(one: LevelsResult) -> str:
    if not np.isfinite(one.contact):
        return ""
    grows = f" + {one.per_speed:.2g} per rad/s" if one.per_speed else ""
    left_out = ""
    if one.discarded:
        worst = max(d.largest for d in one.discarded)
        left_out = f", discarded {len(one.discarded)} x, up to {worst:.2g} Nm"
    return (f"contact {one.contact:.3g} Nm{grows}, collision {one.collision:.3g} Nm, "
            f"largest |r| {one.largest:.3g} Nm in {one.used_s:.0f} s at up to "
            f"{one.seen.speed:.2g} rad/s{left_out}")  # fmt: skip


def _level_entry(
    one: LevelsResult, measured: Measured, per_hour: float, date: str
) -> file.ThresholdsEntry:
    return file.ThresholdsEntry(
        date=date,
        log=measured.sha256,
        thresholds=Levels(
            contact=float(f"{one.contact:.4g}"),
            collision=float(f"{one.collision:.4g}"),
            per_speed=float(f"{one.per_speed:.4g}"),
        ),
        per_hour=per_hour,
        largest=float(f"{one.largest:.4g}"),
        seen=file.SeenEntry(
            speed=round(one.seen.speed, 4),
            lower=round(one.seen.lower, 4),
            upper=round(one.seen.upper, 4),
            load=measured.load,
        ),
        discarded=tuple(
            file.DiscardedEntry(
                at_s=round(d.at_s, 2),
                lasted_s=round(d.lasted_s, 2),
                largest=float(f"{d.largest:.3g}"),
            )
            for d in one.discarded
        ),
    )


def _hidden_at_rest(c: Configuration) -> Vector:
    """Torque (n,) [Nm] that the friction of a joint at rest hides, at most."""
    t = build_transmission(c)
    hidden: Vector = (c.estimator.stiction_share + t.most_stiction) * t.engaged_coulomb
    return hidden


def _least_at_rest(c: Configuration, hidden: Vector) -> Vector:
    """Contact levels (n,) [Nm] that are in force at rest at nearly `RAISED` times their value: with
    what is hidden, and the side of a gap not known."""
    unsure = c.estimator.unknown_side_share * (row(c, lambda j: j.half_gap) > 0.0)
    least: Vector = hidden / (NEARLY * RAISED - 1.0 - unsure)
    return least


def _level_settings(c: Configuration, per_hour: float, hidden: Vector) -> LevelSettings:
    """Floor and ceiling of the levels. Two counts of the current's noise cannot be a touch, and
    what is `hidden` (n,) [Nm] at rest raises a level no further than `arm` allows: the floor. The
    ceiling is a fifth of the drive's largest torque: a level above protects nobody."""
    strongest = np.array([j.torque_constant * j.wiring.max_current_A for j in c.joints])
    floor: Vector = np.maximum(0.01 * strongest, _least_at_rest(c, hidden))
    half_gap = row(c, lambda j: j.half_gap)
    return LevelSettings(per_hour, per_hour / 100.0, floor, 0.2 * strongest, half_gap)
