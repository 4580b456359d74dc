"""Step `gap`: half-gap of a joint, by its motor or by hand."""
# ruff: noqa: PLC0415 - a step imports what it needs when it runs, so that `--help` starts at once

import math
from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

import click

from programs.identify.step import JOINTS, Line, Outcome, now, step

if TYPE_CHECKING:
    from daemon.config.load import Robot
    from identification.gap_result import GapResult
    from programs.identify.identification import Identification
    from programs.identify.measured import Measured


@step(
    JOINTS,
    click.option("--by-hand", is_flag=True,
                 help="Hold the motor still while you move the link."),
    quality=lambda entry: f"{1e3 * entry.half_gap:.2f} +- {1e3 * entry.confidence:.2f} mrad",
    order=3,
)  # fmt: skip
def gap(identification: "Identification", joints: tuple[str, ...], by_hand: bool) -> bool:
    """Identify gaps: the motors move to and fro, joint by joint (those named, else those without a
    valid gap, or all).

    A link that gravity holds at one edge of its gap in every pose must be moved by hand: --by-hand.
    """
    from programs.identify.live_gap import gap_by_hand, gap_by_strokes
    from programs.identify.live_strokes import UnobservableError

    live = gap_by_hand if by_hand else gap_by_strokes

    def found(name: str) -> Outcome:
        try:
            measured = identification.measured(partial(live, joint=name), gap_of=name)
        except UnobservableError as error:
            return Outcome(lines=[Line(name, "by hand", good=False, reason=str(error))])
        with identification.busy(f"fitting the gap of {name}"):
            stroked = identification.arm is not None and not by_hand
            how = {"by_hand": by_hand, "stroked": stroked}
            return _outcome(identification.robot, measured, name, now(), **how)

    names, kind = identification.due("gap", joints), "gap" if by_hand else "strokes"
    outcomes: Iterable[Outcome] = map(found, names)
    if identification.arm is None:
        outcomes = list(outcomes)  # if a log is unreadable for one joint, nothing is written
    good = [identification.conclude("gap", outcome, f"{kind}-{name}")
            for name, outcome in zip(names, outcomes, strict=True)]  # fmt: skip
    return all(good)


def _outcome(
    robot: "Robot", measured: "Measured", name: str, date: str, *, by_hand: bool, stroked: bool
) -> Outcome:
    """Outcome with the half-gap of one joint, moved `by_hand` or `stroked` by its motor."""
    from daemon.config.identified import Entry, GapEntry
    from identification.gap import identify_gap
    from identification.gap_result import GapVerdict
    from programs.identify.plots import plot_gap

    log, place = measured.log, measured.log.joints.index(name)
    joint = robot.configuration.joints[robot.configuration.joint_names.index(name)]
    found = identify_gap(log, place, joint.torque_constant, joint.wiring.gear, by_hand=by_hand,
                         stroked=stroked)  # fmt: skip
    entries = dict[str, Entry]()
    if found.usable:
        entries[name] = GapEntry(
            date=date,
            log=measured.sha256,
            half_gap=round(float(found.half_gap), 6),
            confidence=0.0 if math.isnan(found.confidence) else round(float(found.confidence), 6),
            skew_ms=None if math.isnan(found.skew_s) else round(1e3 * float(found.skew_s), 3),
        )
    return Outcome(
        lines=[Line(name, found.verdict.value, found.usable, _figures(found), found.reason)],
        entries=entries,
        notes=measured.notes,
        draw=lambda folder: plot_gap(log, place, found.half_gap, folder / f"gap-{name}.png"),
        # Too few crossings are kept, so that further ones are added to them.
        unfinished=by_hand and found.verdict is GapVerdict.FEW,
    )


def _figures(found: "GapResult") -> str:
    figures = ""
    if math.isfinite(found.half_gap):
        figures = f"alpha {1e3 * found.half_gap:.2f} mrad"
    elif math.isfinite(found.estimate):
        figures = f"estimate, not used: alpha {1e3 * found.estimate:.2f} mrad"
    if figures and math.isfinite(found.confidence):
        figures += f" +- {1e3 * found.confidence:.2f}"
    parts = [figures] if figures else []
    if math.isfinite(found.skew_s):
        parts.append(f"link encoder {1e3 * found.skew_s:+.2f} ms late")
    return "; ".join([*parts, *(str(one) for one in found.harmonics)])
