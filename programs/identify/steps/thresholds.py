"""Step `thresholds`: contact and collision levels of all joints, from their residuals."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from common.errors import ConfigurationError, LogError
from programs.command_line.options import Range
from programs.identify.step import Line, Outcome, now, step

if TYPE_CHECKING:
    from common.arrays import Vector
    from daemon.config.identified import ThresholdsEntry
    from daemon.config.load import Robot
    from daemon.config.schema import Configuration
    from identification.thresholds import LevelSettings, LevelsResult, Motion
    from programs.identify.identification import Identification
    from programs.identify.live_arm import LiveArm
    from programs.identify.measured import Measured

# Factor below the ratio that `arm` allows, as levels are rounded before they are compared.
_NEARLY = 0.99


def _quality(entry: "ThresholdsEntry") -> str:
    """Contact level, and the speed of the motion that it covers."""
    seen = f" up to {entry.seen.speed:.2g} rad/s" if entry.seen else ""
    left_out = f", {len(entry.discarded)} stretches left out" if entry.discarded else ""
    return f"{entry.thresholds.contact:.3g} Nm{seen}{left_out}"


@step(
    click.option("--seconds", default=120.0, show_default=True, type=Range(40, 7200)),
    click.option("--per-hour", default=1.0, show_default=True, type=Range(1e-3, 1000),
                 help="Acceptable false contacts per joint and hour."),
    click.option("--it-was-me", is_flag=True,
                 help="Confirm that you touched the arm in every stretch left out as a touch."),
    quality=_quality,
    order=8,
)  # fmt: skip
def thresholds(
    identification: "Identification", seconds: float, per_hour: float, it_was_me: bool
) -> bool:
    """Identify contact and collision levels: all joints move, without contact."""
    measured = identification.measured(lambda arm: _moved(arm, seconds), residuals=True)
    with identification.busy("finding levels"):
        outcome = thresholds_outcome(
            identification.robot, measured, per_hour, now(), it_was_me=it_was_me
        )
    return identification.conclude("thresholds", outcome)


def _moved(arm: "LiveArm", seconds: float) -> "Measured":
    """Move all joints along an excitation, and record the residuals."""
    from daemon.config.identified import same_residuals
    from programs.identify.live_arm import TO_READ_ANEW

    if not same_residuals(arm.session.configuration(), arm.configuration):
        raise ConfigurationError(
            "values of the joints were changed since the daemon read its files, so its residuals "
            f"use outdated ones: {TO_READ_ANEW}, then repeat this"
        )
    return arm.excite("thresholds", seconds, seed=2, residuals=True)


def thresholds_outcome(
    robot: "Robot", measured: "Measured", per_hour: float, date: str, *, it_was_me: bool = False
) -> Outcome:
    """Outcome with two levels per joint from contact-free motion; it_was_me: the user confirms all
    stretches that look like a touch. Raises LogError without residuals."""
    from daemon.arming.checks import RAISED
    from daemon.config.identified import Identified, IdentifiedJoint
    from daemon.config.vectors import row
    from identification.limit_cycle import limit_cycles
    from identification.thresholds import LevelVerdict, identify_levels
    from programs.identify.limit_cycle_watch import limit_cycle_sentences
    from programs.identify.stated_levels import misfits, unused

    c, log = robot.configuration, measured.log
    settings, hidden, least = _settings(c, per_hour, it_was_me=it_was_me)
    levels = identify_levels(log.joints, log.period_s, _motion(measured), settings)
    # Levels of a joint in a limit cycle would only fit an arm that oscillates.
    cycles = limit_cycles(log, measured.reference, row(c, lambda j: j.half_gap))
    gain = measured.gain or c.control.position_gain
    # Under another program's control the reference is unknown, and so is whether a link swings.
    swings = {} if measured.reference is None else limit_cycle_sentences(cycles, gain)
    levels = [
        replace(one, verdict=LevelVerdict.SWINGS, reason=swings[one.joint])
        if one.joint in swings and one.verdict is not LevelVerdict.STILL
        else one
        for one in levels
    ]
    notes = list(measured.notes)
    notes += [f"{one.joint}: discarded {'; '.join(str(d) for d in one.discarded)}"
              for one in levels if one.discarded]  # fmt: skip
    if any(one.discarded for one in levels):
        notes.append("if the arm was not touched then, these contacts were false and the levels "
                     "are too low")  # fmt: skip
    if measured.reference is None:  # no level was in force that would have detected a weak touch
        notes += [f"{one.joint}: |r| of {one.largest:.2g} Nm, {one.alone_s:.0f} s after the start "
                  "of the log, is over twice the rest: if the arm was touched then, the level is "
                  "too high: remove that part of the log"
                  for one in levels if math.isfinite(one.alone_s)]  # fmt: skip
    notes += [
        f"{one.joint}: level raised, as friction hides {rests:.2g} Nm at rest, and `arm` is "
        f"refused beyond {RAISED:g} times the contact level; residuals were smaller"
        for one, rests, level in zip(levels, hidden, least, strict=True)
        if one.floored and one.contact == level
    ]
    found = Identified(
        joints={
            one.joint: IdentifiedJoint(thresholds=_entry(one, measured, per_hour, date))
            for one in levels
            if one.verdict is LevelVerdict.GOOD
        }
    )
    refused = misfits((robot.by_hand or robot).configuration, found)
    entries = {name: joint for name, joint in found.joints.items() if name not in refused}
    notes += [f"{problem.where}: {problem.what}" for problem in unused(c, found)]
    return Outcome(
        lines=[
            Line(
                one.joint,
                "refused" if one.joint in refused else one.verdict.value,
                one.joint in entries,
                _figures(one),
                refused.get(one.joint, one.reason),
            )
            for one in levels
        ],
        entries={name: joint.thresholds for name, joint in entries.items() if joint.thresholds},
        notes=tuple(notes),
        # Recordings are kept until the user confirms the touches, or corrects `least`.
        unfinished=bool(refused) or any(one.verdict is LevelVerdict.UNLESS_YOU for one in levels),
    )


def _motion(measured: "Measured") -> "Motion":
    from identification.thresholds import Motion

    r, raised, touched, uncertain = (
        measured.residual, measured.raised, measured.touched, measured.uncertain
    )  # fmt: skip
    if r is None or raised is None or touched is None or uncertain is None:
        raise LogError("thresholds need residuals")
    if measured.outdated:
        raise LogError(f"{measured.outdated}: `contactctl reload`, then record again")
    log = measured.log
    return Motion(time_s=log.time_s, position=log.link_position, velocity=log.motor_velocity,
                  residual=r, raised=raised, touched=touched, uncertain=uncertain)  # fmt: skip


def _figures(one: "LevelsResult") -> str:
    if not math.isfinite(one.contact):
        return ""
    grows = f" + {one.per_speed:.2g} per rad/s" if one.per_speed else ""
    left_out = ""
    if one.discarded:
        worst = max(d.largest for d in one.discarded)
        left_out = f", discarded {len(one.discarded)} x, up to {worst:.2g} Nm"
    return (f"contact {one.contact:.3g} Nm{grows}, collision {one.collision:.3g} Nm, "
            f"largest |r| {one.largest:.3g} Nm in {one.used_s:.0f} s at up to "
            f"{one.seen.speed:.2g} rad/s{left_out}")  # fmt: skip


def _entry(
    one: "LevelsResult", measured: "Measured", per_hour: float, date: str
) -> "ThresholdsEntry":
    from daemon.config.identified import DiscardedEntry, SeenEntry, ThresholdsEntry
    from daemon.config.schema import Levels

    return ThresholdsEntry(
        date=date,
        log=measured.sha256,
        thresholds=Levels(
            contact=float(f"{one.contact:.4g}"),
            collision=float(f"{one.collision:.4g}"),
            per_speed=float(f"{one.per_speed:.4g}"),
        ),
        per_hour=per_hour,
        largest=float(f"{one.largest:.4g}"),
        seen=SeenEntry(
            speed=round(one.seen.speed, 4),
            lower=round(one.seen.lower, 4),
            upper=round(one.seen.upper, 4),
            load=measured.load,
        ),
        discarded=tuple(
            DiscardedEntry(
                at_s=round(d.at_s, 2),
                lasted_s=round(d.lasted_s, 2),
                largest=float(f"{d.largest:.3g}"),
            )
            for d in one.discarded
        ),
    )


def _settings(
    c: "Configuration", per_hour: float, *, it_was_me: bool
) -> "tuple[LevelSettings, Vector, Vector]":
    """Settings with floor and ceiling of the levels; largest torque (n,) [Nm] that friction hides
    at rest; contact level (n,) [Nm] that this torque and an unknown side of the gap raise to nearly
    `RAISED` times its value at rest.

    The floor is the larger of that level and 1 % of the drive's largest torque, which noise of the
    current may reach. The ceiling is a fifth of that torque: a higher level protects no one.
    """
    import numpy as np

    from daemon.arming.checks import RAISED
    from daemon.assembly import build_transmission
    from daemon.config.schema import frames_of
    from daemon.config.vectors import row
    from identification.thresholds import LevelSettings

    t, half_gap = build_transmission(c), row(c, lambda j: j.half_gap)
    hidden = (c.estimator.stiction_share + t.most_stiction) * t.engaged_coulomb
    unsure = c.estimator.unknown_side_share * (half_gap > 0.0)
    least = hidden / (_NEARLY * RAISED - 1.0 - unsure)
    strongest = row(c, lambda j: j.torque_constant * j.wiring.max_current_A)
    share = 0.2 if frames_of(c) else 1.0  # without drives, `strongest` is the largest in the log
    bounds = np.maximum(0.01 * strongest, least), share * strongest
    settings = LevelSettings(per_hour, per_hour / 100.0, *bounds, half_gap, it_was_me=it_was_me)
    return settings, hidden, least
