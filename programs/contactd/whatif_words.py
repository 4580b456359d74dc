"""Answers of `contactd whatif` as text."""

import math
from collections.abc import Sequence
from typing import Final

from programs.recordings.detection import Detection, Total
from programs.recordings.question import ARM, Answer, FoundContact, Question

ROWS_SHOWN: Final = 24
CONTACTS_SHOWN: Final = 12
FILES_SHOWN: Final = 5  # with more files, only totals and failures are printed


def counted(number: int, one: str, many: str) -> str:
    """Number with its noun in the singular or plural."""
    return f"{number} {one if number == 1 else many}"


def lines(
    question: Question, accepted: float, total: Total, found: Sequence[Detection]
) -> list[str]:
    """Answer as lines of text."""
    report = []
    for answer in total.answers if len(total.answers) <= FILES_SHOWN else []:
        report += _recording(question, answer)
    if total.files > 1:
        report.append(
            f"{len(total.answers)} of {total.files} recordings, {total.watched_s / 3600:.3g} h "
            f"watched: {sum(len(a.contacts) for a in total.answers)} contacts"
            + (
                f", {sum(len(a.recorded) for a in total.answers)} as recorded"
                if _changed(question)
                else ""
            )
        )
    if any(not answer.shares_known for answer in total.answers) and found:
        report.append(
            "recorded by a version without the lowering of levels by learning: every level is "
            "assumed to have been lowered by as much"
        )
    for one in found:
        report += _curve(question, accepted, total, one)
    return report


def _changed(question: Question) -> bool:
    return bool(question.residual or question.changes or question.fresh)


def _recording(question: Question, answer: Answer) -> list[str]:
    report = [f"{answer.file}: {answer.watched_s:.1f} s in which contacts are reported"]
    if answer.reaction_s is not None:
        if question.until_reaction:
            report.append(f"  until the first reaction, at {answer.reaction_s:.2f} s")
        else:
            report.append(
                f"  the arm first reacted at {answer.reaction_s:.2f} s: what follows is "
                "hypothetical, as it would have moved differently (--until-reaction leaves it out)"
            )
    if answer.skipped_s:
        report.append(
            f"  {answer.skipped_s:.1f} s after lost states are left out of the replay, as the "
            "estimator's state there is unknown (--fresh begins without it)"
        )
    report += _contacts("as recorded", answer.recorded)
    if _changed(question):
        report += _contacts("asked", answer.contacts)
    if answer.recorded_N or answer.force_N:
        asked = f"; asked {answer.force_N:.0f} N" if _changed(question) else ""
        recorded = f"up to {answer.recorded_N:.0f} N at the tool as recorded"
        report.append(f"  {'force':12} {recorded}{asked}")
    return report


def _contacts(name: str, found: Sequence[FoundContact]) -> list[str]:
    if not found:
        return [f"  {name:12} no contact"]
    rows = [
        f"  {name if k == 0 else '':12} {one.time_s:9.2f} s  {one.joint:16} {one.torque:+.2f} Nm, "
        f"beyond {one.threshold:.2f} Nm"
        for k, one in enumerate(found[:CONTACTS_SHOWN])
    ]
    left = len(found) - CONTACTS_SHOWN
    return [*rows, f"  {'':12} and {left} more: --json lists them"] if left > 0 else rows


def _curve(question: Question, accepted: float, total: Total, one: Detection) -> list[str]:
    labelled = one.labels > 0
    unit = "step" if one.name == ARM else "level"
    touches = counted(one.labels, "labelled touch", "labelled touches")
    about = f"{one.name}, {touches}" if labelled else one.name
    if one.name == ARM:
        about += f"; step k: the k-th level of {', '.join(question.levels)}, all else as it was"
    head = f"  {unit:>8} {'contacts':>9} {'false/h' if labelled else 'alarms/h':>9} {'beyond':>8}"
    report = ["", about, head + (f" {'found':>7} {'delay p50':>10} {'p95':>8}" if labelled else "")]
    for k in _shown(one):
        point = one.points[k]
        level = f"{point.level:8.0f}" if one.name == ARM else f"{point.level:8.3f}"
        row = f"  {level} {point.contacts:9} {point.alarms_per_hour:9.1f} {point.beyond:8.2%}"
        if labelled:
            row += f" {point.found:7} {_ms(point.delay_p50_s):>10} {_ms(point.delay_p95_s):>8}"
        report.append(row + ("  <- chosen" if k == one.chosen else ""))
    if one.chosen == 0 and len(one.points) > 1 and one.name != ARM:
        report.append(
            "  even the lowest of these levels is quiet: nothing here shows which is too low"
        )
    hours = total.outside_s / 3600.0
    if not labelled:
        report.append(
            "  no label is for this joint: every contact outside of all labels counts as an alarm"
            if total.outside_s < total.watched_s
            else "  every contact counts as an alarm here: label the touches (--labels)"
        )
    if one.chosen is None:
        report.append(f"  no level has at most {accepted:g} per hour")
    elif accepted * hours < 1.0:
        report.append(
            f"  {hours:.3g} h cannot prove {accepted:g} per hour: a single contact already makes "
            f"{1.0 / hours if hours else math.inf:.0f}; record longer before you trust it"
        )
    return report


def _ms(seconds: float) -> str:
    return "-" if math.isnan(seconds) else f"{1000 * seconds:.0f} ms"


def _shown(one: Detection) -> list[int]:
    """Rows of a curve that are printed: evenly spaced, the last, and the chosen one."""
    every = max(math.ceil(len(one.points) / ROWS_SHOWN), 1)
    rows = set(range(0, len(one.points), every)) | {len(one.points) - 1}
    return sorted(rows | ({one.chosen} if one.chosen is not None else set()))
